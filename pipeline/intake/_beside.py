"""A sheet with the meaning of its titles and cells, and the columns of names and times.

Titles take precedence, then the kind of the cells, then how often they change from row to row.
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
"""Evidence for the role of a column."""

_REMARKS = {"comment", "comments", "remark", "remarks", "note", "notes", "status", "state", "info",
            "bemerkung", "kommentar", "description", "type", "mode", "user", "operator", "unit",
            "units", "prism", "probe", "reflector type", "quality", "frame"}  # fmt: skip
"""Titles of columns of words that do not name points."""
_CLEARLY = 2
"""Factor by which the first of two name columns must change more often for the second to be the
group [1]."""


@dataclass(frozen=True)
class Role:
    """The role of a column, and the evidence for it."""

    role: str
    why: Why


@dataclass(frozen=True)
class SheetTable:
    """A sheet with the meaning of its titles and cells.

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
        """The columns whose cells are of a kind, except those that are taken."""
        return [k for k, c in enumerate(self.content) if c.kind == kind and k not in taken]

    def called(self, roles: Sequence[str], taken: Set[int]) -> list[int]:
        """The columns whose titles have one of some roles, except those that are taken."""
        return [k for k, c in enumerate(self.named) if c.role in roles and k not in taken]

    def numbers(self, places: Sequence[int]) -> Array:
        """Values of some columns in the rows in which all are numbers, shape (rows, columns)."""
        found = np.column_stack([values(self.content[k], self.mark) for k in places])
        return found[self.whole(places)]

    def whole(self, places: Sequence[int]) -> Bools:
        """Which rows have numbers in all of some columns, shape (rows,)."""
        found = np.column_stack([values(self.content[k], self.mark) for k in places])
        return np.asarray(np.isfinite(found).all(axis=1))

    def cells(self, place: int | None, rows: Bools) -> list[str]:
        """The cells of some rows in a column, empty if there is no such column."""
        if place is None:
            return [""] * int(rows.sum())
        return [cell for cell, row in zip(self.content[place].cells, rows, strict=True) if row]


_CALLED = ("group", "target", "reflector", "delete", "active", "instrument")
"""Roles that a column has by its title alone, whatever its cells are."""


def roles_beside(table: SheetTable, taken: set[int]) -> tuple[dict[int, Role], bool]:
    """Roles of the remaining columns (names, times, flags), and whether the names are certain.

    Names whose titles are unknown are those columns of words that differ from row to row.
    """
    roles = _called(table, taken)
    roles |= _moments(table, taken | {*roles})
    at = {one.role: place for place, one in roles.items()}
    left = [k for k in table.of_kind("word", taken | {*roles}) if _names_something(table, k)]
    if "target" not in at:
        names, stated = roles_of_words(table, left, {*at})
        return roles | names, stated
    apart = [k for k in left if "group" not in at and tells_apart(table, k, at["target"])]
    return roles | {k: Role("group", "names") for k in apart[:1]}, len(apart) <= 1


def _called(table: SheetTable, taken: set[int]) -> dict[int, Role]:
    """The first column of each role according to its title; numbers of rows come last."""
    found: dict[str, int] = {}
    free = [k for k, c in enumerate(table.content) if k not in taken and c.kind != "empty"]
    called = [k for k in free if table.named[k].role in _CALLED and not _only_counts(table, k)]
    for place in sorted(called, key=lambda k: table.named[k].title.strip(". ").lower() in _NUMBERS):
        found.setdefault(table.named[place].role.replace("reflector", "target"), place)
    return {place: Role(role, "title") for role, place in found.items()}


_NUMBERS = ("id", "nr", "no", "number", "nummer", "index", "#")
"""Titles of columns that number rows or points, where another column has their names."""


def _only_counts(table: SheetTable, place: int) -> bool:
    """Whether a column only numbers the rows, while another column of words names the targets."""
    if table.named[place].role != "target" or not table.content[place].counts:
        return False
    called = ("target", "reflector", "")
    others = [k for k in table.of_kind("word", {place}) if table.named[k].role in called]
    return any(_names_something(table, k) for k in others)


def tells_apart(table: SheetTable, place: int, target: int) -> bool:
    """Whether targets repeat and a column that changes less often distinguishes repetitions."""
    words, names = table.content[place], table.content[target]
    pairs = {*zip(words.cells, names.cells, strict=True)}
    return names.different < len(pairs) == len(names.cells) and words.runs < names.runs


def _names_something(table: SheetTable, place: int) -> bool:
    column, content = table.named[place], table.content[place]
    return (
        column.title.lower() not in _REMARKS
        and column.role != "collection"
        and (not column.title or content.different > 1 or len(content.cells) == 1)
    )


def roles_of_words(
    table: SheetTable, places: Sequence[int], known: set[str]
) -> tuple[dict[int, Role], bool]:
    """The roles of columns of words, left to right, and whether they are certain.

    Without a known group, of two columns the target is the one that changes more often from row to
    row.
    """
    if "group" in known or len(places) < len(_TWO):
        often = sorted(places, key=lambda k: -table.content[k].runs)
        return {k: Role("target", "words") for k in often[:1]}, len(places) <= 1
    first, second = places[-2:]
    swapped = table.content[first].runs > _CLEARLY * (table.content[second].runs + 1)
    stated = not (swapped or table.sheet.titled or len(places) > len(_TWO) + 1)  # and a collection
    ordered = (second, first) if swapped else (first, second)
    return {k: Role(role, "words") for k, role in zip(ordered, _TWO, strict=True)}, stated


_TWO = ("group", "target")


def _moments(table: SheetTable, taken: set[int]) -> dict[int, Role]:
    """The column of times, or those of dates and times of day; `untimed` if it has no times."""
    times, days, clocks = (table.of_kind(one, taken) for one in ("time", "date", "clock"))
    titled = table.called(("time", "clock"), taken)
    if times:
        return _time(min(times, key=lambda k: k not in titled), titled)
    if days and clocks:
        return {days[0]: Role("date", "time"), clocks[0]: Role("time", "time")}
    untitled = [k for k in clocks if not table.sheet.titles[k]]
    if readable := [k for k in (*titled, *untitled) if table.content[k].form]:
        return _time(readable[0], titled)
    return {k: Role("", "untimed") for k in (*titled, *clocks, *days)}


def _time(place: int, titled: Sequence[int]) -> dict[int, Role]:
    """The column of times, with its title or its cells as evidence."""
    return {place: Role("time", "title" if place in titled else "time")}
