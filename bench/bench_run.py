"""Whole processes: waiting time of a user, relative to the time Python needs for its libraries."""

import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.timing import ratio, seconds

PROJECT = Path(__file__).parents[1]
STAGES = """
import sys, time
from pathlib import Path
from pipeline.run import answered, render
from pipeline.store.campaign import find
at = [0.0, time.process_time()]
found = answered("kr500_demo", find(Path(sys.argv[1]), "kr500_demo").read())
at.append(time.process_time())
render(found.answer, found.shown, 1.0)
at.append(time.process_time())
print(*(after - before for before, after in zip(at, at[1:])))
"""
"""Python and imports; from files to numbers; page, PDF and figures: in one process, in this
order."""
NAMES = ("start and imports", "files to numbers", "report beyond the numbers")
LIBRARIES = "import numpy, scipy.special, pandas, pyarrow.parquet, matplotlib.figure, typst"


def run() -> list[tuple[str, float, str]]:
    """Ratios, with the time of one process."""
    with tempfile.TemporaryDirectory() as root:
        shutil.copytree(PROJECT / "data/raw/kr500_demo", Path(root) / "data/raw/kr500_demo")
        asked = ["run", "kr500_demo", "--engine", "local", "--root", root]
        bare = _python("-c", LIBRARIES)
        rows = [
            ("run --engine local, everything computed", _pipeline(*asked, "--force"), bare),
            ("run --engine local, nothing changed", _pipeline(*asked), bare),
            ("--help", _pipeline("--help"), _python("-c", "pass")),
        ]
        timed = [
            (
                f"pipeline {name} / bare",
                1 / ratio(work, against, runs=5),
                f"{seconds(work):.2f} s; bare: {'imports' if against is bare else 'empty Python'}",
            )
            for name, work, against in rows
        ]
        return [*timed, *_stages(root)]


def _stages(root: str) -> list[tuple[str, float, str]]:
    """CPU time of each stage of a run [s], median of five and minimum."""
    runs = []
    for _ in range(5):
        said = subprocess.run(
            [sys.executable, "-c", STAGES, root],
            cwd=PROJECT,
            check=True,
            capture_output=True,
            text=True,
        )
        runs.append([float(x) for x in said.stdout.split()])
    return [
        (f"{name} [s of processor]", statistics.median(times), f"least {min(times):.2f} s")
        for name, times in zip(NAMES, zip(*runs, strict=True), strict=True)
    ]


def _pipeline(*arguments: str):
    return _python("-m", "pipeline", *arguments)


def _python(*arguments: str):
    def work() -> None:
        subprocess.run([sys.executable, *arguments], cwd=PROJECT, check=True, capture_output=True)

    return work
