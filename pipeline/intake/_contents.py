"""What the cells of a column are, whatever it is called: numbers, names, times, nothing."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array
from pipeline.intake._sheet import Sheet
from pipeline.readers import _time
from pipeline.readers._cells import bare_number, is_number
from pipeline.readers._delimited import decimal_mark

_MOST = 0.8
"""Share of the filled cells that make a column what it is; the others are damaged."""
_FEW = 3
"""Rows that are too few to say that a column numbers them, less one."""
_DAY = re.compile(r"[0-9]{1,2}\.[0-9]{1,2}\.([0-9]{2}|[0-9]{4})|[0-9]{4}-[0-9]{2}-[0-9]{2}"
                  r"|[0-9]{1,2}/[0-9]{1,2}/([0-9]{2}|[0-9]{4})")  # fmt: skip
_CLOCK = re.compile(r"'?[0-9]{1,2}:[0-9]{2}(:[0-9]{2}([.,][0-9]+)?)?")


@dataclass(frozen=True)
class Content:
    """One column of the sampled rows.

    Attributes:
        cells: As written.
        kind: `number`, `time`, `date`, `clock`, `word` or `empty`.
        form: How times are written, None where there are none.
    """

    cells: tuple[str, ...]
    kind: str
    form: str | None = None

    @property
    def example(self) -> str:
        """The first cell that is filled in."""
        return next(filter(None, self.cells), "")

    @property
    def different(self) -> int:
        """How many different cells there are."""
        return len({*self.cells})

    @property
    def runs(self) -> int:
        """How often the cell changes from row to row."""
        return sum(a != b for a, b in itertools.pairwise(self.cells))

    @property
    def counts(self) -> bool:
        """Whether it numbers the rows: whole numbers, each one more than the one before."""
        filled = [cell for cell in self.cells if cell]
        if len(filled) < _FEW or not all(map(str.isdecimal, filled)):
            return False
        return all(int(b) - int(a) == 1 for a, b in itertools.pairwise(filled))

    @property
    def whole(self) -> bool:
        """Whether all are digits only: a number in a row, or a name."""
        return all(cell.isascii() and cell.isdigit() for cell in self.cells)


def contents(sheet: Sheet) -> tuple[Content, ...]:
    """What each column of a sheet holds."""
    return tuple(map(_content, sheet.columns))


def _content(cells: tuple[str, ...]) -> Content:
    filled = [cell for cell in cells if cell]
    if not filled:
        return Content(cells, "empty")
    form = _time.form_of_all(filled, _MOST)
    if form:
        return Content(cells, "time", form)
    for kind, test in (
        ("number", is_number),
        ("date", _DAY.fullmatch),
        ("clock", _CLOCK.fullmatch),
    ):
        if sum(bool(test(cell)) for cell in filled) >= _MOST * len(filled):
            return Content(cells, kind)
    return Content(cells, "word")


def mark_of(columns: Sequence[Content], lines: Sequence[int]) -> str:
    """The decimal mark of columns of numbers.

    Raises:
        InputError: Every comma may stand between thousands.
    """
    cells = [pa.array(map(bare_number, column.cells), pa.string()) for column in columns]
    return decimal_mark(cells, np.array(lines), "tracker") if cells else "."


def values(content: Content, mark: str) -> Array:
    """The numbers of a column, NaN where a cell is none, shape (rows,)."""
    return np.array([_value(cell, mark) for cell in content.cells])


def _value(cell: str, mark: str) -> float:
    cell = bare_number(cell).replace(mark, ".")
    return float(cell) if is_number(cell) and "," not in cell else float("nan")
