"""The digits of an export: rounding is an error of every coordinate."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array

_UNITS_M = (1.0, 1e-3, 0.0254)
_DIGITS = 8
"""Decimals behind a metre, or its unit, that are tried: no export has more."""
_LOOKED_AT = 300
"""So many readings show with how many digits an export is written."""


def rounding(positions: Array) -> float:
    """Standard uncertainty of a coordinate, h / sqrt(12) with h the last digit [m].

    0 without readings, and where no digit is the last.

    Args:
        positions: Readings [m], shape (n, 3).
    """
    x = np.asarray(positions[:_LOOKED_AT], dtype=float).ravel()
    for digits in range(_DIGITS):
        for unit in _UNITS_M:
            steps = x / unit * 10.0**digits
            if len(x) and np.abs(steps - np.round(steps)).max() < 1e-3:
                return float(unit / 10.0**digits / np.sqrt(12))
    return 0.0
