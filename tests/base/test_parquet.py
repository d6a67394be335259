"""Parquet on the calling thread only."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pipeline.base import parquet
from pipeline.dialects import _cut
from pipeline.readers import _text

ONE_THREAD = """
import os, sys
from pathlib import Path
import pyarrow as pa
from pipeline.base import parquet

path = Path(sys.argv[1])
before = len(os.listdir("/proc/self/task"))
parquet.write(path, pa.table({"a": [1.5, 2.5], "b": ["x", "y"], "c": [None, 3]}))
parquet.read(path)
print(len(os.listdir("/proc/self/task")) - before)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted by Linux")
def test_a_table_is_written_and_read_without_a_thread_left_at_exit(tmp_path):
    """No Arrow thread is active when the interpreter ends, so that none can abort it."""
    asked = [sys.executable, "-c", ONE_THREAD, str(tmp_path / "table.parquet")]
    done = subprocess.run(asked, capture_output=True, text=True, check=True)

    assert done.stdout.strip() == "0"


def test_a_table_is_read_as_it_was_written(tmp_path):
    """Texts, numbers, empty cells and metadata are restored."""
    schema = pa.schema(
        [pa.field("name", pa.string(), metadata={"unit": "1"}), pa.field("x_m", pa.float64())]
    )
    table = pa.table({"name": ["a", None], "x_m": [0.1, float("nan")]}, schema)
    parquet.write(tmp_path / "table.parquet", table)
    back = parquet.read(tmp_path / "table.parquet")

    assert back.schema.equals(schema, check_metadata=True)
    assert back["name"].to_pylist() == ["a", None]
    assert back["x_m"].to_pylist()[0] == 0.1


@pytest.mark.parametrize("special", [(), (1,), (0, 1, 3)], ids=["none", "one", "several"])
def test_arrow_cuts_lines_in_memory_of_its_own(special):
    """No Arrow thread refers to the bytes of a file, which belong to Python."""
    lines = ["a,1\n", "# two\n", "b,2\n", "\n", "c,3"]
    text = _text.text("some.csv", "".join(["title\n", *lines]).encode())
    held = sys.getrefcount(text.data)
    left_out = np.isin(np.arange(len(lines)), special)
    body = _cut._body(text, 2, left_out)
    now = sys.getrefcount(text.data)  # an assert would refer to it, too

    assert bytes(body).decode() == "".join(np.array(lines)[~left_out])
    assert now == held
