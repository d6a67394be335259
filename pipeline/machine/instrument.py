"""What a laser tracker's reading is worth: its 3x3 covariance, beam frame included.

Six numbers per reading, in the order of `covariance.PAIRS`, [m^2].
"""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.covariance import COLUMN, ROW
from pipeline.base.strict import Scatter, Strict, Uncertainty


class InstrumentNoise(Strict):
    """Standard uncertainty of one reading in the beam's frame, constant and per metre of range."""

    range_m: Scatter
    range_per_m: Uncertainty = 0.0
    transverse_m: Scatter
    transverse_per_m: Uncertainty = 0.0


PAPER_SIGMA_M = 3e-5
"""Eq. (18): the radius is N(0, 0.03 mm)."""

PAPER_SHARE = np.array([0.25, 0.0, 0.0, 0.25, 0.0, 0.5])
"""Eq. (18): theta uniform on [0, pi/2], phi uniform give E[u u'] = diag(1/4, 1/4, 1/2)."""

ISOTROPIC = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def beam_covariance(position: Array, noise: InstrumentNoise) -> Array:
    """Covariance from the instrument's specification, in the frame of the reading.

    sigma = constant + part * range, added linearly: data sheets state "15 um + 6 um/m", one bound
    that grows with the range, and not two independent contributions. With d along the beam,
    C = s_t^2 I + (s_r^2 - s_t^2) d d'.

    Args:
        position: Readings in a frame whose origin is the instrument [m], shape (n, 3).
        noise: Range and transverse parts.

    Returns:
        Shape (n, 6). A reading at the origin has no beam and gets the larger part all round.
    """
    reach = np.linalg.norm(position, axis=1)
    along = (noise.range_m + noise.range_per_m * reach) ** 2
    across = (noise.transverse_m + noise.transverse_per_m * reach) ** 2
    nowhere = reach == 0
    across = np.where(nowhere, np.maximum(along, across), across)
    share = np.where(nowhere, 0.0, (along - across) / np.where(nowhere, 1.0, reach) ** 2)
    out = np.empty((len(position), 6))
    for k, (i, j) in enumerate(zip(ROW, COLUMN, strict=True)):
        out[:, k] = share * position[:, i] * position[:, j] + (across if i == j else 0.0)
    return out
