"""Names of units of length and angle, and conversion of lengths to metres."""

from __future__ import annotations

from typing import Literal, get_args

from pipeline.base.arrays import Array

Usual = Literal["mm", "m", "in"]
USUAL_UNITS: tuple[str, ...] = get_args(Usual)
"""Units of length offered in questions, and tried if none is stated."""
_LONG = {"in": 0.0254, "ft": 0.3048, "ftUS": 1200 / 3937}
"""Inch, foot and US survey foot [m], by definition (1959; Mendenhall Order 1893); the latter makes
18 m of rail 36 um longer."""
_IN_A_METRE = {"mm": 1e3, "cm": 1e2, "m": 1.0, "um": 1e6}
"""Number of each other unit of length in a metre [1]."""


def metres(values: Array, unit: str) -> Array:
    """Convert lengths to metres; mm are divided by 1000, which rounds once, times 0.001 twice."""
    return values * _LONG[unit] if unit in _LONG else values / _IN_A_METRE[unit]


def in_unit(values: Array, unit: str) -> Array:
    """Convert lengths in metres to another unit."""
    return values / _LONG[unit] if unit in _LONG else values * _IN_A_METRE[unit]
