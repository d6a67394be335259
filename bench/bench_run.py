"""Whole processes: what a user waits for, over what Python itself needs for its libraries."""

import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.timing import ratio, seconds

PROJECT = Path(__file__).parents[1]
REPORT = """
import sys, time
from pathlib import Path
from pipeline.answer.archive import finished, shown
one, = finished(Path(sys.argv[1]))
tables = shown(one.campaign)
wall, processor = time.perf_counter(), time.process_time()
from pipeline.report.render import render
render(one.answer, tables)
print(time.perf_counter() - wall, time.process_time() - processor)
"""
"""Page, PDF and figures from finished numbers, in a process that has drawn nothing before."""
LIBRARIES = "import numpy, scipy.special, pandas, pyarrow.parquet, matplotlib.figure, typst"


def run() -> list[tuple[str, float, str]]:
    """Ratios, with the seconds of one process beside them."""
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
        return [*timed, _report(root)]


def _report(root: str) -> tuple[str, float, str]:
    """Seconds of processor that a report takes beyond the numbers, the middle of five."""
    runs = []
    for _ in range(5):
        said = subprocess.run(
            [sys.executable, "-c", REPORT, root],
            cwd=PROJECT,
            check=True,
            capture_output=True,
            text=True,
        )
        runs.append([float(x) for x in said.stdout.split()])
    wall, processor = (statistics.median(times) for times in zip(*runs, strict=True))
    return ("report beyond the numbers [s of processor]", processor, f"wall {wall:.2f} s")


def _pipeline(*arguments: str):
    return _python("-m", "pipeline", *arguments)


def _python(*arguments: str):
    def work() -> None:
        subprocess.run([sys.executable, *arguments], cwd=PROJECT, check=True, capture_output=True)

    return work
