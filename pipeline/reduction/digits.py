"""Resolution of an export and of a scale: rounding is an error of every reading."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.strict import STANDARD_GRAVITY

_UNITS_M = (1.0, 1e-3, 0.0254)
_DIGITS = 8
"""Maximum number of decimals tried, of a metre or another unit: no export has more."""
_LOOKED_AT = 300
"""Number of readings from which the number of digits of an export is determined."""


_UNITS_N = (1.0, STANDARD_GRAVITY)
_DIVISIONS = tuple(d * 10.0**k for k in range(3, -4, -1) for d in (5.0, 2.0, 1.0))
"""Divisions of scales and displays, 1, 2 or 5 times a power of ten [N] or [kgf], the widest first
(OIML R 76-1, 4.2.2)."""
_DIFFERENT = 6
"""Minimum number of different readings, all multiples of a division, that establish it [1]: with a
division of half the width this would happen by chance in 1 of 64 cases."""
_FEWEST = 20
"""Minimum number of divisions in the largest reading [1]: fewer may be load steps that were aimed
at, as a crane scale has 100 (OIML R 76-1, class IIII) and is used in more than a fifth of its
range."""
_LADDERS = 2
"""Number of different sets of load steps aimed at in one campaign [1]: one for most poses, and one
for those that bear less. More different readings than these contain are not load steps, however few
the divisions."""
_MOST = 100_000
"""Maximum number of divisions of a scale (OIML R 76-1, class II): more are digits of a file."""


def division(forces: Array, pose: Array) -> float:
    """Division h of a scale [N]: the widest of which all readings are multiples.

    The rounding error is uniform within half a division: standard uncertainty h / sqrt(12). 0 where
    none is found; load steps that were aimed at do not count as one.

    Args:
        forces: Readings [N], shape (n,).
        pose: Pose of each, shape (n,).
    """
    x = np.unique(forces[np.isfinite(forces) & (forces != 0)])
    if len(x) < _DIFFERENT:
        return 0.0
    steps = _LADDERS * int(np.unique(pose, return_counts=True)[1].max())
    fewest = 1 if len(x) > steps else _FEWEST
    every = sorted((d * unit for d in _DIVISIONS for unit in _UNITS_N), reverse=True)
    h = next((h for h in every if np.abs(x / h - np.round(x / h)).max() < 1e-3), 0.0)
    return h if fewest * h <= np.abs(x).max() <= _MOST * h else 0.0


def rounding(positions: Array) -> float:
    """Standard uncertainty of a coordinate due to rounding, h / sqrt(12) with h the last digit [m].

    0 without readings, and where no last digit is found.

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
