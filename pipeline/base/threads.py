"""Work on two threads: numpy and Arrow release the interpreter lock while they process arrays.

Linear algebra itself has one thread: with another number its last digits differ.
"""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

_S = TypeVar("_S")
_T = TypeVar("_T")

WORTH_A_THREAD = 100_000
"""Number of rows, or bytes to be read, from which a second thread saves time."""


def both(first: Callable[[], _S], second: Callable[[], _T], much: bool) -> tuple[_S, _T]:
    """Results of two functions, evaluated in parallel if there is much to do.

    If both fail, the error of the first is raised.
    """
    if not much:
        return first(), second()
    with ThreadPoolExecutor(1) as other:
        beside = other.submit(second)
        return first(), beside.result()


def spread(work: Callable[[_S], _T], items: Iterable[_S], much: bool = True) -> list[_T]:
    """Apply `work` to every item in order; two at a time if there is much to do."""
    if not much:
        return [work(item) for item in items]
    with ThreadPoolExecutor(2) as two:
        return list(two.map(work, items))


_HELD = threading.RLock()
_FOUND: list[int] = []
"""Threads that each library had before the outermost block began; empty outside of any."""
_INSIDE = [0]


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Linear algebra in one thread within the block, however many it has around it.

    A process that has imported numpy before us, such as a worker of Dask's or a notebook, has begun
    as many as there are cores, and no variable of its environment changes that any more.
    """
    libraries = _blas()
    with _HELD:
        if not _INSIDE[0]:
            _FOUND[:] = [get() for get, _ in libraries]
            _give(libraries, [1] * len(libraries))
        _INSIDE[0] += 1
    try:
        yield
    finally:
        with _HELD:
            _INSIDE[0] -= 1
            if not _INSIDE[0]:
                _give(libraries, _FOUND)


_Blas = tuple[Callable[[], int], Callable[[int], None]]


def _give(libraries: Iterable[_Blas], threads: Iterable[int]) -> None:
    for (_, set_), number in zip(libraries, threads, strict=True):
        set_(number)


@cache
def _blas() -> tuple[_Blas, ...]:
    """How to ask and to set the threads of each OpenBLAS that numpy and scipy bring."""
    found = []
    for package in ("numpy", "scipy"):
        spec = find_spec(package)
        home = Path(spec.origin).parent if spec and spec.origin else Path()
        for folder in (home.with_name(f"{package}.libs"), home / ".dylibs"):
            found += [_threads_of(ctypes.CDLL(str(path))) for path in folder.glob("*openblas*")]
    return tuple(one for one in found if one is not None)


def _threads_of(library: Any) -> _Blas | None:
    for ends in ("64_", ""):
        with contextlib.suppress(AttributeError):
            names = (f"scipy_openblas_{word}_num_threads{ends}" for word in ("get", "set"))
            get, set_ = (getattr(library, name) for name in names)
            return get, set_
    return None
