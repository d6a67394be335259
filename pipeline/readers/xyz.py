"""Semicolon .xyz: rows without a header, up to two names and three numbers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.readers import _named
from pipeline.readers._cells import NUMBER, cells_or_none, text_of
from pipeline.readers._coordinates import Meaning, raw, settled
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._reader import Export, Found, Hints, Reader, Readings, export, settled_unit
from pipeline.readers._text import Text

_NAMES = {3: (), 4: ("target",), 5: ("group", "target")}
_AXES = ("x", "y", "z")


def recognise(lines: Sequence[str]) -> bool:
    """Every row has up to two names and three numbers between semicolons."""
    rows = [line for line in lines if line.strip()]
    if any("::" in row or row.lstrip().startswith("//") for row in rows) or _named.find(rows):
        return False
    found = [_cells(row) for row in rows]
    fitting = [cells for cells in found if len(cells) in _NAMES and all(map(_number, cells[-3:]))]
    return bool(fitting) and len(_cells(rows[0])) in _NAMES and len(fitting) > len(rows) / 2


def _cells(line: str) -> list[str]:
    cells = cells_or_none(line, ";") or []
    return cells[:-1] if cells and not cells[-1] else cells


def _number(cell: str) -> bool:
    return NUMBER.fullmatch(cell.replace(",", ".", 1)) is not None


def read(text: Text, hints: Hints) -> Export:
    """Readings of an .xyz file.

    Raises:
        InputError: The unit is not stated in campaign.toml.
    """
    first, line = next((n, line) for n, line in text.lines() if line.strip())
    names = _NAMES[len(_cells(line))]
    fields = [*(Field(name, "name") for name in names), *(Field(axis, "number") for axis in _AXES)]
    if line.rstrip().endswith(";"):
        fields.append(Field("end", "blank", needed=False))
    unit = settled_unit(None, hints, text.name, first)
    table = rows(text, Layout(tuple(fields), ";", first, hints.decimal))
    settled("cartesian", hints.coordinates, "coordinates", 'coordinates = "..."', text.name, first)
    found = Found(
        dialect=READER.name,
        rows=table,
        meaning=Meaning(unit),
        axes=_AXES,
        group="group" if "group" in names else None,
        target="target" if names else None,
    )
    return export(text, hints, found)


def write(readings: Readings, unit: str, digits: int | None) -> bytes:
    """Rows of group, target and coordinates; times are lost."""
    numbers = text_of(raw(readings.position, Meaning(unit)), digits)
    lines = [
        ";".join([group, target, *xyz])
        for group, target, xyz in zip(readings.group, readings.target, numbers, strict=True)
    ]
    return "\r\n".join([*lines, ""]).encode()


READER = Reader("semicolon xyz", recognise, read, write, suffix=".xyz", says_unit=False)
