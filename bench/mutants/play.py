"""Tests of a room in a process of their own, and which functions each of them enters."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.abc
import importlib.util
import json
import os
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

SECONDS = 120.0
"""Maximum time for the tests of one bug [s]; a bug that never ends is noticed."""

_HEAVY = (
    "matplotlib.figure",
    "pandas",
    "pinocchio",
    "pyarrow.parquet",
    "pydantic",
    "pytest",
    "scipy.optimize",
    "scipy.stats",
)

Reached = dict[str, dict[str, Any]]
"""Of each test its duration `s` [s] and the functions `of` that it enters, as file:line."""


def warm() -> None:
    """Import what every process needs, once: not the package, which a bug is planted in."""
    for name in _HEAVY:
        importlib.import_module(name)


def apart(work: Callable[[], Any], seconds: float) -> Any:
    """Result of work in a copy of this process; None if it does not end in time.

    Raises:
        RuntimeError: The copy ended without a result.
    """
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        _child(work, write)
    os.close(write)
    with open(read, "rb") as pipe, _limit(child, seconds):
        told = pipe.read()
    _, status = os.waitpid(child, 0)
    if told:
        return json.loads(told)
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
        return None
    raise RuntimeError(f"the tests ended with {status}")


def _child(work: Callable[[], Any], write: int) -> None:
    """Do the work without a word on the screen, and leave nothing behind."""
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    code = 1
    with contextlib.suppress(BaseException):
        told = json.dumps(work()).encode()
        with open(write, "wb") as pipe:
            pipe.write(told)
        code = 0
    os._exit(code)


@contextlib.contextmanager
def _limit(child: int, seconds: float) -> Iterator[None]:
    def end(signum: int, frame: FrameType | None) -> None:
        os.killpg(child, signal.SIGKILL)

    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def tested(tests: Sequence[str]) -> int:
    """Exit code of pytest for these tests, stopped by the first that fails."""
    import pytest

    return int(pytest.main([*tests, "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]))


def tested_with(source: str, module: str, tests: Sequence[str]) -> int:
    """The same with another source of one module of the package."""
    sys.meta_path.insert(0, _Changed(module, source))
    return tested(tests)


class _Changed(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Loads one module from a source in memory."""

    def __init__(self, module: str, source: str) -> None:
        self.module, self.source = module, source

    def find_spec(self, name: str, path: Any, target: ModuleType | None = None) -> Any:
        if name != self.module:
            return None
        file = importlib.util.find_spec(name.rpartition(".")[0])
        folders = file.submodule_search_locations if file is not None else None
        place = Path(*(folders or [])[:1], name.rpartition(".")[2])
        spec = importlib.util.spec_from_loader(name, self, is_package=place.is_dir())
        if spec is not None:
            own = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
            spec.origin, spec.has_location = str(own), True
            if place.is_dir():
                spec.submodule_search_locations = [str(place)]
        return spec

    def get_source(self, fullname: str) -> str:
        return self.source


class Watch:
    """A plug-in of pytest that notes which functions of the package each test enters.

    What a fixture enters counts for every test that uses it, what importing a file of tests enters
    for all of that file, and what a cached function entered when it was computed for whoever asks
    for it again.
    """

    def __init__(self, package: Path) -> None:
        self.package = f"{package}{os.sep}"
        self.of: dict[str, set[str]] = defaultdict(set)
        self.seconds: dict[str, float] = defaultdict(float)
        self.uses: dict[str, list[str]] = {}
        self._now: list[set[str]] = [set()]
        sys.setprofile(self._called)

    def _called(self, frame: FrameType, event: str, arg: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(self.package):
            code = frame.f_code
            self._now[-1].add(f"{code.co_filename[len(self.package) :]}:{code.co_firstlineno}")

    @contextlib.contextmanager
    def _noting(self, name: str) -> Iterator[None]:
        self._now.append(set())
        try:
            yield
        finally:
            self.of[name] |= self._now.pop()

    @contextlib.contextmanager
    def caches(self) -> Iterator[None]:
        """Within it, modules that are imported get caches that note what they hold."""
        kept = functools.lru_cache, functools.cache

        def lru_cache(maxsize: Any = 128, typed: bool = False) -> Any:
            if callable(maxsize):
                return self._noted(maxsize, kept[0]()(maxsize))
            return lambda function: self._noted(function, kept[0](maxsize, typed)(function))

        functools.lru_cache, functools.cache = lru_cache, lru_cache(None)
        try:
            yield
        finally:
            functools.lru_cache, functools.cache = kept

    def _noted(self, function: Any, cached: Any) -> Any:
        name = f"cached {function.__module__}.{function.__qualname__}"

        @functools.wraps(function)
        def asked(*args: Any, **more: Any) -> Any:
            with self._noting(name):
                found = cached(*args, **more)
            self._now[-1] |= self.of[name]
            return found

        asked.cache_clear, asked.cache_info = cached.cache_clear, cached.cache_info  # type: ignore[attr-defined]
        return asked

    def plugin(self) -> Any:
        """The hooks."""
        import pytest

        watch = self

        class Hooks:
            @pytest.hookimpl(wrapper=True)
            def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[None]:
                with watch._noting(f"fixture {fixturedef.argname}"):
                    return (yield)

            @pytest.hookimpl(wrapper=True)
            def pytest_make_collect_report(self, collector: Any) -> Iterator[None]:
                with watch._noting(f"import {getattr(collector, 'path', '')}"):
                    return (yield)

            @pytest.hookimpl(wrapper=True)
            def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> Iterator[None]:
                used = (f"fixture {name}" for name in item.fixturenames)
                watch.uses[item.nodeid] = [f"import {item.path}", *used]
                sys.setprofile(watch._called)
                with watch._noting(item.nodeid):
                    return (yield)

            def pytest_runtest_logreport(self, report: Any) -> None:
                watch.seconds[report.nodeid] += report.duration

        return Hooks()

    def reached(self) -> Reached:
        """Of each test what it entered."""
        return {
            test: {
                "s": self.seconds[test],
                "of": sorted(self.of[test].union(*(self.of[name] for name in used))),
            }
            for test, used in self.uses.items()
        }


def reached(package: Path, tests: Sequence[str]) -> Reached:
    """Which functions of the package the tests of a room enter.

    Raises:
        RuntimeError: Pytest could not collect them; then no bug would be entered by any.
    """
    import pytest

    watch = Watch(package)
    with watch.caches():
        told = pytest.main(
            [*tests, "-q", "-p", "no:cacheprovider", "-p", "no:xdist"], plugins=[watch.plugin()]
        )
    sys.setprofile(None)
    if told not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        raise RuntimeError(f"pytest ended with {told!r}")
    return watch.reached()
