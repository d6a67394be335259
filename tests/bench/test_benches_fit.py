"""What a bench calls is there: most of them run for minutes, some once in a release."""

import importlib
from pathlib import Path

import pytest

pytestmark = pytest.mark.whole

BENCH = Path(__file__).parents[2] / "bench"
ELSEWHERE = {"foreign", "games"}
"""Folders whose files need other tools, or are kept as they were played."""
FILES = [
    path.relative_to(BENCH.parent).with_suffix("")
    for path in sorted(BENCH.rglob("*.py"))
    if path.stem != "__main__" and not ELSEWHERE & set(path.parts)
]


@pytest.mark.parametrize("file", FILES, ids=str)
def test_what_a_bench_imports_is_there(file):
    importlib.import_module(".".join(file.parts))
