"""Work on two threads: numpy and Arrow release the interpreter lock while they process arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")

MUCH = 100_000
"""Number of rows, or bytes to be read, from which a second thread saves time."""


def both(first: Callable[[], S], second: Callable[[], T], much: bool) -> tuple[S, T]:
    """Results of two functions, evaluated in parallel if there is much to do.

    If both fail, the error of the first is raised.
    """
    if not much:
        return first(), second()
    with ThreadPoolExecutor(1) as other:
        beside = other.submit(second)
        return first(), beside.result()


def spread(work: Callable[[S], T], items: Iterable[S], much: bool = True) -> list[T]:
    """Apply `work` to every item in order; two at a time if there is much to do."""
    if not much:
        return [work(item) for item in items]
    with ThreadPoolExecutor(2) as two:
        return list(two.map(work, items))
