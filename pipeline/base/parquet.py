"""Tables as Parquet, read and written on the calling thread alone.

A thread of Arrow that still holds memory or a file of Python's when the interpreter ends has to
ask for its lock, and aborts the process (exit code 134, apache/arrow issue 34314). Our tables are
small: nothing is gained by threads.
"""

from __future__ import annotations

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.base import files


def read(path: Path) -> pa.Table:
    """The table of a Parquet file.

    Raises:
        OSError: No such file, or one that cannot be read.
        pa.ArrowInvalid: No Parquet.
    """
    with pq.ParquetFile(pa.BufferReader(path.read_bytes()), pre_buffer=False) as opened:
        return opened.read(use_threads=False)


def write(path: Path, table: pa.Table) -> None:
    """Replace the Parquet file at `path` in one step.

    Raises:
        CannotWrite: The disk refuses.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    files.write(path, bytes(sink.getvalue()))


def begins_and_ends(path: Path) -> bool:
    """Whether a file looks like a whole Parquet file: one that was cut has another end."""
    try:
        with path.open("rb") as opened:
            if os.fstat(opened.fileno()).st_size < 3 * len(_MAGIC):
                return False
            begin = opened.read(len(_MAGIC))
            opened.seek(-len(_MAGIC), os.SEEK_END)
            return begin == opened.read() == _MAGIC
    except OSError:
        return False


_MAGIC = b"PAR1"
"""First and last bytes of a Parquet file (its format, version 2)."""
