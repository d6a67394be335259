"""Tables as Parquet, read and written on the calling thread only.

An Arrow thread that still holds memory or a file of Python's when the interpreter ends must acquire
its lock, and aborts the process (exit code 134, apache/arrow issue 34314). Our tables are small:
threads would gain nothing.
"""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.base import files


def read(path: Path) -> pa.Table:
    """Read the table of a Parquet file.

    Raises:
        OSError: No such file, or it cannot be read.
        pa.ArrowInvalid: Not Parquet.
    """
    with pq.ParquetFile(pa.BufferReader(path.read_bytes()), pre_buffer=False) as opened:
        return opened.read(use_threads=False)


def write(path: Path, table: pa.Table) -> None:
    """Replace the Parquet file at `path` atomically.

    Raises:
        CannotWrite: The file system refuses.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    files.write(path, bytes(sink.getvalue()))
