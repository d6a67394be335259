"""kill -9 at random moments of a run, then a second run: is result.json unaffected?"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.base import files
from pipeline.service import server as service
from pipeline.service import supervisor
from pipeline.service.processes import PYTHON
from pipeline.simulate import Plan, simulate

KILLS = 100
PORT = 24900
"""Port of Prefect's server."""
PLAN = Plan(name="killed", poses={"count": 7}, pulls={"steps_n": [3000.0]})
"""A small campaign, so that a hundred runs take minutes; it produces all kinds of files."""
WORKER = """
import os, signal, sys, time
from pathlib import Path
import pipeline.report.figures.catalogue
from pipeline.store.campaign import find
if sys.argv[2] == "prefect":
    from pipeline.service.flow import identified as run
else:
    from pipeline.run import run

root = Path(sys.argv[1])
for line in sys.stdin:
    delay = float(line)
    child = os.fork()
    if child == 0:
        run(find(root, "killed"), force=delay >= 0)
        os._exit(0)
    if delay >= 0:
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    print(status, flush=True)
"""


class Victim:
    """A campaign and a process whose children run it."""

    def __init__(self, root: Path, plan: Plan, engine: str = "local") -> None:
        """Write the campaign's raw files and start the process."""
        self.root = root
        folder = root / "data" / "raw" / "killed"
        folder.mkdir(parents=True)
        for name, content in simulate(plan).files.items():
            (folder / name).write_bytes(content)
        self.worker = subprocess.Popen(
            [sys.executable, "-c", WORKER, str(root), engine],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "Victim":
        return self

    def __exit__(self, *_: object) -> None:
        self.worker.communicate()

    def run(self, killed_after_s: float = -1.0) -> int:
        """Run to the end, or be killed during the run; return the child's wait status."""
        assert self.worker.stdin
        assert self.worker.stdout
        self.worker.stdin.write(f"{killed_after_s}\n")
        self.worker.stdin.flush()
        return int(self.worker.stdout.readline())

    @property
    def result(self) -> bytes:
        """Its result.json."""
        return (self.root / "reports" / "killed" / "result.json").read_bytes()

    @property
    def leftovers(self) -> list[Path]:
        """Half-written files, which the next command that updates campaigns removes."""
        return files.leftovers(self.root)


def survived(victim: Victim, moments: Iterable[float]) -> Iterator[tuple[int, bool]]:
    """For each moment, as fraction of a full run: wait status, and whether all is unaffected.

    The killed run cannot reuse any earlier results.
    """
    victim.run()  # the first run on a machine takes longest
    whole = victim.result
    (victim.root / "data" / "processed" / "killed" / "manifest.json").unlink()
    began = time.perf_counter()
    victim.run()
    usual = time.perf_counter() - began
    for moment in moments:
        status = victim.run(moment * usual)
        again = victim.run()
        yield status, again == 0 and victim.result == whole


@contextlib.contextmanager
def server(root: Path, engine: str) -> Iterator[None]:
    """Prefect's server as started by `serve`, for flows; none for plain runs."""
    if engine == "local":
        yield
        return
    before = dict(os.environ)
    urls = supervisor.settled(root, PORT)
    process = subprocess.Popen([*PYTHON, "pipeline.service.gate", str(root / "reports"), str(PORT)])
    try:
        while not service.answers(urls["api"]):
            time.sleep(0.3)
        yield
    finally:
        process.terminate()
        process.wait()
        os.environ.clear()
        os.environ.update(before)


def run() -> list[tuple[str, float, str]]:
    """Fraction of killed runs after which the next one gives the same answer, byte by byte."""
    return [_killed(engine) for engine in ("local", "prefect")]


def _killed(engine: str) -> tuple[str, float, str]:
    rng = np.random.default_rng(9)
    hit = same = tried = 0
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        server(Path(folder), engine),
        Victim(Path(folder), PLAN, engine) as one,
    ):
        for status, good in survived(one, iter(rng.uniform, None)):
            tried, hit, same = tried + 1, hit + (status == 9), same + good
            print(f"\r  {hit} of {KILLS} killed, {tried - same} unlike", end="", flush=True)
            if hit == KILLS:
                break
    print()
    comment = f"aim 1; {hit} were killed in the middle, {tried - hit} had ended before"
    return f"{engine}: killed, run again, result.json identical", same / tried, comment
