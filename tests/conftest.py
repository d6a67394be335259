"""Fixtures: campaigns with known truth."""

from __future__ import annotations

import contextlib
import gc
import importlib
import signal
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:  # each worker imports the pipeline with the tests, and who starts them never
    from pipeline.reduction.bring import Reduced
    from pipeline.simulate import Plan, RawCampaign

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # a shell's background job ignores Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)  # and its children would do so too

SEED = 20261103
_AT_ONCE = 20
"""Number of tests that a worker is given at once, unless they share a fixture."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """Let each worker import the tests in another order, and look for no garbage in them.

    In a fresh clone pytest compiles them, which takes ten seconds, and keeps the result: each
    worker reads a part from the others. Import errors are reported at collection. What is imported
    and collected stays to the end: looking through it would take a fifth of the time.
    """
    gc.disable()
    told = getattr(session.config, "workerinput", None)
    if told is not None and session.config.args == session.config.getini("testpaths"):
        _import_all(int(told["workerid"].removeprefix("gw")) / told["workercount"])
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_unconfigure() -> None:
    """Let the interpreter clear at its end what was frozen, or nanobind reports it as leaked."""
    gc.unfreeze()


def _import_all(part: float) -> None:
    """Import the tests, beginning after this part of them."""
    files = sorted(Path(__file__).parent.rglob("test_*.py"))
    first = int(part * len(files))
    for file in files[first:] + files[:first]:
        sys.path.insert(0, str(file.parent))
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(file.stem)
        sys.path.remove(str(file.parent))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run tests that share a module's fixture in one worker, and start such groups first.

    Otherwise each worker builds every fixture of a module, and a long group that starts last keeps
    one worker busy while the others idle. The others are handed out by some of a file: after each
    test pytest-xdist counts all that were handed out.
    """
    _sample(items)
    if not hasattr(config, "workerinput"):
        return
    alone, of_file = set[pytest.Item](), Counter[str]()
    for item in items:
        if item.get_closest_marker("xdist_group") is not None:
            continue
        group = item.path.stem
        if not _shares(item):
            alone.add(item)
            group += f"+{of_file[group] // _AT_ONCE}"
            of_file[item.path.stem] += 1
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=alone.__contains__)


def _sample(items: list[pytest.Item]) -> None:
    """Of a test marked `sampled(n)`, all but n are slow: variants that differ little."""
    variants: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled") is not None and not item.get_closest_marker("slow"):
            variants[item.nodeid.partition("[")[0]].append(item)
    for each in variants.values():
        for item in _unlike(each)[1]:
            item.add_marker(pytest.mark.slow)


def _unlike(items: list[pytest.Item]) -> tuple[list[pytest.Item], list[pytest.Item]]:
    """As many variants of a test as its mark says, and the rest.

    Each is the first with the most parameters that none before it has: with two seeds and two
    kinds, two variants are one of each kind, not two seeds of the first.
    """
    few = next(items[0].iter_markers("sampled")).args[0]
    left, taken, seen = list(items), list[pytest.Item](), set[tuple[str, int]]()
    for _ in range(min(few, len(left))):
        taken.append(max(left, key=lambda item: len(_values(item) - seen)))
        seen |= _values(taken[-1])
        left.remove(taken[-1])
    return taken, left


def _values(item: pytest.Item) -> set[tuple[str, int]]:
    """Name of each parameter of a variant, and which of its values it has, by identity.

    `callspec.indices` would be the number of the variant.
    """
    call = getattr(item, "callspec", None)  # nothing public tells
    return {(name, id(value)) for name, value in call.params.items()} if call else set()


def _shares(item: pytest.Item) -> bool:
    """Whether a test uses a module-scoped fixture."""
    known = item._fixtureinfo.name2fixturedefs  # type: ignore[attr-defined]  # nothing public tells
    return any(one.scope == "module" for found in known.values() for one in found)


@contextlib.contextmanager
def without_pages() -> Iterator[None]:
    """Runs in this process leave blank pages: drawing takes two thirds of a run on a few poses."""
    with pytest.MonkeyPatch.context() as patch:
        blank = {"index.html": b"", "report.pdf": b""}
        patch.setattr("pipeline.run.render", lambda *_: blank)
        yield


@contextlib.contextmanager
def without_drawings() -> Iterator[None]:
    """Runs in this process leave pages and PDFs with blank figures, but for those drawn by hand.

    Matplotlib takes three quarters of a report; tests of its words do not need it.
    """
    from pipeline.report.svg import by_hand  # importing matplotlib takes half a second

    blank = by_hand('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.figures.catalogue.drawn", lambda *_: blank)
        yield


@contextlib.contextmanager
def with_little_effort() -> Iterator[None]:
    """`pipeline design` in this process finds a feasible plan, not necessarily the best."""
    from pipeline.design.search import Effort

    little = Effort(first=0, rounds=1, poses=48, settled=6, exchanged=2, bounds=2, directions=16)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.design.search.Effort", lambda **said: replace(little, **said))
        yield


@pytest.fixture
def unseen() -> Iterator[None]:
    """A test `without_pages`."""
    with without_pages():
        yield


@pytest.fixture(scope="session")
def small_plan() -> Plan:
    """Seven poses, two load steps up and one down: enough for every joint, quick to compute."""
    from pipeline.simulate import Plan

    return Plan(
        name="small", seed=SEED, poses={"count": 7}, pulls={"steps_n": [1500.0, 3000.0, 2000.0]}
    )


@pytest.fixture(scope="session")
def small_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` with 0.03 mm of noise."""
    from pipeline.simulate import simulate

    return simulate(small_plan)


@pytest.fixture(scope="session")
def exact_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` without noise, all digits written."""
    from pipeline.simulate import simulate

    return simulate(small_plan.without_noise())


@pytest.fixture(scope="session")
def read_back() -> Callable[[RawCampaign], Reduced]:
    """From a simulated campaign's files to forces and displacements, by the steps of the run."""
    from bench.reduced import reduce
    from pipeline.reduction.bring import conformed
    from pipeline.store.campaign import in_memory

    def through_the_stages(campaign: RawCampaign) -> Reduced:
        raw = in_memory(campaign.files)
        return reduce(raw, conformed)

    return through_the_stages
