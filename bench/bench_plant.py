"""Estimate for 10 000 campaigns on 16 cores, from the costs measured here.

    T = start + n (each + n/2 notes) / (c e) + n page

with the start of a process, a campaign with its report, reading the note of another campaign (each
run searches for the previous one), and its line in the page over all, which one process draws. All
are CPU seconds. e is the fraction of two cores that `--jobs 2` used, from the rows kept by `python
-m bench jobs`, and 1 without them.
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from bench import bench_jobs
from pipeline.answer.archive import read
from pipeline.fleet import pages
from pipeline.fleet.history import earlier
from pipeline.run import run as run_one
from pipeline.store.campaign import every

CAMPAIGNS, CORES = 10_000, 16
FEW = 6
"""Number of campaigns that are computed here."""
START = """
import time, pipeline.run, pipeline.report.figures.catalogue
print(time.process_time())
"""


@dataclass(frozen=True)
class Cost:
    """CPU times [s].

    Attributes:
        start: Of a process with its libraries.
        each: Of a campaign with its report.
        note: Of reading the note of one other campaign.
        page: Of a campaign in the page over all, if nothing is drawn.
    """

    start: float
    each: float
    note: float
    page: float

    def minutes(self, campaigns: int, cores: int, share: float) -> float:
        """Time for a number of campaigns on a number of cores [min]."""
        shared = campaigns * (self.each + campaigns / 2 * self.note) / (cores * share)
        return (self.start + shared + campaigns * self.page) / 60


def run() -> Iterator[tuple[str, float, str]]:
    """The costs, and the estimate."""
    cost, share = measured(), _share()
    yield "start of a process [s]", cost.start, "once for each core"
    yield "a campaign with its report [s]", cost.each, "the demo"
    yield "a look at another's note [ms]", 1e3 * cost.note, "as often as there are others"
    yield "a line of the page over all [ms]", 1e3 * cost.page, "in one process"
    whole = cost.minutes(CAMPAIGNS, CORES, share)
    said = f"{CAMPAIGNS} campaigns, {CORES} cores; each core used {share:.2f}"
    yield "all of them, on paper [min]", whole, said


def measured() -> Cost:
    """Costs here, from `FEW` copies of the demo."""
    said = subprocess.run(
        [sys.executable, "-c", START], cwd=bench_jobs.PROJECT, check=True, capture_output=True
    )
    with bench_jobs.project(FEW + 1) as root:
        first, *others = every(root)
        run_one(first)  # includes loading the libraries
        each = [_seconds(lambda one=one: run_one(one)) for one in others]
        pages.refresh(root)
        page = _seconds(lambda: pages.refresh(root)) / (FEW + 1)
        note = _look(root)
    return Cost(float(said.stdout), sum(each) / FEW, note, page)


def _look(root: Path, count: int = 300) -> float:
    """CPU time per further campaign whose note is read [s]; none of them is the previous one."""
    first = every(root)[0]
    answer = read(first).model_copy(update={"measured": "1990-01-01"})
    few = _seconds(lambda: earlier(first, answer))
    for k in range(count):
        for made in (first.processed / "manifest.json", first.reports / "result.json"):
            copy = made.parent.with_name(f"more{k}") / made.name
            copy.parent.mkdir(exist_ok=True)
            shutil.copy(made, copy)
    return max(_seconds(lambda: earlier(first, answer)) - few, 0.0) / count


def _seconds(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def _share() -> float:
    rows = [row for row in bench_jobs.kept().values() if row.jobs == 2]
    if not rows:
        return 1.0
    return sum(row.processor_s for row in rows) / sum(2 * row.wall_s for row in rows)
