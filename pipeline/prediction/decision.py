"""The decision rule of ISO 14253-1:2017, 5.2 to 5.4, for a largest admissible value."""

from __future__ import annotations

from enum import StrEnum

GUARD = 1.65
"""Guard band over the standard uncertainty [1]: 95 % of a normal distribution lie below it."""


class Decision(StrEnum):
    """What is decided of a point or of a stretch of a path."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"


def decide(value: float, std: float, most: float) -> Decision:
    """Accept where d + 1.65 u <= T, reject where d - 1.65 u > T, else undecided.

    Args:
        value: d.
        std: Its standard uncertainty u, in the same unit; infinite where nobody knows it.
        most: T, in the same unit.
    """
    if value + GUARD * std <= most:
        return Decision.PASS
    return Decision.FAIL if value - GUARD * std > most else Decision.UNDECIDED
