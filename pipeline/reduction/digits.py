"""The digits of an export, and the divisions of a scale: rounding is an error of every reading."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.strict import STANDARD_GRAVITY

_UNITS_M = (1.0, 1e-3, 0.0254)
_DIGITS = 8
"""Decimals behind a metre, or its unit, that are tried: no export has more."""
_LOOKED_AT = 300
"""So many readings show with how many digits an export is written."""


_UNITS_N = (1.0, STANDARD_GRAVITY)
_DIVISIONS = tuple(d * 10.0**k for k in range(3, -4, -1) for d in (5.0, 2.0, 1.0))
"""Divisions of scales and displays, 1, 2 or 5 times a power of ten [N] or [kgf], the widest first
(OIML R 76-1, 4.2.2)."""
_DIFFERENT = 6
"""So many different readings, all of them multiples of it, show a division [1]: of one of half its
width they would be so in 1 of 64 cases."""
_FEWEST = 20
"""Divisions in the largest reading [1]: fewer may be steps to which somebody pulled, as a
crane scale has 100 (OIML R 76-1, class IIII) and is used in more than a fifth of its range."""
_LADDERS = 2
"""Sets of steps to which somebody pulls in one campaign [1]: one for most poses, and one for those
that bear less. More different readings than these hold are no steps, however few divisions."""
_MOST = 100_000
"""Divisions of a scale at most (OIML R 76-1, class II): more are digits of a file."""


def division(forces: Array, pose: Array) -> float:
    """The division h of a scale [N]: the widest that all of its readings are multiples of.

    What is read is anywhere within half a division, uniformly: standard uncertainty h / sqrt(12).
    0 where nothing shows one: steps to which somebody pulled are none.

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
