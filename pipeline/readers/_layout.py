"""Layout of delimited rows, and the typed columns read from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from dataclasses import field as with_default
from typing import Literal

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.readers._iso import ISO

JOINT = "::"
"""Separator of collection, group and target in SpatialAnalyzer's names."""

Kind = Literal["name", "number", "time", "blank", "any"]


@dataclass(frozen=True)
class Field:
    """One column of a row.

    Attributes:
        name: Name in the result.
        kind: `name`, `number`, `time`, `blank` (must be empty) or `any` (not read).
        needed: Whether the cell must not be empty.
        title: Title in the file, if different.
        unit: Unit that follows the number in its cells: `702.3 N`.
        named: Whether its numbers may have one name before them: `P01`.
        units: Factors from units that may follow a single number to that of the column.
    """

    name: str
    kind: Kind
    needed: bool = True
    title: str = ""
    unit: str = ""
    named: bool = False
    units: Mapping[str, float] = with_default(default_factory=dict)

    @property
    def said(self) -> str:
        """Name used in messages."""
        return self.title or self.name


@dataclass(frozen=True)
class Layout:
    """Layout of delimited rows.

    Attributes:
        fields: The columns, left to right.
        delimiter: Separator of the columns.
        first: Line number of the first row, counted from 1.
        decimal: `.` or `,`, or None to determine it from the file.
        comment: Start of comment lines.
        moment: Format of times, `_time.ISO` or a `strptime` format.
        joined: How many of the first fields share one cell, separated by `::`; 0 for none.
        table: Table of campaign.toml that may state the decimal mark; None if none may.
    """

    fields: tuple[Field, ...]
    delimiter: str
    first: int
    decimal: str | None = None
    comment: str | None = None
    moment: str = ISO
    joined: int = 0
    table: str | None = "tracker"


@dataclass(frozen=True, eq=False)
class TypedRows(Locked):
    """Typed columns of the rows that could be read.

    Attributes:
        columns: Columns by name; dictionaries of strings, float64 or timestamps.
        line: Line number of each row, shape (n,).
        order: Number of each row among all rows, including rejected ones, from 1, shape (n,).
        rejected: Line and reason of the rows that could not be read.
    """

    columns: dict[str, pa.Array]
    line: Ints
    order: Ints
    rejected: tuple[tuple[int, str], ...]

    def only(self, good: Bools, why_not: str) -> TypedRows:
        """Keep the good rows; reject the others, all for the same reason."""
        if good.all():
            return self
        lost = tuple((int(line), why_not) for line in self.line[~good])
        columns, rejected = sifted(self.columns, good), (*self.rejected, *lost)
        return TypedRows(columns, self.line[good], self.order[good], rejected)

    def without(self, bad: Mapping[int, str]) -> TypedRows:
        """Reject some rows, each for its own reason, by row index from 0."""
        good = np.ones(len(self.line), dtype=bool)
        good[list(bad)] = False
        lost = tuple((int(self.line[row]), why) for row, why in sorted(bad.items()))
        return self if not bad else replace(self.only(good, ""), rejected=(*self.rejected, *lost))

    def floats(self, name: str) -> Array:
        """A numeric column, NaN where a cell is empty, shape (n,)."""
        return np.array(self.columns[name].fill_null(np.nan), dtype=float)
