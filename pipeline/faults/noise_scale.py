"""Scatter of the readings, robust against a few bad ones."""

from __future__ import annotations

import numpy as np
from scipy import special

from pipeline.machine.cell import Cell
from pipeline.reduction.measured import Measured
from pipeline.system.contrasts import Zeros, pure_error
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener


def noise_scale(
    system: System, estimate: Estimate, data: Measured, zeros: Zeros, cell: Cell
) -> tuple[float, int]:
    """Scatter of the effector's readings against each other over the stated one, robustly.

    s = median|w| / 0.6745 of the whitened contrasts w, then five iterations of
    s^2 = mean(w^2) / 0.9733 over |w| <= 3 s, with 0.9733 the variance of a standard normal
    truncated at 3. At least one: a certificate may be conservative, but chance must not create
    outliers.

    Returns:
        The factor, and the number of contrasts that it is estimated from.
    """
    contrasts = pure_error(system, estimate.residual, data, zeros, cell)
    if len(contrasts.rows) < 12:
        return 1.0, max(estimate.dof, 1)
    w = whitener(contrasts.errors, contrasts.rows.pose).by_pose(contrasts.c)
    scale = float(np.median(np.abs(w)) / special.ndtri(0.75))
    for _ in range(5):
        inside = w[np.abs(w) <= 3 * scale]  # never empty, also if all rows are equal
        scale = float(np.sqrt(np.mean(inside**2) / 0.9733))  # normal truncated at 3 sigma
    return max(scale, 1.0), len(w)
