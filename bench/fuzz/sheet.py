"""A table as rows of cells, whatever its format, to be spoilt and written again."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bench.fuzz.mutation import Files, data_of, one, tables, text

NUMBER = re.compile(r"\s*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\s*")


@dataclass(frozen=True)
class Sheet:
    """A table.

    Attributes:
        rows: Cells of every line.
        delimiter: Delimiter of the cells.
        ending: Line end.
        first: Index of the first row behind the titles.
    """

    rows: tuple[tuple[str, ...], ...]
    delimiter: str
    ending: str
    first: int

    @property
    def titles(self) -> tuple[str, ...]:
        """Titles of the columns; empty if the file has none."""
        return self.rows[self.first - 1] if self.first else ()

    @property
    def body(self) -> tuple[tuple[str, ...], ...]:
        """Rows behind the titles."""
        return self.rows[self.first :]

    def with_body(self, body: list[tuple[str, ...]]) -> Sheet:
        """The same titles with other rows."""
        return replace(self, rows=(*self.rows[: self.first], *body))

    def column(self, title: str) -> int | None:
        """Index of the first column whose title begins with `title`; None if there is none."""
        hits = [k for k, name in enumerate(self.titles) if name.strip().startswith(title)]
        return hits[0] if hits else None

    def with_column(self, k: int, values: list[str]) -> Sheet:
        """The table with other cells in one column."""
        pairs = zip(self.body, values, strict=True)
        return self.with_body([put(row, k, value) for row, value in pairs])

    def numbers(self) -> list[tuple[int, int]]:
        """Row and column of every cell that is a number."""
        return [
            (r, c)
            for r, row in enumerate(self.rows)
            if r >= self.first
            for c, cell in enumerate(row)
            if NUMBER.fullmatch(cell)
        ]

    def written(self) -> bytes:
        """Content of the table as a file."""
        return data_of(self.ending.join(self.delimiter.join(row) for row in (*self.rows, ())))


def put(row: tuple[str, ...], k: int, value: str) -> tuple[str, ...]:
    """A row with one cell replaced."""
    return (*row[:k], value, *row[k + 1 :]) if k < len(row) else row


def sheet(data: bytes) -> Sheet:
    """A file as a table; its titles are the row above the first one with a number."""
    content = text(data)
    ending = "\r\n" if "\r\n" in content else "\n"
    lines = content.split(ending)
    lines = lines[:-1] if lines and not lines[-1] else lines
    delimiter = max(";,\t", key=content.count)
    rows = tuple(tuple(line.split(delimiter)) for line in lines)
    first = next((k for k, row in enumerate(rows) if any(map(NUMBER.fullmatch, row))), 0)
    return Sheet(rows, delimiter, ending, first)


Edit = Callable[[Sheet, np.random.Generator], Sheet]


def on_any(edit: Edit) -> Callable[[Files, np.random.Generator], Files]:
    """A mutation of a random table of the campaign."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        names = [name for name in tables(files) if files[name]]
        return on(one(rng, names), edit)(files, rng) if names else files

    return act


def on(name: str, edit: Edit) -> Callable[[Files, np.random.Generator], Files]:
    """A mutation of the table whose name begins with `name`; no change without it."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        hits = [each for each in tables(files) if each.startswith(name) and files[each]]
        if not hits:
            return files
        read = sheet(files[hits[0]])
        if not read.body:
            return files
        return {**files, hits[0]: edit(read, rng).written()}

    return act
