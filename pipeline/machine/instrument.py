"""Uncertainty of a laser tracker's reading: its 3x3 covariance from the beam frame.

Six numbers per reading, in the order of `covariance.PAIRS`, [m^2]. `instruments.toml` has the
printed figures of trackers whose data sheets are known.
"""

from __future__ import annotations

import re
import tomllib
from difflib import get_close_matches
from functools import cache
from importlib import resources
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.base.arrays import Array
from pipeline.base.covariance import COLUMN, ROW
from pipeline.base.strict import Strict, Uncertainty

_VISIBLE = 1e-10
"""Smallest scatter of a reading [m]: less than an atom."""


class InstrumentNoise(Strict):
    """Standard uncertainty of one reading in the beam frame, constant and per metre of range."""

    range_m: Uncertainty
    range_per_m: Uncertainty = 0.0
    transverse_m: Uncertainty
    transverse_per_m: Uncertainty = 0.0

    @model_validator(mode="after")
    def some_in_each_direction(self) -> InstrumentNoise:
        """Refuse readings without any scatter along the beam or across it."""
        along, across = self.range_m + self.range_per_m, self.transverse_m + self.transverse_per_m
        if min(along, across) < _VISIBLE:
            raise ValueError("has no scatter along the beam or across it; write one, also per_m")
        return self


_WORTH = {"mpe": 1 / np.sqrt(3), "two_sigma": 0.5}
"""Standard uncertainty over the printed figure [1]: for a maximum permissible error that of a
rectangular distribution (GUM, JCGM 100:2008, 4.3.7); for two standard deviations, a half."""

_MICRON = 1e-6
"""Micrometre [m]."""

_MAKERS = r"leica|hexagon|faro|api|absolute|laser|tracker(?!3)|geosystems|metrology"
"""Words in a name that do not identify the type."""

_NEAR = 3
"""Maximum number of similar names suggested for an unknown type."""


class DataSheet(Strict):
    """A data sheet.

    Attributes:
        names: Types of instrument to which it applies.
        figure: Meaning of its figures: maximum permissible errors, or two standard deviations.
        along: Printed figure along the beam [um], and per metre of distance [um/m].
        across: The same across the beam.
        source: Its title and year, and the figures as printed.
    """

    names: tuple[str, ...] = Field(min_length=1)
    figure: Literal["mpe", "two_sigma"]
    along: tuple[float, float]
    across: tuple[float, float]
    source: str

    @property
    def noise(self) -> InstrumentNoise:
        """Resulting standard uncertainties of a reading [m], and per metre of range."""
        worth = _MICRON * _WORTH[self.figure]
        (range_m, range_per_m), (transverse_m, transverse_per_m) = self.along, self.across
        return InstrumentNoise(
            range_m=worth * range_m or _LEAST_M,
            range_per_m=worth * range_per_m,
            transverse_m=worth * transverse_m or _LEAST_M,
            transverse_per_m=worth * transverse_per_m,
        )


_LEAST_M = 1e-6
"""Constant part of a figure that is printed per metre only [m]: no air is calmer."""


@cache
def sheets() -> tuple[DataSheet, ...]:
    """All known data sheets."""
    text = (resources.files(__package__) / "instruments.toml").read_text("utf-8")
    return tuple(DataSheet.model_validate(one) for one in tomllib.loads(text)["sheet"])


def sheet(model: str) -> DataSheet | None:
    """Data sheet of a type of instrument, regardless of spelling; None if unknown."""
    return next((one for one in sheets() if _type(model) in map(_type, one.names)), None)


def near(model: str) -> list[str]:
    """Known names that are similar to an unknown one."""
    names = {_type(name): name for one in sheets() for name in one.names}
    return [names[one] for one in get_close_matches(_type(model), names, _NEAR, 0.5)]


def _type(name: str) -> str:
    """Letters and digits of a type, without its maker."""
    return re.sub(r"[^a-z0-9]", "", re.sub(_MAKERS, "", name.lower()))


PAPER_SIGMA_M = 3e-5
"""Standard deviation of the radius in Eq. (18) [m]: N(0, 0.03 mm)."""

PAPER_SHARE = np.array([0.25, 0.0, 0.0, 0.25, 0.0, 0.5])
"""Eq. (18): theta uniform on [0, pi/2] and phi uniform give E[u u'] = diag(1/4, 1/4, 1/2)."""

ISOTROPIC = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def beam_covariance(position: Array, noise: InstrumentNoise) -> Array:
    """Covariance of readings from the instrument's specification, in the frame of the readings.

    sigma = constant + part * range, added linearly: data sheets state "15 um + 6 um/m", one bound
    that grows with the range, and not two independent contributions. With d along the beam,
    C = s_t^2 I + (s_r^2 - s_t^2) d d'.

    Args:
        position: Readings in a frame whose origin is the instrument [m], shape (n, 3).
        noise: Range and transverse parts.

    Returns:
        Shape (n, 6) [m^2]. A reading at the origin has no beam direction and gets the larger of the
        two parts in all directions.
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


_BEAM = 0.05
"""Relative misfit of three variances that rounding in a file may cause [1]: 5 um to 0.1 um."""


def correlated(position: Array, variance: Array) -> Array | None:
    """Covariances of readings whose axis variances are stated but whose correlations are not.

    C = b I + (a - b) d d' has v_i = b + (a - b) d_i^2, where a and b are the variances along the
    beam and across it, fitted to each reading by least squares: software of trackers leaves out the
    correlations where it states three standard uncertainties.

    Args:
        position: Readings in a frame whose origin is the instrument [m], shape (n, 3).
        variance: Variances along its axes [m^2], shape (n, 3).

    Returns:
        Shape (n, 6) [m^2], uncorrelated for readings that do not fit; None if most variances do not
        fit a beam, or are alike along all axes.
    """
    reach = np.linalg.norm(position, axis=1, keepdims=True)
    away = (position / np.where(reach > 0, reach, 1.0)) ** 2 - (reach > 0) / 3
    mean = variance.mean(axis=1, keepdims=True)
    lever = np.sum(away**2, axis=1, keepdims=True)
    slope = np.sum(away * variance, axis=1, keepdims=True) / np.where(lever > 0, lever, 1.0)
    left = np.linalg.norm(variance - mean - slope * away, axis=1)
    apart, known = np.ptp(variance, axis=1), mean[:, 0] > 0
    part = np.column_stack([left, apart])[known] / mean[known]
    if not known.any() or np.median(part[:, 0]) > _BEAM or np.median(part[:, 1]) < _BEAM:
        return None
    d, b = position / np.where(reach > 0, reach, 1.0), mean - slope / 3
    sound = (left <= _BEAM * mean[:, 0]) & (np.minimum(b, b + slope)[:, 0] > 0)
    cross = np.where(sound, slope[:, 0], 0.0)
    return np.column_stack(
        [
            variance[:, i] if i == j else cross * d[:, i] * d[:, j]
            for i, j in zip(ROW, COLUMN, strict=True)
        ]
    )
