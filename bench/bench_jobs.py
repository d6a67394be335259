"""`pipeline run --jobs 2` beside one process: how much sooner are copies of the demo done?"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.timing import seconds
from pipeline.app.shell import run_all
from pipeline.base.executor import Processes

DEMO = Path(__file__).parents[1] / "data" / "raw" / "kr500_demo"
CAMPAIGNS = int(os.environ.get("JOBS_CAMPAIGNS", "40"))
"""How many; another number for a first look."""


@contextmanager
def project() -> Iterator[Path]:
    """A project with so many copies of the demo."""
    with tempfile.TemporaryDirectory() as name:
        for k in range(CAMPAIGNS):
            shutil.copytree(DEMO, Path(name) / "data" / "raw" / f"c{k:02d}")
        yield Path(name)


def run() -> Iterator[tuple[str, float, str]]:
    """Time of one process over that of two; their start counts."""
    took = [_seconds(Processes(number)) for number in (1, 2)]
    said = f"{took[0]:.0f} s and {took[1]:.0f} s for {CAMPAIGNS} campaigns, {os.cpu_count()} cores"
    yield "one process / --jobs 2, time", took[0] / took[1], f"at most 2; {said}"


def _seconds(executor: Processes) -> float:
    with project() as root:
        return seconds(lambda: list(run_all(root, [], "local", False, executor)))
