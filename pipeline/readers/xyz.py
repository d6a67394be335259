"""Semicolon .xyz: rows without a header, up to two names and three numbers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.base.errors import at
from pipeline.readers import _named
from pipeline.readers._cells import cells_or_none, is_number
from pipeline.readers._coordinates import Meaning, settled
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._reader import (
    Export,
    Hints,
    Reader,
    Readings,
    export,
    settled_unit,
    written,
)
from pipeline.readers._text import Text

_NAMES = {3: (), 4: ("target",), 5: ("group", "target")}
_AXES = ("x", "y", "z")


def recognise(lines: Sequence[str]) -> bool:
    """Every row has up to two names and three numbers between semicolons."""
    rows = [_cells(line) for line in lines if line.strip()]
    fitting = [len(row) in _NAMES and all(map(is_number, row[-3:])) for row in rows]
    most = 2 * sum(fitting) > len(rows) and len(rows[0]) in _NAMES
    return most and not any(map(_elsewhere, lines)) and not _named.find(lines)


def _elsewhere(line: str) -> bool:
    """Whether only SpatialAnalyzer writes such a line."""
    return "::" in line or line.lstrip().startswith("//")


def _cells(line: str) -> list[str]:
    cells = cells_or_none(line, ";") or []
    return cells[:-1] if cells and not cells[-1] else cells


def read(text: Text, hints: Hints) -> Export:
    """Readings of an .xyz file.

    Raises:
        InputError: The unit is not stated in campaign.toml.
    """
    first, line = text.first()
    names = _NAMES[len(_cells(line))]
    fields = [*(Field(name, "name") for name in names), *(Field(axis, "number") for axis in _AXES)]
    if line.rstrip().endswith(";"):
        fields.append(Field("end", "blank", needed=False))
    with at(line=first):
        meaning = Meaning(settled_unit(None, hints))
        settled("cartesian", hints.coordinates, "coordinates", 'coordinates = "..."')
    table = rows(text, Layout(tuple(fields), ";", first, hints.decimal))
    return export(text, hints, READER.name, table, meaning, _AXES)


def write(readings: Readings, unit: str, digits: int | None) -> bytes:
    """Rows of group, target and coordinates; times are lost."""
    rows = written(readings, unit, digits)
    lines = [";".join([group, target, *xyz]) for group, target, xyz, _ in rows]
    return "\r\n".join([*lines, ""]).encode()


READER = Reader("semicolon xyz", recognise, read, write, suffix=".xyz", says_unit=False)
