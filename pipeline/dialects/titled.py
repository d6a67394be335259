"""Read a table with titles similar to those of our own CSV, or with rows that are not readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.base.errors import InputError, listed
from pipeline.dialects import _named, _tables
from pipeline.dialects._titles import titled
from pipeline.readers import plain
from pipeline.readers._reader import Export
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings

_NEEDED = ("group", "target", "x", "y", "z")
_ENOUGH = 3
"""Number of these columns that identify the dialect [1]; missing ones are then asked for."""


def recognise(lines: Sequence[str]) -> bool:
    """Whether the first line that is not blank has three of the five columns, with `group`."""
    header = _named.header(next((line for line in lines if line.strip()), ""), 1)
    exact = {column.title.lower() for column in header.columns}
    there = sum(header.has(role) for role in _NEEDED)
    other = any(column.role == "target" for column in titled([c.title for c in header.columns]))
    return there >= _ENOUGH and "group" in exact and ("target" in exact or not other)


def read(text: Text, hints: ExportSettings) -> Export:
    """Read such a table.

    Raises:
        InputError: A column or the unit is missing.
    """
    line, first = text.first()
    header = _named.header(first, line)
    lacking = [role for role in _NEEDED if not header.has(role)]
    if lacking:
        titles = [f"{role}_mm" if role in "xyz" else role for role in lacking]
        raise InputError(
            f"there is no column {listed(titles)}",
            "add it to the header and to every row",
            line=line,
        )
    remark = _named.remark(text, header)
    return _tables.read(text, hints, header, READER.name, remark)


READER = replace(plain.READER, recognise=recognise)
"""Our own CSV, also if written by other programs."""
