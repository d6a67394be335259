"""The plain CSV: group, target, x_mm, y_mm, z_mm and, where known, time.

Coordinates may be in m, mm or inches, said in the column names. Other columns are not looked at.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from pipeline.errors import InputError
from pipeline.readers import _header
from pipeline.readers._delimited import MOMENT, Field, Layout, rows
from pipeline.readers._reader import UNITS, Export, Hints, Reader, metres, settled_unit
from pipeline.readers._text import Text

AXES = ("x", "y", "z")


def recognise(lines: Sequence[str]) -> bool:
    """The first line that is not blank has columns `group` and `target` or two coordinates."""
    header = next((line for line in lines if line.strip()), "")
    found = _header.names(header, _header.delimiter_of(header))
    axes = sum(_header.suffixed(found, axis, UNITS) is not None for axis in AXES)
    return ("group" in found) + ("target" in found) + axes >= 3 and axes >= 1


def read(text: Text, hints: Hints) -> Export:
    """Readings of a plain CSV.

    Raises:
        InputError: A column or the unit is missing.
    """
    first, header = next((n, line) for n, line in text.lines() if line.strip())
    delimiter = _header.delimiter_of(header)
    found = _header.names(header, delimiter)
    _header.unique(found, text.name, first)
    axes, unit = _axes(found, hints, text.name, first)
    fields = tuple(_field(name, axes) for name in found)
    table = rows(text, Layout(fields, delimiter, first + 1, hints.decimal))
    raw = np.column_stack([np.asarray(table.columns[axis]) for axis in axes])
    n = len(table.line)
    return Export(
        dialect=READER.name,
        unit=unit,
        coordinates="cartesian",
        group=table.columns["group"],
        target=table.columns["target"],
        position=metres(raw, unit),
        covariance=None,
        covariance_kind=None,
        time=table.columns.get("time", pa.nulls(n, MOMENT)),
        line=table.line,
        rejected=table.rejected,
    )


def _axes(found: list[str], hints: Hints, file: str, line: int) -> tuple[list[str], str]:
    columns = [_header.suffixed(found, axis, UNITS) for axis in AXES]
    for name, there in zip(
        ("group", "target", *AXES), ("group" in found, "target" in found, *columns), strict=True
    ):
        if not there:
            example = f"{name}_mm" if name in AXES else name
            raise InputError(
                f"there is no column {example}",
                "add it to the header and to every row",
                file=file,
                line=line,
            )
    stated = {column[1] for column in columns if column}
    if len(stated) > 1:
        raise InputError(
            f"x, y and z have different units ({', '.join(str(c[0]) for c in columns if c)})",
            "export all three in the same unit",
            file=file,
            line=line,
        )
    unit = settled_unit(stated.pop(), hints, file, line)
    return [column[0] for column in columns if column], unit


def _field(name: str, axes: list[str]) -> Field:
    if name in ("group", "target"):
        return Field(name, "name")
    if name in axes:
        return Field(name, "number")
    if name == "time":
        return Field(name, "time", needed=False)
    return Field(name, "any" if name else "blank", needed=False)


READER = Reader("plain CSV", recognise, read)
