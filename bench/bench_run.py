"""Whole processes: what a user waits for, over what Python itself needs for its libraries."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.timing import ratio, seconds

PROJECT = Path(__file__).parents[1]
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
        return [
            (
                f"pipeline {name} / bare",
                1 / ratio(work, against, runs=5),
                f"{seconds(work):.2f} s; bare: {'imports' if against is bare else 'empty Python'}",
            )
            for name, work, against in rows
        ]


def _pipeline(*arguments: str):
    return _python("-m", "pipeline", *arguments)


def _python(*arguments: str):
    def work() -> None:
        subprocess.run([sys.executable, *arguments], cwd=PROJECT, check=True, capture_output=True)

    return work
