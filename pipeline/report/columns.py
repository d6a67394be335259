"""Tables from records: what stands in each column, then one row per record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from pipeline.base.quantities import plain, with_std
from pipeline.report.record import Column, ReportTable, TableEntry, entry, text_entry

_Thing = TypeVar("_Thing")

Cells = tuple[Column, Callable[[_Thing], TableEntry]]
"""A column with what stands in it for one thing."""


def said(title: str, words: Callable[[_Thing], object], code: bool = False) -> Cells[_Thing]:
    """A column of words."""
    return Column(title, code=code), lambda thing: text_entry(words(thing))


def number(
    title: str, value: Callable[[_Thing], float | None], shown: Callable[[Any], str] = plain
) -> Cells[_Thing]:
    """A column of numbers."""
    return Column(title, numeric=True), lambda thing: entry(shown(value(thing)), value(thing))


def measured(
    title: str, both: Callable[[_Thing], tuple[float | None, float | None]]
) -> Cells[_Thing]:
    """A column of values with their standard uncertainties."""
    return Column(title, numeric=True), lambda thing: entry(with_std(*both(thing)), both(thing)[0])


def roughly(value: float | None) -> str:
    """A number to two digits."""
    return plain(value, 2)


def table_of(
    name: str,
    title: str,
    columns: Sequence[Cells[_Thing]],
    things: Iterable[_Thing],
    note: str = "",
) -> ReportTable | None:
    """A table with one row per thing; None without any."""
    rows = tuple(tuple(cell(thing) for _, cell in columns) for thing in things)
    return (
        ReportTable(name, title, tuple(column for column, _ in columns), rows, note)
        if rows
        else None
    )
