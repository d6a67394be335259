"""SpatialAnalyzer's ASCII point export: `Collection::Group::Target, X, Y, Z` and `//` comments."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from pipeline.readers._delimited import MOMENT, Field, Layout, rows
from pipeline.readers._reader import Export, Hints, Reader, metres, settled_unit
from pipeline.readers._text import Text, replaced

COMMENT = "//"
UNIT = re.compile(
    r"\bunits?\b[^A-Za-z]*(?:of length)?[^A-Za-z]*"
    r"(?:(?P<mm>mm|millimet(?:er|re)s?)|(?P<m>m|met(?:er|re)s?)|(?P<in>in|inch(?:es)?))\b",
    re.IGNORECASE,
)
FIELDS = (
    Field("collection", "any", needed=False),
    Field("group", "name"),
    Field("target", "name"),
    Field("X", "number"),
    Field("Y", "number"),
    Field("Z", "number"),
)


def recognise(lines: Sequence[str]) -> bool:
    """The first row that is no comment has a name of three parts and three more cells."""
    row = next(
        (line for line in lines if line.strip() and not line.lstrip().startswith(COMMENT)), ""
    )
    name, *numbers = [cell.strip() for cell in row.split(_delimiter(row))]
    return name.count("::") == 2 and len(numbers) >= 3


def read(text: Text, hints: Hints) -> Export:
    """Readings of a SpatialAnalyzer export.

    Raises:
        InputError: The unit is not stated.
    """
    first, row = next(
        (n, line)
        for n, line in text.lines()
        if line.strip() and not line.lstrip().startswith(COMMENT)
    )
    delimiter = _delimiter(row)
    unit = settled_unit(_unit(text, first), hints, text.name)
    split = replaced(text, b"::", delimiter.encode())
    table = rows(split, Layout(FIELDS, delimiter, first, hints.decimal, COMMENT))
    raw = np.column_stack([np.asarray(table.columns[axis]) for axis in ("X", "Y", "Z")])
    return Export(
        dialect=READER.name,
        unit=unit,
        coordinates="cartesian",
        group=table.columns["group"],
        target=table.columns["target"],
        position=metres(raw, unit),
        covariance=None,
        covariance_kind=None,
        time=pa.nulls(len(table.line), MOMENT),
        line=table.line,
        rejected=table.rejected,
    )


def _delimiter(row: str) -> str:
    return next((mark for mark in (";", "\t") if row.count(mark) >= 3), ",")


def _unit(text: Text, rows_from: int) -> str | None:
    """The unit a header comment states, `// Units: mm`."""
    for _, line in text.lines(1, rows_from - 1):
        found = UNIT.search(line)
        if found:
            return next(unit for unit, word in found.groupdict().items() if word)
    return None


READER = Reader("SpatialAnalyzer ASCII", recognise, read)
