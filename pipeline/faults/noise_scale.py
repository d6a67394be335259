"""How much the readings scatter, a few bad ones left out."""

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
    """Scatter of the effector's triangle over the stated one, a few bad readings left out.

    s = median|w| / 0.6745 of the whitened contrasts w, then five times s^2 = mean(w^2) / 0.9733
    over |w| <= 3 s: 0.9733 is the variance of a standard normal cut at 3. Never below one: a
    certificate may be too modest, but chance must not make outliers.

    Returns:
        The factor, and how many contrasts it rests on.
    """
    contrasts = pure_error(system, estimate.residual, data, zeros, cell)
    if len(contrasts.rows) < 12:
        return 1.0, max(estimate.dof, 1)
    w = whitener(contrasts.errors, contrasts.rows.pose).by_pose(contrasts.c)
    scale = float(np.median(np.abs(w)) / special.ndtri(0.75))
    for _ in range(5):
        inside = w[np.abs(w) <= 3 * scale]  # never empty: rows without scatter count, too
        scale = float(np.sqrt(np.mean(inside**2) / 0.9733))  # variance of a normal cut at 3 sigma
    return max(scale, 1.0), len(w)
