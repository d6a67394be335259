"""Numbers as result.json holds them."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array


def rms_mm(values: Array) -> float:
    """Root mean square over coordinates [mm], unweighted."""
    return 1e3 * linear.rms(values)


def left_out_mm(left_out_m: Array) -> float | None:
    """The same of cross-validation residuals [m] that other poses determine; None without any."""
    known = left_out_m[np.isfinite(left_out_m)]
    return rms_mm(known) if len(known) else None
