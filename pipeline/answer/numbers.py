"""Numbers as result.json holds them."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.linear import rms


def left_out_mm(left_out_m: Array) -> float | None:
    """Rms [mm] of cross-validation residuals [m] that other poses determine; None without any."""
    known = left_out_m[np.isfinite(left_out_m)]
    return 1e3 * rms(known) if len(known) else None
