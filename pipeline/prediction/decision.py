"""Decision rule of ISO 14253-1:2017, 5.2 to 5.4, for an upper tolerance limit."""

from __future__ import annotations

from enum import StrEnum

GUARD = 1.65
"""Guard band over the standard uncertainty [1]: 95 % of a normal distribution lie below it."""


class Decision(StrEnum):
    """Decision about a point or a stretch of a path."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"


def decide(value: float, std: float, most: float) -> Decision:
    """Accept if d + 1.65 u <= T, reject if d - 1.65 u > T, else undecided.

    Args:
        value: d.
        std: Its standard uncertainty u, in the same unit; infinite if unknown.
        most: T, in the same unit.
    """
    if value + GUARD * std <= most:
        return Decision.PASS
    return Decision.FAIL if value - GUARD * std > most else Decision.UNDECIDED
