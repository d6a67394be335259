"""All rows at once, by Arrow, while every one of them is as expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from pipeline.base.arrays import Bools, Ints
from pipeline.base.threads import MUCH, spread
from pipeline.readers import _time
from pipeline.readers._cells import cells, cut_off, is_special
from pipeline.readers._layout import Field, Layout, Rows
from pipeline.readers._text import CHUNK, Text, in_pieces
from pipeline.readers._time import MOMENT

_NAMES = pa.dictionary(pa.int32(), pa.string())


def at_once(text: Text, layout: Layout) -> Rows | None:
    """All rows at once, or None as soon as anything is not as expected."""
    begin = text.starts[layout.first - 1] if layout.first <= len(text) else len(text.data)
    if layout.decimal == "," or b'"' in text.data:
        return None
    special = _special(text, layout)
    line, body = np.arange(layout.first, len(text) + 1), pa.py_buffer(text.data)[begin:]
    if special.any():
        line, body = line[~special], _without(text, layout.first, special)
    if not len(line):
        return None
    direct = layout.moment == _time.ISO or _fixed_width(text, layout, line)
    if layout.joined:
        body, layout = _separated(body, layout)
    try:
        table = _read(body, layout, direct)
        if len(table) != len(line):
            return None
        wanted = [f for f in layout.fields if f.kind in ("name", "number", "time")]
        found = spread(lambda f: _column(table, f, layout), wanted, much=len(line) > MUCH)
        columns = {f.name: column for f, column in zip(wanted, found, strict=True)}
        _check_times(text, layout, columns, line)
    except (pa.ArrowInvalid, pa.ArrowKeyError, _Unexpected):
        return None
    if cut_off(text, layout, line):
        return None
    return Rows(columns, line, np.arange(1, len(line) + 1), ())


def _separated(body: pa.Buffer, layout: Layout) -> tuple[pa.Buffer, Layout]:
    """Joined names in columns of their own; a blank one between them keeps the length the same."""
    blank = Field("between", "blank", needed=False)
    names = layout.fields[: layout.joined]
    fields = [field for name in names for field in (blank, name)][1:]
    data = np.frombuffer(body, dtype=np.uint8).copy()
    mark = ord(layout.delimiter)

    def cut(begin: int) -> None:
        piece = data[begin : begin + CHUNK + 1]
        colon = piece == ord(":")
        at = np.flatnonzero(colon[:-1] & colon[1:])
        piece[at] = piece[at + 1] = mark

    in_pieces(cut, len(data))
    rest = layout.fields[layout.joined :]
    return pa.py_buffer(data), replace(layout, fields=(*fields, *rest), joined=0)


class _Unexpected(Exception):
    """A cell that needs a closer look."""


def _special(text: Text, layout: Layout) -> Bools:
    """Lines from the first row on that are blank or a comment, shape (lines,)."""
    first = np.frombuffer(text.data, dtype=np.uint8)[text.starts[layout.first - 1 : -1]]
    special = np.isin(first, np.frombuffer(b"\r\n", dtype=np.uint8))
    if layout.comment:
        special |= first == ord(layout.comment[0])
    for k in np.flatnonzero(special | (first == ord(" ")) | (first == ord("\t"))):
        special[k] = is_special(text.line(layout.first + int(k)), layout)
    return special


def _without(text: Text, first: int, special: Bools) -> pa.Buffer:
    """The lines from `first` on that are not special, in one piece."""
    starts = text.starts[first - 1 :]
    edge = np.flatnonzero(np.diff(np.concatenate([[True], special, [True]])))
    data = memoryview(text.data)
    return pa.py_buffer(b"".join(data[starts[a] : starts[b]] for a, b in edge.reshape(-1, 2)))


def _fixed_width(text: Text, layout: Layout, line: Ints) -> bool:
    """Whether every row ends in a time with two digits everywhere, which Arrow may then read."""
    template = _time.template(layout.moment)
    if layout.fields[-1].kind != "time" or not template:
        return False
    data = np.frombuffer(text.data, dtype=np.uint8)
    end = text.starts[line] - (data[text.starts[line] - 1] == ord("\n"))
    end -= data[end - 1] == ord("\r")
    marks = [(len(template) - k, ord(mark)) for k, mark in enumerate(template) if mark != "0"]
    begins = np.isin(data[end - len(template) - 1], [ord(layout.delimiter), ord(" ")])
    return bool(begins.all()) and all((data[end - k] == mark).all() for k, mark in marks)


def _read(body: pa.Buffer, layout: Layout, direct: bool) -> pa.Table:
    """All columns; times as such where that is safe, else as text."""
    if not direct:
        return _typed(body, layout, pa.string())
    try:
        return _typed(body, layout, MOMENT)
    except pa.ArrowInvalid:
        return _typed(body, layout, pa.timestamp("us", "UTC"))


def _typed(body: pa.Buffer, layout: Layout, moment: pa.DataType) -> pa.Table:
    kinds = {"name": _NAMES, "number": pa.float64(), "time": moment, "blank": pa.null()}
    keys = [str(k) for k in range(len(layout.fields))]
    wanted = {
        key: kinds[f.kind] for key, f in zip(keys, layout.fields, strict=True) if f.kind != "any"
    }
    return arrow_csv.read_csv(
        pa.BufferReader(body),
        arrow_csv.ReadOptions(column_names=keys, block_size=1 << 22),
        arrow_csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        arrow_csv.ConvertOptions(
            column_types=wanted,
            include_columns=list(wanted),
            null_values=[""],
            strings_can_be_null=False,
            check_utf8=False,
            timestamp_parsers=[arrow_csv.ISO8601 if layout.moment == _time.ISO else layout.moment],
        ),
    ).rename_columns([layout.fields[int(key)].name for key in wanted])


def _column(table: pa.Table, field: Field, layout: Layout) -> pa.Array:
    column = table[field.name]
    if field.kind == "name":
        return _names(column, field)
    if field.kind == "time":
        return _moments(column, field, layout)
    values = column.combine_chunks()
    if values.null_count and field.needed:
        raise _Unexpected
    numbers = values.to_numpy(zero_copy_only=False)
    if not np.isfinite(numbers.sum()) and not np.isfinite(numbers[values.is_valid()]).all():
        raise _Unexpected
    return values


def _names(column: pa.ChunkedArray, field: Field) -> pa.DictionaryArray:
    whole = column.unify_dictionaries().combine_chunks()
    trimmed = pc.utf8_trim_whitespace(whole.dictionary)
    if field.needed and pc.any(pc.equal(trimmed, "")).as_py():
        raise _Unexpected
    if trimmed.equals(whole.dictionary):
        return whole
    return (
        pa.DictionaryArray.from_arrays(whole.indices, trimmed).cast(pa.string()).dictionary_encode()
    )


def _moments(column: pa.ChunkedArray, field: Field, layout: Layout) -> pa.TimestampArray:
    cells = column.combine_chunks()
    if pa.types.is_timestamp(cells.type):
        return cells.cast(MOMENT)
    if not field.needed and pc.max(pc.binary_length(cells)).as_py() == 0:
        return pa.nulls(len(cells), MOMENT)
    return _time.moments(cells, layout.moment)


def _to_the_second(text: Text, line: Ints) -> Bools:
    """Lines that end in a time like 08:00:00 behind a T or a blank, shape of `line`."""
    data = np.frombuffer(text.data, dtype=np.uint8)
    end = text.starts[line] - (data[text.starts[line] - 1] == ord("\n"))
    end -= data[end - 1] == ord("\r")
    colons = (data[end - 3] == ord(":")) & (data[end - 6] == ord(":"))
    return np.asarray(colons & np.isin(data[end - 9], [ord("T"), ord(" ")]))


def _check_times(text: Text, layout: Layout, columns: dict[str, pa.Array], line: Ints) -> None:
    """Arrow takes `2026-11-03` and `2026-11-03T08` for times; look at those on the full hour."""
    place = next((k for k, f in enumerate(layout.fields) if f.kind == "time"), None)
    if place is None or layout.moment != _time.ISO:
        return
    behind = place - len(layout.fields)  # from the end: the first cell may hold several names
    times = columns[layout.fields[place].name]
    ticks = times.view(pa.int64()).to_numpy(zero_copy_only=False)  # NaN where there is no time
    hours = line[ticks % 3_600_000_000 == 0]
    if behind == -1:
        hours = hours[~_to_the_second(text, hours)]
    for number in hours.tolist():
        cell = cells(text.line(number), layout.delimiter)[behind]
        if cell and _time.form_of(cell) != _time.ISO:
            raise _Unexpected
