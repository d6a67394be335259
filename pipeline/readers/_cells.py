"""Lines and their cells."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

from pipeline.base.arrays import Array, Ints
from pipeline.readers._layout import Layout
from pipeline.readers._text import Text

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SIGN = r"(?P<sign>[+-]?)"
_GROUPS = tuple(
    re.compile(rf"{_SIGN}(?P<whole>[0-9]{{1,3}}(?:{between}[0-9]{{3}})+)(?P<rest>[{mark}][0-9]+)")
    for between, mark in ((",", "."), (r"\.", ","), ("[ '\u2019\u00a0\u202f\u2009]", ".,"))
)
"""Thousands with a sign between them, told by a decimal mark of another kind behind."""
_TURNS = re.compile(
    rf"{_SIGN}(?P<d>[0-9]{{1,3}})"
    r"(?:[°d] ?(?P<m>[0-9]{1,2})['′m] ?|-(?P<mm>[0-9]{2})-(?=.*[.,]))"
    r"(?P<s>[0-9]{1,2}(?:[.,][0-9]+)?)(?:\"|″|''|s)?"
)
"""Degrees, minutes and seconds; with hyphens only where a fraction says that it is no date."""
_FORTRAN = re.compile(r"(?<=[0-9.])[dD](?=[+-][0-9])")
ODD = "[ '’\u00a0\u202f\u2009−°dD]|,.*\\.|\\..*,|[0-9]-[0-9]"
"""What no number has that is written as programs read them."""
_IS_ODD = re.compile(ODD)
_MINUTES = 60
"""In a degree, as seconds in a minute."""
IN_BRACKETS = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]")
"""What stands in brackets in a title, mostly its unit, with the blanks before."""
MARKS = ("//", "#", "%", "!")
"""How remarks begin."""


_GLANCE = 40
"""Letters of a cell in a message."""
_FEW_ROWS = 5
"""Rows that are too few to say that all are written alike."""
_LOOKED_AT = 50
"""Rows before the last that say how long its last cell should be."""


class Bad(Exception):
    """Why a row is left out."""


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, quotes resolved, without blanks around them."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        found = next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except (csv.Error, StopIteration):
        raise Bad("has a quotation mark that is not closed; close or remove it") from None
    return [cell.strip() for cell in found]


def cells_or_none(line: str, delimiter: str) -> list[str] | None:
    """The cells of a line, or None when its quotes do not match."""
    try:
        return cells(line, delimiter)
    except Bad:
        return None


def is_remark(line: str, mark: str | tuple[str, ...] | None) -> bool:
    """Whether a line begins with a mark of remarks; none does where a file has no mark."""
    return mark is not None and line.lstrip().startswith(mark)


def is_plain(line: str, mark: str | tuple[str, ...] | None) -> bool:
    """Whether a line is neither blank nor a remark."""
    return bool(line.strip()) and not is_remark(line, mark)


def above(text: Text, header: int, delimiter: str, numbers: Sequence[int]) -> list[tuple[int, str]]:
    """Line and reason of rows above a header, which only a damaged file has.

    Args:
        text: The file.
        header: Line of its header.
        delimiter: What separates cells.
        numbers: Places of cells that hold a number in every row; remarks have none there.
    """
    reason = "the row is above the header; move it below"
    rows = ((n, cells_or_none(line, delimiter) or []) for n, line in text.lines(1, header - 1))
    return [
        (number, reason)
        for number, row in rows
        if max(numbers) < len(row) and all(is_number(row[k]) for k in numbers)
    ]


def bare(title: str) -> str:
    """A column's title without quotes and the blanks around and inside them."""
    return title.strip().strip('"').strip()


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with whatever decimal mark."""
    return NUMBER.fullmatch(bare_number(cell).replace(",", ".", 1)) is not None


def bare_number(cell: str) -> str:
    """A number without what people and other languages write in it; other cells as they are.

    Thousands kept apart, a typographer's minus, Fortran's exponent, and degrees, minutes and
    seconds, which become degrees.
    """
    if not _IS_ODD.search(cell):
        return cell
    plain = _FORTRAN.sub("E", cell.replace("−", "-"))
    for grouped in _GROUPS:
        if found := grouped.fullmatch(plain):
            return found["sign"] + re.sub(r"[^0-9]", "", found["whole"]) + found["rest"]
    found = _TURNS.fullmatch(plain)
    return _in_degrees(found) if found else plain


def is_turn(cell: str) -> bool:
    """Whether a cell is an angle in degrees, minutes and seconds."""
    return _TURNS.fullmatch(cell.replace("−", "-")) is not None


def _in_degrees(turn: re.Match[str]) -> str:
    mark = "," if "," in turn["s"] else "."
    minutes = int(turn["m"] or turn["mm"]) + float(turn["s"].replace(",", ".")) / _MINUTES
    return turn["sign"] + f"{int(turn['d']) + minutes / _MINUTES:.12f}".replace(".", mark)


def shown(cell: str, most: int = _GLANCE) -> str:
    """A cell for a message: control characters out, not longer than a glance."""
    plain = "".join(c if c.isprintable() else "?" for c in cell)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def text_of(values: Array, digits: int | None) -> list[list[str]]:
    """Numbers as text, row by row: with so many decimals, or (None) with all that matter."""
    if digits is None:
        return [[repr(value) for value in row] for row in values.tolist()]
    return [[f"{value:.{digits}f}" for value in row] for row in values.tolist()]


def is_special(line: str, layout: Layout) -> bool:
    """Whether a line is blank or a comment, and so no row."""
    bare = line.strip() if layout.delimiter != "\t" else line.strip(" \r\n")
    return not bare or bool(layout.comment and bare.startswith(layout.comment))


def cut_off(text: Text, layout: Layout, line: Ints) -> bool:
    """Whether the file ends inside its last row.

    Told where the last line lacks its end and its last cell, a number or a time, is shorter than
    every one before, all of which are written alike.
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
