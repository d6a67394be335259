"""Kind of the cells of a column, whatever its title: numbers, names, times, nothing."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array
from pipeline.dialects import _time
from pipeline.dialects._cells import bare_number, is_number
from pipeline.dialects._delimited import decimal_mark
from pipeline.intake._sheet import Sheet

_MOST = 0.8
"""Minimum fraction of the filled cells that determine the kind of a column [1]; the others are
damaged."""
_FEW = 3
"""Minimum number of rows for a column to count as numbering them."""
_WHOLE = re.compile(r"[0-9]{1,18}")
_COUNTED = re.compile(r"[0-9]{1,9} ?[^\W\d_]{0,4}")
_DAY = re.compile(r"[0-9]{1,2}\.[0-9]{1,2}\.([0-9]{2}|[0-9]{4})|[0-9]{4}-[0-9]{2}-[0-9]{2}"
                  r"|[0-9]{1,2}/[0-9]{1,2}/([0-9]{2}|[0-9]{4})")  # fmt: skip
_CLOCK = re.compile(r"'?[0-9]{1,2}:[0-9]{2}(:[0-9]{2}([.,][0-9]+)?)?")


@dataclass(frozen=True)
class Content:
    """One column of the sampled rows.

    Attributes:
        cells: As written.
        kind: `number`, `time`, `date`, `clock`, `word` or `empty`.
        form: Format of the times, None where there are none.
    """

    cells: tuple[str, ...]
    kind: str
    form: str | None = None

    @property
    def example(self) -> str:
        """The first filled cell."""
        return next(filter(None, self.cells), "")

    @property
    def different(self) -> int:
        """Number of different cells."""
        return len({*self.cells})

    @property
    def runs(self) -> int:
        """Number of changes of the cell from row to row."""
        return sum(a != b for a, b in itertools.pairwise(self.cells))

    @property
    def counts(self) -> bool:
        """Whether it numbers the rows: whole numbers, each one more than the previous."""
        filled = [cell for cell in self.cells if cell]
        if len(filled) < _FEW or not all(map(is_count, filled)):
            return False
        return all(int(b) - int(a) == 1 for a, b in itertools.pairwise(filled))

    @property
    def counted(self) -> bool:
        """Whether most filled cells are whole numbers, perhaps with letters behind them."""
        filled = [cell for cell in self.cells if cell]
        return 2 * sum(bool(_COUNTED.fullmatch(cell)) for cell in filled) > len(filled)

    @property
    def whole(self) -> bool:
        """Whether all cells consist of digits only: a row number, or a name."""
        return all(cell.isascii() and cell.isdigit() for cell in self.cells)


def is_count(cell: str) -> bool:
    """Whether it is a whole number that can count: Python converts none of thousands of digits."""
    return _WHOLE.fullmatch(cell) is not None


def contents(sheet: Sheet) -> tuple[Content, ...]:
    """Content of each column of a sheet."""
    return tuple(map(_content, sheet.columns))


def _content(cells: tuple[str, ...]) -> Content:
    filled = [cell for cell in cells if cell]
    if not filled:
        return Content(cells, "empty")
    form = _time.form_of_all(filled, _MOST)
    if form:
        return Content(cells, "clock" if form in _time.OF_DAY else "time", form)
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
        InputError: Every comma may be a thousands separator.
    """
    cells = [pa.array(map(bare_number, column.cells), pa.string()) for column in columns]
    return decimal_mark(cells, np.array(lines), "tracker") if cells else "."


def values(content: Content, mark: str) -> Array:
    """The numbers of a column, NaN where a cell is not one, shape (rows,)."""
    return np.array([_value(cell, mark) for cell in content.cells])


def _value(cell: str, mark: str) -> float:
    cell = bare_number(cell).replace(mark, ".")
    return float(cell) if is_number(cell) and "," not in cell else float("nan")
