"""Split lines into cells, and normalise numbers as people and programs write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence

from pipeline.base.arrays import Ints
from pipeline.readers._layout import Layout
from pipeline.readers._text import Text

DELIMITERS = (",", ";", "\t", "|")
NUMBER_START = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SIGN = r"(?P<sign>[+-]?)"
_GROUPS = tuple(
    re.compile(rf"{_SIGN}(?P<whole>[0-9]{{1,3}}(?:{between}[0-9]{{3}})+)(?P<rest>[{mark}][0-9]+)")
    for between, mark in ((",", "."), (r"\.", ","), ("[ '\u2019\u00a0\u202f\u2009]", ".,"))
)
"""Numbers with thousands separators, recognised by a decimal mark of another kind after them."""
_DEGREES = rf"{_SIGN}(?P<d>[0-9]{{1,3}})"
_SECONDS = r"(?P<s>[0-5]?[0-9](?:[.,][0-9]+)?)"
_TURNS = tuple(
    re.compile(_DEGREES + rest)
    for rest in (
        rf" ?[°º˚dD] ?(?P<m>[0-5]?[0-9]) ?['′’mM] ?(?:{_SECONDS} ?(?:\"|″|”|''|′′|’’|[sS])?)?",
        r" ?[°º˚dD] ?(?P<m>[0-5]?[0-9][.,][0-9]+) ?['′’mM](?P<s>)",
        r"-(?P<m>[0-5][0-9])-(?P<s>[0-5]?[0-9][.,][0-9]+)",
        rf"[ \u00a0](?P<m>[0-5]?[0-9])[ \u00a0]{_SECONDS}",
    )
)
"""Degrees, minutes and seconds, or no seconds; separated by hyphens only if decimals show that it
is not a date."""
_FORTRAN = re.compile(r"(?<=[0-9.])[dD](?=[+-][0-9])")
NOT_IN_NUMBERS = "[ '’\u00a0\u202f\u2009−°º˚dD]|,.*\\.|\\..*,|[0-9]-[0-9]"
"""Characters and combinations that do not occur in numbers as programs parse them."""
_IS_ODD = re.compile(NOT_IN_NUMBERS)
_MINUTES = 60
"""Minutes in a degree, and seconds in a minute [1]."""
_DIGITS = 12
"""Number of decimals of degrees that were minutes and seconds [1]."""
IN_BRACKETS = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]")
"""Text in brackets in a title, usually the unit, with the blanks before it."""
MARKS = ("//", "#", "%", "!")
"""Characters that introduce a comment line."""


_FEW_ROWS = 5
"""Number of rows up to which a common format of all rows is not assumed [1]."""
_LOOKED_AT = 50
"""Number of rows before the last that determine the expected length of its last cell [1]."""


def delimiter_of(line: str, otherwise: str = DELIMITERS[0]) -> str:
    """The delimiter of a header line: the most frequent of the known ones."""
    found = max(DELIMITERS, key=line.count)
    return found if found in line else otherwise


class BadCell(Exception):
    """A row is rejected; the message says why."""


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, unquoted and stripped of surrounding blanks."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        found = next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except (csv.Error, StopIteration):
        raise BadCell("has a quotation mark that is not closed; close or remove it") from None
    return [cell.strip() for cell in found]


def cells_or_none(line: str, delimiter: str) -> list[str] | None:
    """The cells of a line, or None when its quotes do not match."""
    try:
        return cells(line, delimiter)
    except BadCell:
        return None


def is_remark(line: str, mark: str | tuple[str, ...] | None) -> bool:
    """Whether a line is a comment; never if the file has no comment mark."""
    return mark is not None and line.lstrip().startswith(mark)


def is_plain(line: str, mark: str | tuple[str, ...] | None) -> bool:
    """Whether a line is neither blank nor a remark."""
    return bool(line.strip()) and not is_remark(line, mark)


def above(text: Text, header: int, delimiter: str, numbers: Sequence[int]) -> list[tuple[int, str]]:
    """Line and reason for rows of data above a header, which only a damaged file has.

    Args:
        text: The file.
        header: Line number of its header.
        delimiter: Separator of cells.
        numbers: Column indices that hold a number in every row of data, but not in comments.
    """
    reason = "the row is above the header; move it below"
    rows = ((n, cells_or_none(line, delimiter) or []) for n, line in text.lines(1, header - 1))
    return [
        (number, reason)
        for number, row in rows
        if max(numbers) < len(row) and all(is_number(row[k]) for k in numbers)
    ]


def from_above(cells: Iterable[str]) -> list[str]:
    """The cells with empty ones filled from above, or from the left in a line."""
    last = ""
    return [last := cell or last for cell in cells]


def bare(title: str) -> str:
    """A column's title without quotes and the blanks around and inside them."""
    return title.strip().strip('"').strip()


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with either decimal mark."""
    return NUMBER_START.fullmatch(bare_number(cell).replace(",", ".", 1)) is not None


def bare_number(cell: str) -> str:
    """Normalise a number as people and other languages write it; other cells are unchanged.

    Thousands separators are removed, a typographic minus and Fortran's exponent are replaced, and
    degrees, minutes and seconds are converted to decimal degrees.
    """
    if not _IS_ODD.search(cell):
        return cell
    plain = _FORTRAN.sub("E", cell.replace("−", "-"))
    for grouped in _GROUPS:
        if found := grouped.fullmatch(plain):
            return found["sign"] + re.sub(r"[^0-9]", "", found["whole"]) + found["rest"]
    found = _turn(plain)
    return _in_degrees(found) if found else plain


def is_turn(cell: str) -> bool:
    """Whether a cell is an angle in degrees, minutes and seconds."""
    return _turn(cell.replace("−", "-")) is not None


def seems_turn(cell: str) -> bool:
    """Whether a cell is such an angle, or may be one of degrees and minutes alone."""
    return is_turn(cell) or _TWO_PARTS.fullmatch(cell) is not None


_TWO_PARTS = re.compile(r"[+-]?[0-9]{1,3} [0-5]?[0-9](?:[.,][0-9]+)?")


def _turn(cell: str) -> re.Match[str] | None:
    return next((found for one in _TURNS if (found := one.fullmatch(cell))), None)


def _in_degrees(turn: re.Match[str]) -> str:
    """Decimal degrees without a decimal mark, whichever the file has."""
    minutes, seconds = (float((turn[one] or "0").replace(",", ".")) for one in "ms")
    degrees = int(turn["d"]) + (minutes + seconds / _MINUTES) / _MINUTES
    return f"{turn['sign']}{round(degrees * 10**_DIGITS)}e-{_DIGITS}"


def is_special(line: str, layout: Layout) -> bool:
    """Whether a line is blank or a comment, and therefore not a row of data."""
    bare = line.strip() if layout.delimiter != "\t" else line.strip(" \r\n")
    return not bare or bool(layout.comment and bare.startswith(layout.comment))


def cut_off(text: Text, layout: Layout, line: Ints) -> bool:
    """Whether the file is truncated within its last row.

    This is assumed if the last line has no line end, and its last cell, a number or a time, has
    fewer digits or characters than all previous ones, which have equally many.
    """
    if text.ended() or line[-1] != len(text) or len(line) <= _FEW_ROWS:
        return False
    kind = layout.fields[-1].kind
    if kind not in ("number", "time"):
        return False
    before = {
        _precision(text.line(int(number)), layout, kind) for number in line[-_LOOKED_AT - 1 : -1]
    }
    here = _precision(text.line(len(text)), layout, kind)
    return len(before) == 1 and here < before.pop()


def _precision(line: str, layout: Layout, kind: str) -> int:
    last = line.rsplit(layout.delimiter, 1)[-1].strip(' "')
    return len(last) if kind == "time" else len(re.sub(r"^[^.,]*[.,]?", "", last))
