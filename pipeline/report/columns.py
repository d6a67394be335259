"""Tables from records: the columns with their contents, then one row per record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from pipeline.base.quantities import plain, with_std
from pipeline.report.record import Column, ReportTable, TableEntry, entry, text_entry

_Thing = TypeVar("_Thing")

Cells = tuple[Column, Callable[[_Thing], TableEntry]]
"""A column, and the function that gives its cell for one record."""


def word_column(title: str, words: Callable[[_Thing], object], code: bool = False) -> Cells[_Thing]:
    """A column of words."""
    return Column(title, code=code), lambda thing: text_entry(words(thing))


def number_column(
    title: str, value: Callable[[_Thing], float | None], shown: Callable[[Any], str] = plain
) -> Cells[_Thing]:
    """A column of numbers."""
    return Column(title, numeric=True), lambda thing: entry(shown(value(thing)), value(thing))


def measured_column(
    title: str, both: Callable[[_Thing], tuple[float | None, float | None]]
) -> Cells[_Thing]:
    """A column of values with their standard uncertainties."""
    return Column(title, numeric=True), lambda thing: entry(with_std(*both(thing)), both(thing)[0])


def roughly(value: float | None) -> str:
    """A number to two significant digits."""
    return plain(value, 2)


def table_of(
    name: str,
    title: str,
    columns: Sequence[Cells[_Thing]],
    things: Iterable[_Thing],
    note: str = "",
) -> ReportTable | None:
    """A table with one row per record; None without records."""
    rows = tuple(tuple(cell(thing) for _, cell in columns) for thing in things)
    return (
        ReportTable(name, title, tuple(column for column, _ in columns), rows, note)
        if rows
        else None
    )
