"""Speed of `pipeline run --jobs 2` compared with one process, for copies of the demo campaign.

Both are measured in rounds, in turn, so that other load on the machine favours neither.
Measurements are kept in `KEPT`, and an interrupted run is continued; rows of other code or of
another number of campaigns do not count.
"""

import hashlib
import json
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from pipeline.app.shell import run_all
from pipeline.service.executor import InProcesses
from pipeline.service.many import outcomes
from pipeline.store.campaign import code_version

PROJECT = Path(__file__).parents[1]
DEMO = PROJECT / "data" / "raw" / "kr500_demo"
KEPT = PROJECT / "reports" / "bench-jobs.jsonl"
CAMPAIGNS = int(os.environ.get("JOBS_CAMPAIGNS", "40"))
"""Total number of campaigns; a smaller one for a first look."""
ROUNDS = 4
JOBS = (1, 2)


@dataclass(frozen=True)
class Row:
    """One round with one number of processes.

    Attributes:
        code: Hash of the package.
        round: Number of the round.
        jobs: Number of processes.
        campaigns: Number of copies of the demo.
        wall_s: Time until all were done, including the start of the processes [s].
        processor_s: CPU time of all processes [s].
        answers: Hash of the answers, apart from the names of the campaigns.
    """

    code: str
    round: int
    jobs: int
    campaigns: int
    wall_s: float
    processor_s: float
    answers: str


@contextmanager
def project(count: int) -> Iterator[Path]:
    """A project with a number of copies of the demo."""
    with tempfile.TemporaryDirectory() as name:
        for k in range(count):
            shutil.copytree(DEMO, Path(name) / "data" / "raw" / f"c{k:03d}")
        yield Path(name)


def run() -> Iterator[tuple[str, float, str]]:
    """Time of one process over that of two, and whether they give the same answers."""
    rows = {jobs: [_row(number, jobs) for number in range(ROUNDS)] for jobs in JOBS}
    wall = {jobs: sum(row.wall_s for row in mine) for jobs, mine in rows.items()}
    used = {jobs: sum(row.processor_s for row in mine) / wall[jobs] for jobs, mine in rows.items()}
    said = f"{wall[1]:.0f} s and {wall[2]:.0f} s for {_each() * ROUNDS} campaigns"
    cores = f"cores used {used[1]:.2f} and {used[2]:.2f} of {os.cpu_count()}"
    yield "one process / --jobs 2, time", wall[1] / wall[2], f"at most 2; {said}; {cores}"
    kinds = {row.answers for mine in rows.values() for row in mine}
    yield "different answers", len(kinds) - 1, "of all copies, whoever computed them; 0 is right"


def _each() -> int:
    return max(CAMPAIGNS // ROUNDS, 1)


def _row(number: int, jobs: int) -> Row:
    """A round, measured unless it is kept, after those that precede it."""
    for before in range(number + 1):
        for engine in JOBS:
            if (before, engine) not in kept():
                _keep(_measured(before, engine))
            if (before, engine) == (number, jobs):
                break
    return kept()[number, jobs]


def _measured(number: int, jobs: int) -> Row:
    with project(_each()) as root:
        began, used = time.perf_counter(), _processor_s()
        done = list(run_all(root, [], "local", False, partial(outcomes, InProcesses(jobs))))
        wall, used = time.perf_counter() - began, _processor_s() - used
        said = {_answer(root, one.campaign) for one in done}
    assert len(done) == _each()
    digest = hashlib.sha256("\n".join(sorted(said)).encode()).hexdigest()
    return Row(code_version(), number, jobs, _each(), wall, used, digest)


def _answer(root: Path, name: str) -> str:
    text = (root / "reports" / name / "result.json").read_text("utf-8")
    return text.replace(f'"{name}"', '"c"')


def _processor_s() -> float:
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def _keep(row: Row) -> None:
    KEPT.parent.mkdir(exist_ok=True)
    with KEPT.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(row)) + "\n")


def kept() -> dict[tuple[int, int], Row]:
    """Rows of this code, without an incomplete last line."""
    lines = KEPT.read_text("utf-8").splitlines() if KEPT.is_file() else []
    whole = (Row(**json.loads(line)) for line in lines if line.endswith("}"))
    now = (code_version(), _each())
    return {(row.round, row.jobs): row for row in whole if (row.code, row.campaigns) == now}
