"""What the parts of the report have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from pipeline.report.record import Block, Column, Entry, Section, Table

_Thing = TypeVar("_Thing")

Cells = tuple[Column, Callable[[_Thing], Entry]]
"""A column with what stands in it for one thing."""


def table_of(
    name: str,
    title: str,
    columns: Sequence[Cells[_Thing]],
    things: Iterable[_Thing],
    note: str = "",
) -> Table | None:
    """A table with one row per thing; None without any."""
    rows = tuple(tuple(cell(thing) for _, cell in columns) for thing in things)
    return Table(name, title, tuple(column for column, _ in columns), rows, note) if rows else None


def section_of(key: str, title: str, blocks: Iterable[Block | None]) -> Section | None:
    """A part with the blocks that are there, None when none is."""
    kept = tuple(block for block in blocks if block is not None)
    return Section(key, title, kept) if kept else None


def bracketed(text: str) -> str:
    """A value with its uncertainty, in brackets where a unit follows."""
    return f"({text})" if "±" in text and not text.startswith("(") else text
