"""The number that was meant where a wrong one was typed: typing errors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

_TENS = (10.0, 0.1, 100.0, 0.01, 1000.0, 0.001)
"""Factors of a missing or misplaced decimal point [1]."""

_WITHIN = 3.0
"""Standard uncertainties within which a number agrees with the pulls [1]."""


def intended(given: float, fits: float, std: float) -> tuple[float, str] | None:
    """The number that fits, one typing error away from the given one, and the error, if any does.

    Args:
        given: Number as logged.
        fits: Number according to all other data.
        std: Its standard uncertainty.
    """
    for slip, numbers in (
        ("two digits exchanged", _exchanged(given)),
        ("the decimal point in the wrong place", (given * ten for ten in _TENS)),
        ("one digit wrong", _replaced(given)),
        ("one digit lost", _inserted(given)),
        ("one digit too many", _dropped(given)),
    ):
        near = [one for one in numbers if abs(one - fits) <= _WITHIN * std and one != given]
        if near:
            return min(near, key=lambda one: abs(one - fits)), slip
    return None


def _exchanged(given: float) -> Iterator[float]:
    text = _text(given)
    places = [k for k, c in enumerate(text) if c != "."]
    for i, k in pairwise(places):
        yield float(text[:i] + text[k] + text[i + 1 : k] + text[i] + text[k + 1 :])


def _replaced(given: float) -> Iterator[float]:
    text = _text(given)
    for k in (k for k, c in enumerate(text) if c != "."):
        yield from (float(f"{text[:k]}{digit}{text[k + 1 :]}") for digit in range(10))


def _inserted(given: float) -> Iterator[float]:
    text = _text(given)
    for k in range(len(text.split(".")[0]) + 1):
        yield from (float(f"{text[:k]}{digit}{text[k:]}") for digit in range(10))


def _dropped(given: float) -> Iterator[float]:
    text = _text(given)
    for k in range(len(text.split(".")[0])):
        yield float(f"0{text[:k]}{text[k + 1 :]}")


def _text(given: float) -> str:
    return f"{given:.10g}" if given < 1e9 else f"{given:.0f}"
