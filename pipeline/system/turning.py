"""Unstated noise of a measured pose: rotations and positions have different noises.

Position s and rotation L w of a pose are six coordinates in metres (`machine.six`), read by one
instrument with two noises. If both are weighted alike, springs that rest on the noisier kind get
too small an uncertainty. The ratio of the two is estimated by restricted likelihood,
V = s_p^2 V_p + s_r^2 V_r + V_rest, from contrasts that no model of the robot can produce, or from
the residuals of the joint springs where these are too few.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell
from pipeline.machine.six import ROWS
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Settings
from pipeline.system.assemble import TRACKED
from pipeline.system.contrasts import pure_error, repeated_zeros, stacked
from pipeline.system.estimate import identify
from pipeline.system.restricted import PaddedRows, maximum
from pipeline.system.system import Errors, System
from pipeline.system.variance import UNDETERMINED

_TURNED = "turned"
"""Name of the sources `tracker` and `zero` where they act on a rotation."""

_FEWEST = 24
"""Minimum number of contrasts to resolve two noises: a dozen each, as one noise needs."""


def apart(
    settings: Settings, cell: Cell, placed: pd.DataFrame, data: Measured, start: Array
) -> Measured:
    """The measurements with rotations weighted by their own noise, relative to that of positions.

    Args:
        settings: Names of the measured targets.
        cell: The joint springs.
        placed: Table PLACED, for repeated zeros.
        data: Six coordinates of poses whose noise is not stated.
        start: First values of the compliances, shape (n,).
    """
    system, estimate = identify(cell, data, start)
    zeros = repeated_zeros(settings, placed)
    stack = stacked(system, estimate.residual, data, zeros, cell)
    pure = pure_error(system, estimate.residual, data, zeros, cell)
    contrasts = replace(pure, errors=_by_kind(stack.errors, pure.errors, stack.target))
    own = np.repeat(data.target, 3)
    residuals = replace(system, errors=_by_kind(system.errors, system.errors, own))
    for rows in (contrasts, residuals):
        ratio = _ratio(rows)
        if ratio is not None:
            variance = np.where(data.target == ROWS.index("rotation"), ratio**2, 1.0)
            idle = data.idle and data.idle.with_rotation(ratio)
            return replace(data.reweighed(variance, variance), idle=idle)
    return data


def _by_kind(seen: Errors, errors: Errors, kind: Ints) -> Errors:
    """Errors with separate sources for rotations, according to the row that each moves most."""
    row = np.asarray(abs(seen.G).argmax(axis=0)).ravel()
    turns = kind[row] == ROWS.index("rotation")
    mine = turns & np.isin(seen.source.astype(str), ("tracker", "zero"))
    return replace(errors, source=np.where(mine, _TURNED, errors.source))


def _ratio(system: System) -> float | None:
    """Noise of rotations over that of positions, None where the rows cannot resolve it."""
    if len(system.rows) - system.B.shape[1] < _FEWEST:
        return None
    columns = system.B * system.typical if system.B.shape[1] else system.B
    blocks = PaddedRows.of(system, columns, [TRACKED, (_TURNED,)])
    log_scale, std, _ = maximum(blocks, np.array([True, True]))
    return float(np.exp(log_scale[1] - log_scale[0])) if (std < UNDETERMINED).all() else None
