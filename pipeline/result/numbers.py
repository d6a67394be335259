"""Numbers as result.json holds them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.results import Array


def rms_mm(values: Array) -> float:
    """Root mean square over coordinates [mm], unweighted."""
    return 1e3 * float(np.sqrt(np.mean(np.asarray(values, dtype=float) ** 2)))


def left_out_mm(residuals: pd.DataFrame) -> float | None:
    """The same of the left-out residuals that the other poses can tell; None when there is none."""
    known = residuals["left_out_m"].dropna().to_numpy()
    return rms_mm(known) if len(known) else None


def finite(value: float) -> float | None:
    """A number JSON can hold."""
    return float(value) if np.isfinite(value) else None
