"""Work on two threads: numpy and Arrow let go of the interpreter while they run through arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")

MUCH = 100_000
"""Rows, or bytes to be read, from which on a second thread costs less than it saves."""


def both(first: Callable[[], S], second: Callable[[], T], much: bool) -> tuple[S, T]:
    """What two pieces of work give, in parallel where there is much to do.

    Where both fail, the first is heard.
    """
    if not much:
        return first(), second()
    with ThreadPoolExecutor(1) as other:
        beside = other.submit(second)
        return first(), beside.result()


def spread(work: Callable[[S], T], items: Iterable[S], much: bool = True) -> list[T]:
    """Work done on every item, in their order; two at a time where there is much to do."""
    if not much:
        return [work(item) for item in items]
    with ThreadPoolExecutor(2) as two:
        return list(two.map(work, items))
