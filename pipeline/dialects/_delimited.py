"""Convert delimited rows to typed columns, and say why a cell is not of the type of its column.

The reasons for rejection are derived from the same columns as the values: no row is lost without a
reason, and none gets a reason that does not apply.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.base.errors import InputError
from pipeline.base.threads import WORTH_A_THREAD, spread
from pipeline.dialects import _time
from pipeline.dialects._cells import NOT_IN_NUMBERS, NUMBER_START, bare_number, cut_off, is_turn
from pipeline.dialects._cut import HOPELESS, cut, hopeless
from pipeline.dialects._number_formats import IN_FORMAT
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.readers import pose_names
from pipeline.readers._layout import Field, Layout, TypedRows
from pipeline.readers._plain_rows import LARGEST_NUMBER
from pipeline.readers._text import Text, shortened

_GROUPED = r"^[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+$"
"""Numbers whose commas may be thousands separators or, if there is one comma, a decimal mark; none
begins with 0."""
_LAST = ord("~")
"""Code of the last printable ASCII character; white space of other scripts comes after it."""
_NO_NUMBERS = ("nan", "inf", "infinity", "na", "n/a", "null", "none", "1.#qnan")
"""Texts that programs write for a missing number."""


@dataclass(frozen=True, eq=False)
class _RawColumn(Locked):
    """One column of all rows.

    Attributes:
        field: Description of the column.
        cells: Texts as written, stripped of surrounding blanks: strings, or a dictionary of names.
        values: Parsed values, null if a cell has none.
        good: Rows that are not rejected, shape (n,).
        zoned: Times with a time zone, shape (n,); None if there are none.
    """

    field: Field
    cells: pa.Array
    values: pa.Array
    good: Bools
    zoned: Bools | None = None


def rows(text: Text, layout: Layout) -> TypedRows:
    """Read all rows from line `layout.first` on.

    Raises:
        InputError: The decimal mark is ambiguous, or only some times have a zone.
    """
    found = cut(text, layout)
    columns, layout = _columns(found.columns, found.line, layout)
    good = np.logical_and.reduce([column.good for column in columns])
    _zones_alike(columns, good)
    if len(good) >= HOPELESS and not good.any():
        (first,) = _why_not(columns, found.line[:1], good[:1], layout)
        raise hopeless(*min([first, *found.rejected[:1]]), len(good))
    rejected = [*found.rejected, *_why_not(columns, found.line, good, layout)]
    line = found.line[good]
    if len(line) and cut_off(text, layout, line):
        good[np.flatnonzero(good)[-1]] = False
        rejected.append((int(line[-1]), "the file ends inside this line; export it again"))
    return _kept(columns, found.line[good], good, sorted(rejected))


def _columns(
    written: list[pa.Array], line: Ints, layout: Layout
) -> tuple[list[_RawColumn], Layout]:
    """Parse the columns of all rows; with the layout, in which the decimal mark is now known."""
    fields = [field for field in layout.fields if field.kind != "any"]
    much = len(line) > WORTH_A_THREAD
    cells = spread(_trimmed, written, much)
    bare = {k: _without(cells[k], field)
            for k, field in enumerate(fields) if field.kind == "number"}  # fmt: skip
    numbers = {k: _bare_numbers(one, _may_be_angle(fields[k])) for k, (one, _) in bare.items()}
    mark = layout.decimal or decimal_mark([*numbers.values()], line, layout.table)
    layout = replace(layout, decimal=mark)
    columns = spread(
        lambda k: _parsed(fields[k], numbers.get(k, cells[k]), layout), range(len(fields)), much
    )
    columns = [_in_unit(one, bare[k][1]) if k in bare else one for k, one in enumerate(columns)]
    return columns, layout


def _kept(
    columns: list[_RawColumn], line: Ints, good: Bools, rejected: list[tuple[int, str]]
) -> TypedRows:
    """The good rows, with their numbers among all rows."""
    values = {c.field.name: c.values for c in columns if c.field.kind != "blank"}
    if not good.all():
        values = sifted(values, good)
    others = np.array([number for number, _ in rejected], dtype=np.int64)
    order = np.arange(1, len(line) + 1) + np.searchsorted(others, line)
    return TypedRows(values, line, order, tuple(rejected))


def _trimmed(cells: pa.Array) -> pa.Array:
    """Strip surrounding blanks from cells."""
    if pa.types.is_dictionary(cells.type):
        trimmed = _trimmed(cells.dictionary)
        same = trimmed.equals(cells.dictionary)
        return cells if same else trimmed.take(cells.indices).dictionary_encode()
    letters = _letters(cells)
    bare = letters.min(initial=_LAST) > ord(" ") and letters.max(initial=0) <= _LAST
    return cells if bare else pc.utf8_trim_whitespace(cells)


_UNIT_BEHIND = re.compile(r"(.*[0-9.,])\s*([^\W\d_]+|°)")


def _without(cells: pa.StringArray, field: Field) -> tuple[pa.StringArray, Array | None]:
    """Remove a name before numbers, and units after them.

    Returns:
        The cells, and the factor of each to the unit of the column, shape (n,); None if no cell has
        one of the known units.
    """
    lettered = _letters(cells).max(initial=0) > ord("9")  # a pattern costs more than a few rows
    cells = _without_name(_with_codes(cells)) if field.named and lettered else cells
    if field.unit and field.unit.lower() not in field.units:
        return pc.replace_substring_regex(cells, rf"(?i)\s*{re.escape(field.unit)}$", ""), None
    cells, factor = (
        _without_units(cells, field.units) if field.units and lettered else (cells, None)
    )
    return cells, _of_turns(cells, field.units.get("deg", 1.0), factor)


def _with_codes(cells: pa.StringArray) -> pa.StringArray:
    """Write `04bis` as its code, unless all cells have the same letters."""
    found = pc.extract_regex(cells, r"^(?P<stem>(?:\pL+[ _-]?)?)(?P<name>\d+[ _-]?\pL+)$")
    rows = np.flatnonzero(found.is_valid()).tolist()
    codes = {k: pose_names.coded(found[k]["name"].as_py()) for k in rows}
    words = {code and pose_names.letters_of(code) for code in codes.values()}
    if not rows or (len(words) == 1 and len(rows) == np.count_nonzero(_filled(cells))):
        return cells
    out = cells.to_pylist()
    for k in rows:
        out[k] = f"{found[k]['stem']}{codes[k]}" if codes[k] else out[k]
    return pa.array(out, pa.string())


def _without_name(cells: pa.StringArray) -> pa.StringArray:
    """Remove a name before numbers, if all that have one have the same: `pose 7`."""
    names = pc.extract_regex(cells, r"^(?P<name>\pL+[ _-]?)(?P<number>\d+)$")
    if len({*pc.struct_field(names.drop_null(), "name").to_pylist()}) != 1:
        return cells
    return pc.if_else(names.is_valid(), pc.struct_field(names, "number"), cells)


def _without_units(
    cells: pa.StringArray, units: Mapping[str, float]
) -> tuple[pa.StringArray, Array | None]:
    """Remove units, each with its factor, as in `_without`."""
    ends = pc.match_substring_regex(cells, r"[0-9.,]\s*(\pL+|°)$")
    plain, factor = cells.to_pylist(), np.ones(len(cells))
    for k in np.flatnonzero(ends).tolist():
        found = _UNIT_BEHIND.fullmatch(plain[k])
        unit = found[2].lower().replace("°", "deg") if found else ""
        if found and unit in units:
            plain[k], factor[k] = found[1], units[unit]
    return pa.array(plain, pa.string()), factor


def _of_turns(cells: pa.StringArray, degree: float, factor: Array | None) -> Array | None:
    """The factor of each cell as in `_without`, with `degree` for degrees, minutes and seconds."""
    turns = [] if degree == 1.0 else [k for k, c in enumerate(cells.to_pylist()) if is_turn(c)]
    if not turns:
        return factor
    out = np.ones(len(cells)) if factor is None else factor.copy()
    out[turns] = degree
    return out


def _in_unit(column: _RawColumn, factor: Array | None) -> _RawColumn:
    """The values in the unit of the column."""
    if factor is None or (factor == 1.0).all():
        return column
    return replace(column, values=pc.multiply(column.values, pa.array(factor)))


def _may_be_angle(field: Field) -> bool:
    """Whether a column may hold angles: others, as of lengths, may not be in degrees."""
    return "deg" in field.units


def _bare_numbers(cells: pa.StringArray, turning: bool) -> pa.StringArray:
    """Normalise numbers as people write them, if there are any; angles only in a `turning` column.

    In any other one degrees, minutes and seconds are no number.
    """
    letters = _letters(cells)
    usual = letters.min(initial=_LAST) > ord("'") and letters.max(initial=0) <= ord("9")
    turns = turning and any(map(is_turn, cells[:_GLIMPSE].to_pylist()))
    if usual and not turns and not ((letters == ord(",")).any() and (letters == ord(".")).any()):
        return cells
    odd = pc.match_substring_regex(cells, NOT_IN_NUMBERS)
    plain = [
        c if is_turn(c) and not turning else bare_number(c) for c in cells.filter(odd).to_pylist()
    ]
    bare = pa.array(plain, pa.string())
    return pc.replace_with_mask(cells, odd, bare)


_GLIMPSE = 50
"""Number of leading rows that decide whether a column holds degrees, minutes and seconds [1]; if
so, all of its rows do."""


def _letters(cells: pa.StringArray) -> npt.NDArray[np.uint8]:
    """All bytes of the text of a column, as stored in memory, shape (bytes,)."""
    return np.frombuffer(cells.buffers()[2] or b"", dtype=np.uint8)


def _zones_alike(columns: list[_RawColumn], good: Bools) -> None:
    for column in columns:
        if column.zoned is None:
            continue
        zoned = column.zoned[good & np.asarray(column.values.is_valid())]
        if zoned.any() and not zoned.all():
            raise InputError(
                "some times have a zone and some have none", "export all times in the same form"
            )


def decimal_mark(numeric: list[pa.Array], line: Ints, table: str | None) -> str:
    """The decimal mark of a file: the one that most of its numbers have.

    Args:
        numeric: Its numeric columns as text, stripped of surrounding blanks.
        line: Line number of each row, shape (n,).
        table: Table of campaign.toml that may state the decimal mark; None if none may.

    Raises:
        InputError: Every comma could also be a thousands separator.
    """
    if not any((_letters(column) == ord(",")).any() for column in numeric):
        return "."
    grouped, comma, point = (
        np.column_stack([pc.match_substring_regex(column, mark) for column in numeric])
        for mark in (_GROUPED, ",", r"\.")
    )
    commas, points = np.sum(comma & ~point & ~grouped), np.sum(point & ~comma)
    if grouped.any() and not commas and not points:
        row, k = np.argwhere(grouped)[0]
        cell = numeric[k][int(row)].as_py()
        raise InputError(
            f'"{cell}" may be {cell.replace(",", ".", 1)} or {cell.replace(",", "")}',
            f'say which with decimal = "," or decimal = "." in [{table}] of campaign.toml'
            if table
            else "write all numbers with a point, and none between thousands",
            line=int(line[row]),
        )
    return "," if commas > points else "."


# --- values of cells ------------------------------------------------------------------------------


def _parsed(field: Field, cells: pa.Array, layout: Layout) -> _RawColumn:
    """Parse the cells of a column, and decide which rows are accepted."""
    values, zoned = cells, None
    if field.kind == "number":
        values = _numbers(cells, layout.decimal or ".")
    elif field.kind == "time":
        values, zoned = _time.moments(cells, layout.moment)
    good = _filled(cells) if values is cells else np.asarray(values.is_valid())
    if field.kind == "blank":
        good = ~good
    elif not field.needed and not good.all():
        good = good | ~_filled(cells)
    return _RawColumn(field, cells, values, good, zoned)


def _filled(cells: pa.Array) -> Bools:
    if pa.types.is_dictionary(cells.type):
        return _filled(cells.dictionary)[np.asarray(cells.indices)]
    return np.asarray(pc.binary_length(cells)) > 0


def _numbers(cells: pa.Array, mark: str) -> pa.DoubleArray:
    """Parse numbers with one decimal mark, null if a cell is not a number."""
    values = _cast(cells, mark)
    finite = np.abs(values.to_numpy(zero_copy_only=False)) <= LARGEST_NUMBER
    return values if finite.all() else pc.if_else(pa.array(finite), values, None)


def _cast(cells: pa.Array, mark: str) -> pa.DoubleArray:
    """Parse numbers as in `_numbers`; infinite if too large, NaN or infinite if not a number."""
    if mark == ".":
        try:
            return cells.cast(pa.float64())
        except pa.ArrowInvalid:
            pass  # some cell is no number: see which
    fits = pc.match_substring_regex(cells, f"^(?:{_number(mark)})$")
    return pc.replace_substring(pc.if_else(fits, cells, "nan"), mark, ".").cast(pa.float64())


def _number(mark: str) -> str:
    return NUMBER_START.pattern.replace(r"\.", re.escape(mark))


# --- why they may not stay ------------------------------------------------------------------------


def _why_not(
    columns: list[_RawColumn], line: Ints, good: Bools, layout: Layout
) -> list[tuple[int, str]]:
    """Line and reason of the rejected rows, each for its first faulty cell."""
    out = []
    for row in np.flatnonzero(~good).tolist():
        column = next(column for column in columns if not column.good[row])
        out.append((int(line[row]), _why(column.cells[row].as_py(), column.field, layout)))
    return out


def _why(cell: str, field: Field, layout: Layout) -> str:
    if field.kind == "blank":
        return f'has "{shortened(cell)}" behind the last column; remove it'
    if not cell:
        return f"has nothing in column {field.said}; fill it in or remove the row"
    why = _why_no_number if field.kind == "number" else _why_no_time
    return f'{field.said} is "{shortened(cell)}"{why(cell, layout)}'


def _why_no_number(cell: str, layout: Layout) -> str:
    mark = layout.decimal or "."
    if re.fullmatch(_number(mark), cell):
        return ", too large for a number; correct or remove the row"
    if cell.lower().lstrip("+-") in _NO_NUMBERS:
        return ", not a number; measure it again or remove the row"
    if IN_FORMAT in cell:
        return ", which shows another number; choose a format that shows the one that is meant"
    if _WITH_UNIT.fullmatch(cell):
        return ", a number with its unit; write the unit into the title and only the number here"
    foreign = "." if mark == "," else ","
    if foreign in cell and re.fullmatch(r"[+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?", cell):
        return f': this file has the decimal mark "{mark}"; write all numbers the same way'
    return ", not a number; correct or remove the row"


_FORCES = ("N", "kN", "daN", "kgf", "kg", "kp", "lbf")
_WITH_UNIT = re.compile(
    rf"[+-]?[0-9]+(?:[.,][0-9]+)? ?(?:{'|'.join([*UNIT_WORDS, *ANGLE_WORDS, *_FORCES])}|\")"
)


def _why_no_time(cell: str, layout: Layout) -> str:
    known = _time.form_of(cell) not in (None, layout.moment)
    other = "in another form than the first one" if known else "not a time"
    return f", {other}; correct or remove the row"
