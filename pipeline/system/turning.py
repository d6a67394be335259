"""The noise of a measured pose where nobody states it: rotations err otherwise than positions.

Position s and rotation L w of a pose are six coordinates in metres (`machine.six`), read by one
instrument with two noises. Weighed alike, springs that rest on the noisier kind come out too sure.
The ratio of the two is found by restricted likelihood, V = s_p^2 V_p + s_r^2 V_r + V_rest, from
contrasts that no model of the robot can make, or from what the joint springs leave where these
are too few.
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
from pipeline.system.variance import UNTOLD

_TURNED = "turned"
"""Stands for the sources of `TRACKED` where they move a rotation."""

_FEWEST = 24
"""Fewer contrasts do not tell two noises: a dozen each, as one noise needs."""


def apart(
    settings: Settings, cell: Cell, placed: pd.DataFrame, data: Measured, start: Array
) -> Measured:
    """The measurements with rotations weighed by their own noise, in units of the positions'.

    Args:
        settings: Names of the measured targets.
        cell: The joint springs.
        placed: Table PLACED, for zeros that were read again.
        data: Six coordinates of poses whose noise nobody states.
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
    """Errors with sources of their own for rotations, by the rows that each moves most, (M,)."""
    row = np.asarray(abs(seen.G).argmax(axis=0)).ravel()
    turns = kind[row] == ROWS.index("rotation")
    mine = turns & np.isin(seen.source.astype(str), ("tracker", "zero"))
    return replace(errors, source=np.where(mine, _TURNED, errors.source))


def _ratio(system: System) -> float | None:
    """Noise of rotations over that of positions, None where the rows do not tell."""
    if len(system.rows) - system.B.shape[1] < _FEWEST:
        return None
    columns = system.B * system.typical if system.B.shape[1] else system.B
    blocks = PaddedRows.of(system, columns, [TRACKED, (_TURNED,)])
    log_scale, std, _ = maximum(blocks, np.array([True, True]))
    return float(np.exp(log_scale[1] - log_scale[0])) if (std < UNTOLD).all() else None
