"""A sheet with what its titles and cells say, and the columns beside its coordinates: names, times.

Titles come first, then what the cells are, then how often they change from row to row.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.dialects._named import Named
from pipeline.intake._contents import Content, values
from pipeline.intake._sheet import Sheet

Why = Literal["title", "words", "names", "numbers", "time", "matrix", "faces", "rigid", "range",
              "order", "stated", "empty", "untold", "untimed"]  # fmt: skip
"""What says what a column is."""

_REMARKS = {"comment", "comments", "remark", "remarks", "note", "notes", "status", "state", "info",
            "bemerkung", "kommentar", "description", "type", "mode", "user", "operator", "unit",
            "units", "prism", "probe", "reflector type", "quality", "frame"}  # fmt: skip
"""Titles of words that name no point."""
_CLEARLY = 2
"""How many times more often the first of two names has to change for the second to be the group."""


@dataclass(frozen=True)
class Role:
    """What a column is, and what says so."""

    role: str
    why: Why


@dataclass(frozen=True)
class Table:
    """A sheet with what its titles and cells say.

    Attributes:
        sheet: The cells.
        named: Columns by their titles.
        content: Columns by their cells.
        mark: The decimal mark.
    """

    sheet: Sheet
    named: tuple[Named, ...]
    content: tuple[Content, ...]
    mark: str

    def of_kind(self, kind: str, taken: Set[int] = frozenset()) -> list[int]:
        """The columns whose cells are of a kind, without those that are taken."""
        return [k for k, c in enumerate(self.content) if c.kind == kind and k not in taken]

    def numbers(self, places: Sequence[int]) -> Array:
        """Columns of numbers of the rows in which all are numbers, shape (rows, columns)."""
        found = np.column_stack([values(self.content[k], self.mark) for k in places])
        return found[self.whole(places)]

    def whole(self, places: Sequence[int]) -> Bools:
        """Which rows have numbers in all of some columns, shape (rows,)."""
        found = np.column_stack([values(self.content[k], self.mark) for k in places])
        return np.asarray(np.isfinite(found).all(axis=1))

    def cells(self, place: int | None, rows: Bools) -> list[str]:
        """The cells of some rows in a column, empty where there is no such column."""
        if place is None:
            return [""] * int(rows.sum())
        return [cell for cell, row in zip(self.content[place].cells, rows, strict=True) if row]


_CALLED = ("group", "target", "reflector", "delete", "active", "instrument")
"""Columns that are what their title says, whatever their cells are."""


def roles_beside(table: Table, taken: set[int]) -> tuple[dict[int, Role], bool]:
    """Names, times and flags of the columns that are left, and whether the names are beyond doubt.

    Names whose titles nobody knows are those columns of words that differ.
    """
    roles = _called(table, taken)
    roles |= _moments(table, taken | {*roles})
    at = {one.role: place for place, one in roles.items()}
    left = [k for k in table.of_kind("word", taken | {*roles}) if _names_something(table, k)]
    if "target" not in at:
        names, told = roles_of_words(table, left, {*at})
        return roles | names, told
    apart = [k for k in left if "group" not in at and tells_apart(table, k, at["target"])]
    return roles | {k: Role("group", "names") for k in apart[:1]}, len(apart) <= 1


def _called(table: Table, taken: set[int]) -> dict[int, Role]:
    """The first column of each kind that its title calls so; numbers of rows come last."""
    found: dict[str, int] = {}
    free = [k for k, c in enumerate(table.content) if k not in taken and c.kind != "empty"]
    called = [k for k in free if table.named[k].role in _CALLED and not _only_counts(table, k)]
    for place in sorted(called, key=lambda k: table.named[k].title.strip(". ").lower() in _NUMBERS):
        found.setdefault(table.named[place].role.replace("reflector", "target"), place)
    return {place: Role(role, "title") for role, place in found.items()}


_NUMBERS = ("id", "nr", "no", "number", "nummer", "index", "#")
"""Titles of what numbers rows or points, where another column has their names."""


def _only_counts(table: Table, place: int) -> bool:
    """Whether a column numbers the rows, beside words that name the targets."""
    if table.named[place].role != "target" or not table.content[place].counts:
        return False
    called = ("target", "reflector", "")
    others = [k for k in table.of_kind("word", {place}) if table.named[k].role in called]
    return any(_names_something(table, k) for k in others)


def tells_apart(table: Table, place: int, target: int) -> bool:
    """Whether targets come again, and a column that changes less often says which time it is."""
    words, names = table.content[place], table.content[target]
    pairs = {*zip(words.cells, names.cells, strict=True)}
    return names.different < len(pairs) == len(names.cells) and words.runs < names.runs


def _names_something(table: Table, place: int) -> bool:
    column, content = table.named[place], table.content[place]
    return (
        column.title.lower() not in _REMARKS
        and column.role != "collection"
        and (not column.title or content.different > 1 or len(content.cells) == 1)
    )


def roles_of_words(
    table: Table, places: Sequence[int], known: set[str]
) -> tuple[dict[int, Role], bool]:
    """The roles of columns of words, left to right, and whether they are beyond doubt.

    Beside a group the target is what changes most often from row to row.
    """
    if "group" in known or len(places) < len(_TWO):
        often = sorted(places, key=lambda k: -table.content[k].runs)
        return {k: Role("target", "words") for k in often[:1]}, len(places) <= 1
    first, second = places[-2:]
    swapped = table.content[first].runs > _CLEARLY * (table.content[second].runs + 1)
    told = not (swapped or table.sheet.titled or len(places) > len(_TWO) + 1)  # and a collection
    ordered = (second, first) if swapped else (first, second)
    return {k: Role(role, "words") for k, role in zip(ordered, _TWO, strict=True)}, told


_TWO = ("group", "target")


def _moments(table: Table, taken: set[int]) -> dict[int, Role]:
    """The column of times, or those of dates and times of day; what only should hold times."""
    times, days, clocks = (table.of_kind(one, taken) for one in ("time", "date", "clock"))
    should = [k for k, c in enumerate(table.named) if c.role == "time" and k not in taken]
    for place in (k for k in times if k in should):
        return {place: Role("time", "title")}
    if times:
        return {times[0]: Role("time", "time")}
    if days and clocks:
        return {days[0]: Role("date", "time"), clocks[0]: Role("time", "time")}
    return {k: Role("", "untimed") for k in (*should, *clocks, *days)}
