"""Rows of a plain table: cells between commas, every number as programs write it, every row whole.

Anything else (other delimiters, quotes, units behind numbers, remarks, rows that are none) is read
by `dialects`, which also says what is wrong with it.
"""

from __future__ import annotations

import string

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from pipeline.readers import _iso
from pipeline.readers._layout import Field, Layout, TypedRows
from pipeline.readers._text import Text

_BYTES = f"{string.ascii_letters}{string.digits}_.:,- \r\n".encode()
"""Bytes of a plain table."""
_BLOCK = 1 << 22
"""Block size for Arrow [byte], many times the longest line."""
LARGEST_NUMBER = 1e30
"""Largest magnitude accepted for a number in a file [1]: no unit makes a coordinate in a factory
hall this large, and its square is still finite."""
_TYPES = {
    "name": pa.dictionary(pa.int32(), pa.string()),  # the same ones come often
    "number": pa.float64(),
    "time": pa.string(),
}
"""Arrow type of cells by kind; cells of other kinds are skipped."""


def is_plain(text: Text) -> bool:
    """Whether a file has none but the characters of a plain table, and its last line is whole."""
    if not text.ended() or text.data.translate(None, _BYTES):
        return False
    return not any(edge in text.data for edge in (b", ", b" ,", b"\n ", b" \n", b" \r"))


def plain_rows(text: Text, layout: Layout) -> TypedRows | None:
    """All rows from line `layout.first` on; None unless every one of them is as it should be."""
    fields = {str(k): one for k, one in enumerate(layout.fields)}
    types = {k: _TYPES[one.kind] for k, one in fields.items() if one.kind in _TYPES}
    try:
        table = csv.read_csv(
            pa.BufferReader(_body(text, layout.first)),
            csv.ReadOptions(
                column_names=[*fields], block_size=_BLOCK, use_threads=len(text.data) > _BLOCK
            ),
            csv.ParseOptions(quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                column_types=types,
                include_columns=[*types],
                null_values=[""],
                strings_can_be_null=False,
                check_utf8=False,
            ),
        )
        columns = {
            fields[k].name: _whole(column.unify_dictionaries().combine_chunks(), fields[k])
            for k, column in zip(table.column_names, table.columns, strict=True)
        }
    except pa.ArrowInvalid:
        return None
    line = np.arange(layout.first, layout.first + len(table))
    return TypedRows(columns, line, np.arange(1, len(line) + 1), ())


def _whole(column: pa.Array, field: Field) -> pa.Array:
    """The values of a column.

    Raises:
        pa.ArrowInvalid: One is missing or no number or time.
    """
    if field.kind == "name":
        filled = not field.needed or "" not in column.dictionary.to_pylist()
    elif field.kind == "number":
        largest = pc.max(pc.abs(column)).as_py()
        filled = not (field.needed and column.null_count)
        filled = filled and (largest is None or largest <= LARGEST_NUMBER)
        filled = filled and not pc.any(pc.is_nan(column)).as_py()
    else:
        cells, column = column, _iso.possible(_iso.at_once(column))
        filled = column.null_count == (0 if field.needed else pc.sum(pc.equal(cells, "")).as_py())
    if not filled:
        raise pa.ArrowInvalid("a cell is missing")
    return column


def _body(text: Text, first: int) -> pa.Buffer:
    """The lines from `first` on.

    They are copied into memory owned by Arrow: one of its threads that releases a Python object
    during interpreter shutdown aborts the process (apache/arrow issue 34314).
    """
    begin = int(text.starts[first - 1])
    body = pa.allocate_buffer(len(text.data) - begin)
    with pa.FixedSizeBufferWriter(body) as into:
        into.write(memoryview(text.data)[begin:])
    return body
