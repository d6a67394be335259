"""A campaign of a service in a process of its own: what it may take, and what its end costs."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from bench.bench_kill import PLAN
from pipeline.library.preferences import Service
from pipeline.service.guard import Guard
from pipeline.service.processes import alive
from pipeline.simulate import simulate
from pipeline.store import campaign as campaigns


@pytest.fixture
def root(tmp_path):
    """A project with two campaigns."""
    files = simulate(PLAN).files
    for name in ("a", "b"):
        folder = tmp_path / "data" / "raw" / name
        folder.mkdir(parents=True)
        for file, content in files.items():
            (folder / file).write_bytes(content)
    return tmp_path


def limits(**wanted):
    """Limits that nobody could ask for, so that a small campaign meets them."""
    return Service.model_construct(**Service().model_dump() | wanted)


EARLIER: set[int] = set()
"""Processes that other tests of this worker have left, such as the tracker of multiprocessing."""


@pytest.fixture(autouse=True)
def only_own_children():
    EARLIER.clear()
    EARLIER.update(children())


def children():
    """Processes that this test has started and that still run."""
    text = Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}/children").read_text()
    return {int(number) for number in text.split()} - EARLIER


@pytest.mark.slow
def test_a_guarded_run_is_a_run(root):
    """One process for both campaigns, the same answer on disk, and nothing left behind."""
    with Guard(root, "local", Service()) as guard:
        made = [guard.campaign(one) for one in campaigns.every(root)]
        [worker] = children()
        assert guard.pages() is None

    assert [(one.campaign, one.exit_code) for one in made] == [("a", 0), ("b", 0)]
    assert made[0].content == campaigns.find(root, "a").result()
    assert (root / "reports" / "index.html").is_file()
    assert not alive(worker)


def test_a_campaign_without_end_is_given_up(root):
    """It is ended at its limit with all that it had."""
    first, _ = campaigns.every(root)
    with Guard(root, "local", limits(limit_s=0.5)) as guard:
        began = time.monotonic()
        slow = guard.campaign(first)
        took = time.monotonic() - began

    assert took < 5
    assert (slow.exit_code, slow.verdict) == (6, None)
    assert slow.complaints == [
        "a: not finished after 0.5 s, the limit for one campaign; look for what is too large in "
        "its files, or raise limit_s in pipeline.toml."
    ]
    assert not children()


def test_a_campaign_without_measure_is_given_up(root):
    """It gets no more memory than it may have."""
    first, _ = campaigns.every(root)
    with Guard(root, "local", limits(memory_gib=0.25)) as guard:
        large = guard.campaign(first)

    assert large.exit_code == 6
    assert "memory" in large.complaints[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "said"),
    [(signal.SIGKILL, "was killed"), (signal.SIGSEGV, "crashed (SIGSEGV)")],
)
def test_a_process_that_ends_costs_its_own_campaign(root, number, said):
    """Killed by the system or crashed in a library: one campaign failed, the next is worked at."""
    first, second = campaigns.every(root)

    def strike():
        while not (worker := children_of(os.getpid())):
            time.sleep(0.01)
        time.sleep(0.2)
        os.kill(worker[0], number)

    with Guard(root, "local", Service()) as guard:
        threading.Thread(target=strike).start()
        struck = guard.campaign(first)
        next_one = guard.campaign(second)

    assert struck.exit_code == 6
    assert said in struck.complaints[0]
    assert next_one.exit_code == 0


def children_of(process):
    """Processes whose parent is this one."""
    out = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(stat.read_text().rpartition(")")[2].split()[1]) == process:
                out.append(int(stat.parent.name))
        except OSError:  # gone by now
            continue
    return out


@pytest.mark.slow
def test_a_process_is_replaced_after_some_campaigns(root):
    """So that what a library never gives back is given back."""
    one = campaigns.every(root)[0]
    seen = set()
    with Guard(root, "local", Service()) as guard:
        for _ in range(9):
            guard.campaign(one)
            seen |= children()

    assert len(seen) == 2
