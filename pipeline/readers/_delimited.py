"""Delimited rows into typed columns: fast while all is well, row by row where something is wrong.

Both ways give the same values for the same text; the slow one exists to name line and reason.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from pipeline.errors import InputError
from pipeline.readers import _time
from pipeline.readers._text import CHUNK, Text, in_pieces
from pipeline.readers._time import MOMENT
from pipeline.results import Array, Bools, Ints, Locked

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
GROUPED = re.compile(r"[+-]?[0-9]{1,3}(,[0-9]{3})+")
DELIMITERS = (",", ";", "\t", "|")

JOINT = "::"
NAMES = pa.dictionary(pa.int32(), pa.string())

Kind = Literal["name", "number", "time", "blank", "any"]


@dataclass(frozen=True)
class Field:
    """One column of a row.

    Attributes:
        name: What it is called in the result.
        kind: `name`, `number`, `time`, `blank` (must be empty) or `any` (not looked at).
        needed: Whether the cell may not be empty.
        title: What the file calls it, where that is something else.
    """

    name: str
    kind: Kind
    needed: bool = True
    title: str = ""

    @property
    def said(self) -> str:
        """What it is called in messages."""
        return self.title or self.name


@dataclass(frozen=True)
class Layout:
    """How rows are written.

    Attributes:
        fields: The columns, left to right.
        delimiter: What separates them.
        first: Line of the first row, counted from 1.
        decimal: `.` or `,`, or None to find out.
        comment: Start of a line that is no row.
        moment: How times are written, `_time.ISO` or a `strptime` form.
        joined: How many of the first fields stand in one cell, with `::` between them; 0 for none.
    """

    fields: tuple[Field, ...]
    delimiter: str
    first: int
    decimal: str | None = None
    comment: str | None = None
    moment: str = _time.ISO
    joined: int = 0


@dataclass(frozen=True, eq=False)
class Rows(Locked):
    """Typed columns of the rows that could be read.

    Attributes:
        columns: By name; dictionaries of strings, float64 and timestamps.
        line: Line of each row, shape (n,).
        order: Number of each row among all rows, those left out included, from 1, shape (n,).
        rejected: Line and reason of the rows that could not be read.
    """

    columns: dict[str, pa.Array]
    line: Ints
    order: Ints
    rejected: tuple[tuple[int, str], ...]


def rows(text: Text, layout: Layout) -> Rows:
    """Read all rows from line `layout.first` on.

    Raises:
        InputError: The decimal mark cannot be told.
    """
    fast = _fast(text, layout)
    return _careful(text, layout) if fast is None else fast


# --- fast -----------------------------------------------------------------------------------------


def _fast(text: Text, layout: Layout) -> Rows | None:
    """All rows at once, or None as soon as anything is not as expected."""
    begin = text.starts[layout.first - 1] if layout.first <= len(text) else len(text.data)
    if layout.decimal == "," or b'"' in text.data:
        return None
    special = _special(text, layout)
    line = np.arange(layout.first, len(text) + 1)[~special]
    body = (
        _without(text, layout.first, special) if special.any() else pa.py_buffer(text.data)[begin:]
    )
    if not len(line):
        return None
    direct = layout.moment == _time.ISO or _fixed_width(text, layout, line)
    if layout.joined:
        body, layout = _separated(body, layout)
    try:
        table = _read(body, layout, direct)
        if len(table) != len(line):
            return None
        columns = {
            f.name: _column(table, f, layout)
            for f in layout.fields
            if f.kind in ("name", "number", "time")
        }
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
        special[k] = _is_special(text.line(layout.first + int(k)), layout)
    return special


def _is_special(line: str, layout: Layout) -> bool:
    bare = line.strip() if layout.delimiter != "\t" else line.strip(" \r\n")
    return not bare or bool(layout.comment and bare.startswith(layout.comment))


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
    kinds = {"name": NAMES, "number": pa.float64(), "time": moment, "blank": pa.null()}
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


# --- careful --------------------------------------------------------------------------------------


class _Bad(Exception):
    """Why a row is left out."""


def _careful(text: Text, layout: Layout) -> Rows:
    decimal = layout.decimal or _decimal(text, layout)
    kept: list[list[Any]] = []
    line: list[int] = []
    rejected: list[tuple[int, str]] = []
    zoned: set[bool] = set()
    for number, content in text.lines(layout.first):
        if _is_special(content, layout):
            continue
        try:
            kept.append(_row(content, layout, decimal, zoned))
            line.append(number)
        except _Bad as reason:
            rejected.append((number, str(reason)))
    if len(zoned) > 1:
        raise InputError(
            "some times have a zone and some have none",
            "export all times in the same form",
            file=text.name,
        )
    if line and cut_off(text, layout, np.array(line)):
        kept.pop()
        rejected.append((line.pop(), "the file ends inside this line; export it again"))
    everything = sorted([*line, *(number for number, _ in rejected)])
    columns = {
        f.name: _array([row[k] for row in kept], f.kind)
        for k, f in enumerate(layout.fields)
        if f.kind in ("name", "number", "time")
    }
    lines = np.array(line, dtype=np.int64)
    order = np.searchsorted(everything, lines) + 1
    return Rows(columns, lines, order, tuple(rejected))


def _array(values: list[Any], kind: Kind) -> pa.Array:
    if kind == "name":
        return pa.array(values, pa.string()).dictionary_encode()
    return pa.array(values, pa.float64() if kind == "number" else MOMENT)


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, quotes resolved, without blanks around them."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        found = next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except (csv.Error, StopIteration):
        raise _Bad("has a quotation mark that is not closed; close or remove it") from None
    return [cell.strip() for cell in found]


def cells_or_none(line: str, delimiter: str) -> list[str] | None:
    """The cells of a line, or None when its quotes do not match."""
    try:
        return cells(line, delimiter)
    except _Bad:
        return None


def text_of(values: Array, digits: int | None) -> list[list[str]]:
    """Numbers as text, row by row: with so many decimals, or (None) with all that matter."""
    if digits is None:
        return [[repr(value) for value in row] for row in values.tolist()]
    return [[f"{value:.{digits}f}" for value in row] for row in values.tolist()]


def _row(line: str, layout: Layout, decimal: str, zoned: set[bool]) -> list[Any]:
    found = cells(line, layout.delimiter)
    if layout.joined:
        names = [name.strip() for name in found[0].split(JOINT)]
        if len(names) != layout.joined:
            raise _Bad(
                f"has {len(names)} names in its first cell where {layout.joined} are expected; "
                "write the name again or remove the row"
            )
        found = [*names, *found[1:]]
    if len(found) != len(layout.fields):
        raise _Bad(_wrong_count(found, layout))
    return [
        _cell(cell, field, layout, decimal, zoned)
        for cell, field in zip(found, layout.fields, strict=True)
    ]


def _wrong_count(found: Sequence[str], layout: Layout) -> str:
    said = f"has {len(found)} fields where {len(layout.fields)} are expected"
    if layout.delimiter == "," and len(found) > len(layout.fields):
        return (
            f"{said}, as if a comma stood where a decimal point belongs; write numbers with a point"
        )
    return f"{said}; write the row again or remove it"


def _cell(cell: str, field: Field, layout: Layout, decimal: str, zoned: set[bool]) -> Any:
    if field.kind == "any":
        return None
    if field.kind == "blank":
        if cell:
            raise _Bad(f'has "{shown(cell)}" behind the last column; remove it')
        return None
    if not cell:
        if field.needed:
            raise _Bad(f"has nothing in column {field.said}; fill it in or remove the row")
        return None if field.kind != "name" else ""
    if field.kind == "name":
        return cell
    if field.kind == "number":
        return _number(cell, field, decimal)
    return _moment(cell, field, layout, zoned)


def _number(cell: str, field: Field, decimal: str) -> float:
    foreign = "." if decimal == "," else ","
    written = cell.replace(",", ".") if decimal == "," else cell
    if foreign not in cell and NUMBER.fullmatch(written):
        value = float(written)
        if np.isfinite(value):
            return value
        raise _Bad(
            f'{field.said} is "{shown(cell)}", too large for a number; correct or remove the row'
        )
    if cell.lower().lstrip("+-") in (
        "nan",
        "inf",
        "infinity",
        "na",
        "n/a",
        "null",
        "none",
        "1.#qnan",
    ):
        raise _Bad(
            f'{field.said} is "{shown(cell)}", not a number; measure it again or remove the row'
        )
    if foreign in cell and re.fullmatch(r"[+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?", cell):
        raise _Bad(
            f'{field.said} is "{shown(cell)}": this file has the decimal mark "{decimal}"; '
            "write all numbers the same way"
        )
    raise _Bad(f'{field.said} is "{shown(cell)}", not a number; correct or remove the row')


def _moment(cell: str, field: Field, layout: Layout, zoned: set[bool]) -> datetime:
    found = _time.moment(cell, layout.moment)
    if found is None:
        known = _time.form_of(cell) not in (None, layout.moment)
        other = "in another form than the first one" if known else "not a time"
        raise _Bad(f'{field.said} is "{shown(cell)}", {other}; correct or remove the row')
    zoned.add(found.tzinfo is not None)
    return _time.without_zone(found)


def shown(cell: str, most: int = 40) -> str:
    """A cell for a message: control characters out, not longer than a glance."""
    plain = "".join(c if c.isprintable() else "?" for c in cell)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def _decimal(text: Text, layout: Layout) -> str:
    """The decimal mark of a file: the one that most of its numbers have.

    Raises:
        InputError: Every comma could as well stand between thousands.
    """
    numeric = [k for k, field in enumerate(layout.fields) if field.kind == "number"]
    points = commas = 0
    doubtful: tuple[int, str] | None = None
    for number, line in text.lines(layout.first):
        if _is_special(line, layout):
            continue
        found = cells_or_none(line, layout.delimiter) or []
        for cell in (found[k] for k in numeric if k < len(found)):
            if GROUPED.fullmatch(cell):
                doubtful = doubtful or (number, cell)
            else:
                points += "." in cell and "," not in cell
                commas += "," in cell and "." not in cell
    if doubtful and not commas and not points:
        where, cell = doubtful
        raise InputError(
            f'"{cell}" may be {cell.replace(",", ".", 1)} or {cell.replace(",", "")}',
            'say which with decimal = "," or decimal = "." in [tracker] of campaign.toml',
            file=text.name,
            line=where,
        )
    return "," if commas > points else "."


def cut_off(text: Text, layout: Layout, line: Ints) -> bool:
    """Whether the file ends inside its last row.

    Told where the last line lacks its end and its last cell, a number or a time, is shorter than
    every one before, all of which are written alike.
    """
    if text.ended() or line[-1] != len(text) or len(line) < 6:
        return False
    kind = layout.fields[-1].kind
    if kind not in ("number", "time"):
        return False
    before = {_precision(text.line(int(number)), layout, kind) for number in line[-51:-1]}
    here = _precision(text.line(len(text)), layout, kind)
    return len(before) == 1 and here < before.pop()


def _precision(line: str, layout: Layout, kind: str) -> int:
    last = line.rsplit(layout.delimiter, 1)[-1].strip(' "')
    return len(last) if kind == "time" else len(re.sub(r"^[^.,]*[.,]?", "", last))
