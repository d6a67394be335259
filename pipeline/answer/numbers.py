"""Rms values as given in result.json."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array


def rms_mm(values: Array) -> float:
    """Root mean square over coordinates [mm], unweighted."""
    return 1e3 * linear.rms(values)


def left_out_m(residuals: Array) -> float | None:
    """Rms [m] of the cross-validation residuals that other poses determine; None without any."""
    known = residuals[np.isfinite(residuals)]
    return linear.rms(known) if len(known) else None


def left_out_mm(residuals: Array) -> float | None:
    """Rms [mm] of the cross-validation residuals that other poses determine; None without any."""
    rms = left_out_m(residuals)
    return None if rms is None else 1e3 * rms
