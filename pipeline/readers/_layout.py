"""How delimited rows are written, and the typed columns that come of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.readers import _time

DELIMITERS = (",", ";", "\t", "|")
JOINT = "::"
"""Between collection, group and target in SpatialAnalyzer's names."""


def delimiter_of(line: str, otherwise: str = DELIMITERS[0]) -> str:
    """What separates the cells of a line of titles: the sign that it has most of."""
    found = max(DELIMITERS, key=line.count)
    return found if found in line else otherwise


Kind = Literal["name", "number", "time", "blank", "any"]


@dataclass(frozen=True)
class Field:
    """One column of a row.

    Attributes:
        name: What it is called in the result.
        kind: `name`, `number`, `time`, `blank` (must be empty) or `any` (not looked at).
        needed: Whether the cell may not be empty.
        title: What the file calls it, where that is something else.
        unit: What stands behind the number in its cells, too: `702.3 N`.
    """

    name: str
    kind: Kind
    needed: bool = True
    title: str = ""
    unit: str = ""

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
        table: Table of campaign.toml that may say the decimal mark; None where none may.
    """

    fields: tuple[Field, ...]
    delimiter: str
    first: int
    decimal: str | None = None
    comment: str | None = None
    moment: str = _time.ISO
    joined: int = 0
    table: str | None = "tracker"


@dataclass(frozen=True, eq=False)
class TypedRows(Locked):
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

    def only(self, good: Bools, why_not: str) -> TypedRows:
        """The rows that are good; the others are rejected for one reason."""
        if good.all():
            return self
        lost = tuple((int(line), why_not) for line in self.line[~good])
        columns, rejected = sifted(self.columns, good), (*self.rejected, *lost)
        return TypedRows(columns, self.line[good], self.order[good], rejected)

    def without(self, bad: Mapping[int, str]) -> TypedRows:
        """The rows but some, each rejected for its own reason, by row from 0."""
        good = np.ones(len(self.line), dtype=bool)
        good[list(bad)] = False
        lost = tuple((int(self.line[row]), why) for row, why in sorted(bad.items()))
        kept = self.only(good, "")
        return self if not bad else replace(kept, rejected=(*self.rejected, *lost))

    def floats(self, name: str) -> Array:
        """A column of numbers, NaN where a cell is empty, shape (n,)."""
        return np.array(self.columns[name].fill_null(np.nan), dtype=float)
