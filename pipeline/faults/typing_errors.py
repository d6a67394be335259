"""The number that was meant where a wrong one was typed: typing errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType

_TENS = (10.0, 0.1, 100.0, 0.01, 1000.0, 0.001)
"""Factors of a missing or misplaced decimal point [1]."""

GUESSES = ("one digit wrong", "one digit lost", "one digit too many")
"""Slips with so many outcomes that one of them often fits by chance."""

WITHIN = 3.0
"""Standard uncertainties within which a number agrees with the pulls [1]."""


def intended(
    given: float, fits: float, std: float, units: Mapping[str, float] = MappingProxyType({})
) -> tuple[float, str] | None:
    """The number that fits, one typing error away from the given one, and the error, if any does.

    Of a misplaced decimal point and another unit, which are as usual and nearly alike (9.81 and
    10), the nearer one.

    Args:
        given: Number as logged.
        fits: Number according to all other data.
        std: Its standard uncertainty.
        units: Units in which it may have been read, each over that of the log [1].
    """
    for numbers in (
        ((one, "two digits exchanged") for one in _exchanged(given)),
        _scaled(given, units),
        ((one, "one digit wrong") for one in _replaced(given)),
        ((one, "one digit lost") for one in _inserted(given)),
        ((one, "one digit too many") for one in _dropped(given)),
    ):
        near = [one for one in numbers if abs(one[0] - fits) <= WITHIN * std and one[0] != given]
        if near:
            return min(near, key=lambda one: abs(one[0] - fits))
    return None


def factor(given: float, fits: float, std: float) -> float | None:
    """A factor in tenths, such as 1.1, of the number that fits, if one leads to the given number.

    Args:
        given: Number as logged.
        fits: Number according to all other data.
        std: Its standard uncertainty.
    """
    times = round(given / fits, 1) if fits else 0.0
    whole = times <= 0 or times == round(times)  # an exact multiple is no error of a gain
    return None if whole or abs(given / times - fits) > WITHIN * std else times


def _scaled(given: float, units: Mapping[str, float]) -> Iterator[tuple[float, str]]:
    yield from ((given * ten, "the decimal point in the wrong place") for ten in _TENS)
    yield from ((given * size, f"read in {unit}") for unit, size in units.items())


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
