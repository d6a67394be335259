"""Split lines into cells: all rows at once with Arrow, or one by one if any is damaged or quoted.

Both split at the delimiters only; the second way also handles quotation marks and says which row
has too few or too many cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from pipeline.base.arrays import Bools, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.dialects._cells import BadCell, cells, is_special
from pipeline.readers._layout import JOINT, Layout
from pipeline.readers._text import Text

_BLOCK = 1 << 22
"""Block size for Arrow [byte], many times the longest line."""
_BLANK = bytes({c.encode()[0] for c in map(chr, range(0x3001)) if c.isspace()})
"""First bytes of the UTF-8 encodings of all white space."""
_TYPES = {
    "name": pa.dictionary(pa.int32(), pa.string()),  # the same ones come often
    **dict.fromkeys(("number", "time", "blank"), pa.string()),
}
"""Arrow type of cells by kind; cells of other kinds are skipped."""


@dataclass(frozen=True, eq=False)
class _Cut(Locked):
    """Rows with the expected number of cells.

    Attributes:
        columns: Cells of each field that is read, names as dictionaries, others as text; not yet
            stripped of surrounding blanks.
        line: Line number of each row, shape (n,).
        rejected: Line and reason of the other rows.
    """

    columns: list[pa.Array]
    line: Ints
    rejected: tuple[tuple[int, str], ...] = ()


def cut(text: Text, layout: Layout) -> _Cut:
    """Split all rows from line `layout.first` on; blank lines and comments are skipped."""
    special = _special(text, layout)
    line = np.arange(layout.first, len(text) + 1)[~special]
    columns = None if b'"' in text.data or not len(line) else _at_once(text, layout, special)
    return _each(text, layout, line) if columns is None else _Cut(columns, line)


def _special(text: Text, layout: Layout) -> Bools:
    """Whether lines from the first row on are blank or comments, shape (lines,)."""
    first = np.frombuffer(text.data, dtype=np.uint8)[text.starts[layout.first - 1 : -1]]
    may_be = np.zeros(256, dtype=bool)
    may_be[[*_BLANK, *(layout.comment or "").encode()[:1]]] = True
    special: Bools = may_be[first]
    for k in np.flatnonzero(special):
        special[k] = is_special(text.line(layout.first + int(k)), layout)
    return special


def _at_once(text: Text, layout: Layout, special: Bools) -> list[pa.Array] | None:
    """The columns, or None if a row has more or fewer cells than expected."""
    try:
        table = _read(_body(text, layout.first, special), layout)
    except pa.ArrowInvalid:
        return None
    columns = [column.unify_dictionaries().combine_chunks() for column in table.columns]
    if layout.joined:
        parts = pc.split_pattern(columns.pop(0), JOINT)
        if not np.all(pc.list_value_length(parts).to_numpy() == layout.joined):
            return None
        places = [k for k, f in enumerate(layout.fields[: layout.joined]) if f.kind in _TYPES]
        columns = [*(pc.list_element(parts, k).dictionary_encode() for k in places), *columns]
    return columns


def _read(body: pa.Buffer, layout: Layout) -> pa.Table:
    """Read cells as columns; joined names are one cell.

    Raises:
        pa.ArrowInvalid: A row has more or fewer cells than expected.
    """
    types = [_TYPES.get(field.kind) for field in layout.fields[layout.joined :]]
    types = [*([pa.string()] if layout.joined else []), *types]
    keys = [str(k) for k in range(len(types))]
    wanted = {key: kind for key, kind in zip(keys, types, strict=True) if kind}
    return arrow_csv.read_csv(
        pa.BufferReader(body),
        arrow_csv.ReadOptions(
            column_names=keys,
            block_size=_BLOCK,
            use_threads=body.size > _BLOCK,
        ),
        arrow_csv.ParseOptions(
            delimiter=layout.delimiter, quote_char=False, ignore_empty_lines=False
        ),
        arrow_csv.ConvertOptions(
            column_types=wanted,
            include_columns=list(wanted),
            strings_can_be_null=False,
            check_utf8=False,
        ),
    )


def _body(text: Text, first: int, special: Bools) -> pa.Buffer:
    """Concatenate the lines from `first` on that are not special.

    They are copied into memory owned by Arrow: one of its threads that releases a Python object
    during interpreter shutdown aborts the process (apache/arrow issue 34314).
    """
    starts = text.starts[first - 1 :]
    edge = np.flatnonzero(np.diff(np.concatenate([[True], special, [True]]))).reshape(-1, 2)
    body = pa.allocate_buffer(int(np.diff(starts[edge], axis=1).sum()))
    with pa.FixedSizeBufferWriter(body) as into:
        for begin, end in starts[edge]:
            into.write(memoryview(text.data)[begin:end])
    return body


def _each(text: Text, layout: Layout, line: Ints) -> _Cut:
    """The columns, split row by row, and why rows have the wrong number of cells."""
    kept, found, rejected = [], [], []
    for number in line.tolist():
        try:
            found.append(_row(text.line(number), layout))
            kept.append(number)
        except BadCell as reason:
            rejected.append((number, str(reason)))
            if not found and len(rejected) == HOPELESS:
                raise hopeless(*rejected[0], HOPELESS) from reason
    cells = zip(*found, strict=True) if found else [()] * len(layout.fields)
    columns = [
        pa.array(column, pa.string()).cast(_TYPES[field.kind])
        for field, column in zip(layout.fields, cells, strict=True)
        if field.kind in _TYPES
    ]
    return _Cut(columns, np.array(kept, dtype=np.int64), tuple(rejected))


HOPELESS = 100_000
"""So many rows of which none can be read are no export with mistakes in it: the others are not
looked at one by one."""


def hopeless(line: int, reason: str, rows: int) -> InputError:
    """That none of so many rows can be read, with the reason of the first."""
    thing, _, way_out = reason.rpartition("; ")
    thing = f"nothing can be read, because {rows} rows from here on are like this one: {thing}"
    return InputError(thing, way_out, line=line)


def _row(line: str, layout: Layout) -> list[str]:
    """The cells of a row, one for each field.

    Raises:
        BadCell: There are more or fewer of them.
    """
    found = cells(line, layout.delimiter)
    if layout.joined:
        names = found[0].split(JOINT)
        if len(names) != layout.joined:
            raise BadCell(
                f"has {len(names)} names in its first cell where {layout.joined} are expected; "
                "write the name again or remove the row"
            )
        found = [*names, *found[1:]]
    found = _to_width(found, layout)
    if len(found) != len(layout.fields):
        raise BadCell(_wrong_count(found, layout))
    return found


def _to_width(found: list[str], layout: Layout) -> list[str]:
    """Drop empty cells after the last column, or append missing ones that are not required."""
    width = len(layout.fields)
    if len(found) > width and not any(found[width:]):
        return found[:width]
    lacking = layout.fields[len(found) :]
    loose = all(field.kind in ("any", "blank") for field in lacking)
    return [*found, *[""] * len(lacking)] if loose else found


def _wrong_count(found: Sequence[str], layout: Layout) -> str:
    text = f"has {len(found)} fields where {len(layout.fields)} are expected"
    if layout.delimiter == "," and len(found) > len(layout.fields):
        return (
            f"{text}, as if a comma stood where a decimal point belongs; write numbers with a point"
        )
    return f"{text}; write the row again or remove it"
