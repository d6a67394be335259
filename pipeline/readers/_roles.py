"""What each column of a sheet seems to be, with what says so; and what may be otherwise.

Titles come first, then what the cells are, then geometry. Where nothing but its place speaks for a
column, and another reading makes as much sense, both are handed on.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, at, listed
from pipeline.readers import _polar
from pipeline.readers._cells import is_number
from pipeline.readers._contents import Content, values
from pipeline.readers._coordinates import AXES
from pipeline.readers._named import Named
from pipeline.readers._polar import Polar
from pipeline.readers._sheet import Sheet, cells_of
from pipeline.readers._titles import (
    Triple,
    is_quantity,
    no_level_range,
    numbered,
    titled,
    triples,
    uncertainties,
)

Why = Literal["title", "words", "names", "numbers", "time", "matrix", "faces", "rigid", "range",
              "order", "stated", "empty", "untold", "untimed"]  # fmt: skip
"""What says what a column is."""

_INSTRUMENT = re.compile(r"(instrument|station|tracker|stn|standpunkt)[ _:-]*\w*", re.IGNORECASE)
_REMARKS = {"comment", "comments", "remark", "remarks", "note", "notes", "status", "state", "info",
            "bemerkung", "kommentar", "description", "type", "mode", "user", "operator", "unit",
            "units", "prism", "probe", "reflector type", "quality", "frame"}  # fmt: skip
"""Titles of words that name no point."""
_CLEARLY = 2
"""How many times more often the first of two names has to change for the second to be the group."""
_JOINT = "::"
"""Between group and target in SpatialAnalyzer's names."""
_MATRIX = 9
"""Cells of a covariance, row by row."""
_SYMMETRIC = 1e-3
"""How well its halves agree, over the roots of the diagonal: four digits are printed."""
_SIX = {"cxx": 0, "cxy": 1, "cxz": 2, "cyy": 4, "cyz": 5, "czz": 8}
"""Where the six numbers of a covariance stand in it."""


@dataclass(frozen=True)
class Role:
    """What a column is, and what says so."""

    role: str
    why: Why


@dataclass(frozen=True)
class Reading:
    """One way to read the columns of a sheet.

    Attributes:
        kind: `cartesian`, `spherical` or `cylindrical`.
        roles: By place, counted from 0: the words of [tracker.mapping] columns.
        ways: How distance and angles may be read in the columns that have these roles, as far as
            the numbers say it; empty where titles do.
        open: What has to be asked before it can be taken, None where nothing else makes sense.
    """

    kind: str
    roles: Mapping[int, Role]
    ways: tuple[Polar, ...] = ()
    open: Literal["columns", "coordinates"] | None = None

    def place(self, role: str) -> int | None:
        """The column of a role."""
        return next((k for k, one in self.roles.items() if one.role == role), None)


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


def named(sheet: Sheet) -> tuple[Named, ...]:
    """The columns of a sheet as their titles call them."""
    return titled(sheet.titles)


_ANGLES = {"azimuth", "vertical", "zenith", "elevation"}


def readings(table: Table, kind: str | None, unit: str | None) -> list[Reading]:
    """Every way to read a table that makes sense, the most plausible one first.

    Args:
        table: The table.
        kind: Kind of its coordinates where the file or somebody says it.
        unit: Unit of length, likewise.

    Raises:
        InputError: A row holds several targets, or its distance is no range.
    """
    number = {k for k, c in enumerate(table.content) if c.kind == "number"}
    sets = [one for one in triples(table.named) if number.issuperset(one.columns)]
    if sets:
        return _by_titles(table, sets)
    if _ANGLES & {c.role for c in table.named}:
        with at(line=table.sheet.header):
            no_level_range(column.title for column in table.named)
    if "x" in {c.role for c in table.named} or table.sheet.stray:
        return _doubted(_by_numbers(table, number, kind, unit))
    found = _by_numbers(table, number, kind, unit)
    return _doubted(found) if table.sheet.titled and not _known_titles(table) else found


def _doubted(found: list[Reading]) -> list[Reading]:
    return [replace(one, open="columns") for one in found]


def _known_titles(table: Table) -> bool:
    """Whether the titles above the numbers leave them open, and are not others' quantities."""
    return all(
        not column.title
        for column, content in zip(table.named, table.content, strict=True)
        if content.kind == "number" and column.role != "target"
    )


def _by_titles(table: Table, sets: Sequence[Triple]) -> list[Reading]:
    """One reading for each set of three coordinates that the titles name."""
    _one_target(table, sets)
    out, sure = [], len(sets) == 1
    for one in sets:
        columns = zip(one.columns, one.roles, strict=True)
        roles = {place: Role(_plain(role), "title") for place, role in columns}
        if one.kind == "cartesian":
            beside = uncertainties(table.named, one)
            roles |= {k: Role(_mapped(role), "title") for k, role in beside.items()}
            roles |= _titled_matrix(table)
        others, told = _others(table, {*roles})
        out.append(Reading(one.kind, roles | others))
        sure = sure and one.plain and told
    return out if sure else _doubted(out)


def _one_target(table: Table, sets: Sequence[Triple]) -> None:
    """Each row has one target: no x, y, z beside those of another, as cameras write them.

    Raises:
        InputError: It has several.
    """
    found = [one for one in sets if one.kind == "cartesian" and not one.nominal]
    sheet = table.sheet
    lines = [cells_of(line, sheet.delimiter) or [] for line in sheet.preamble]
    rows = [[cells[k] for k in [one.columns[0] for one in found]]
            for cells in lines if len(cells) == len(sheet.titles)]  # fmt: skip
    rows.append(numbered([table.named[one.columns[0]] for one in found]))
    for names in rows:
        told = all(names) and not any(is_quantity(one) or is_number(one) for one in names)
        if len({*names}) > 1 and told:
            raise InputError(
                f"each row holds x, y, z of several targets ({listed(dict.fromkeys(names))})",
                "write a row for each target, with its name: time,target,x_mm,y_mm,z_mm",
                line=sheet.header,
            )


def _plain(role: str) -> str:
    return "vertical" if role in ("zenith", "elevation") else role


def _mapped(role: str) -> str:
    """The word of a mapping for a role of a title."""
    return role.replace("std ", "s").replace("u95 ", "u95_")


def _titled_matrix(table: Table) -> dict[int, Role]:
    """The columns of a covariance, where all six have their titles."""
    at = {c.title.lower(): k for k, c in enumerate(table.named)}
    return {at[name]: Role(name, "title") for name in _SIX} if at.keys() >= _SIX.keys() else {}


# --- names and times ------------------------------------------------------------------------------


_CALLED = ("group", "target", "reflector", "delete", "active", "instrument")
"""Columns that are what their title says, whatever their cells are."""


def _others(table: Table, taken: set[int]) -> tuple[dict[int, Role], bool]:
    """Names, times and flags of the columns that are left, and whether the names are beyond doubt.

    Names whose titles nobody knows are those columns of words that differ.
    """
    roles = _called(table, taken)
    roles |= _moments(table, taken | {*roles})
    at = {one.role: place for place, one in roles.items()}
    left = [k for k in _words(table, taken | {*roles}) if _names_something(table, k)]
    if "target" not in at:
        names, told = _names(table, left, {*at})
        return roles | names, told
    apart = [k for k in left if "group" not in at and _tells_apart(table, k, at["target"])]
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
    others = [
        k for k in _words(table, {place}) if table.named[k].role in ("target", "reflector", "")
    ]
    return any(_names_something(table, k) for k in others)


def _tells_apart(table: Table, place: int, target: int) -> bool:
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


def _words(table: Table, taken: set[int]) -> list[int]:
    return [k for k, c in enumerate(table.content) if c.kind == "word" and k not in taken]


def _names(table: Table, places: Sequence[int], known: set[str]) -> tuple[dict[int, Role], bool]:
    """The roles of columns of words, left to right, and whether they are beyond doubt."""
    if "group" in known or len(places) < len(_TWO):
        return {k: Role("target", "words") for k in places[:1]}, len(places) <= 1
    first, second = places[-2:]
    swapped = table.content[first].runs > _CLEARLY * (table.content[second].runs + 1)
    told = not (swapped or table.sheet.titled or len(places) > len(_TWO) + 1)  # and a collection
    ordered = (second, first) if swapped else (first, second)
    return {k: Role(role, "words") for k, role in zip(ordered, _TWO, strict=True)}, told


_TWO = ("group", "target")


def _moments(table: Table, taken: set[int]) -> dict[int, Role]:
    """The column of times, or those of dates and times of day; what only should hold times."""
    of_kind: dict[str, list[int]] = {"time": [], "date": [], "clock": []}
    for place, content in enumerate(table.content):
        if place not in taken and content.kind in of_kind:
            of_kind[content.kind].append(place)
    times, days, clocks = of_kind.values()
    called = [k for k in times if table.named[k].role == "time"]
    if times:
        return {(called or times)[0]: Role("time", "title" if called else "time")}
    if days and clocks:
        return {days[0]: Role("date", "time"), clocks[0]: Role("time", "time")}
    should = [k for k, c in enumerate(table.named) if c.role == "time" and k not in taken]
    return {k: Role("", "untimed") for k in (*should, *clocks, *days)}


# --- without titles -------------------------------------------------------------------------------


def _by_numbers(
    table: Table, number: set[int], kind: str | None, unit: str | None
) -> list[Reading]:
    """Ways to read columns of numbers that no title explains."""
    roles, left, told = _without_names(table, sorted(number))
    known = [k for k in left if table.named[k].role]  # a temperature has a title, a place has not
    left = [k for k in left if k not in known] if len(left) - len(known) >= len(_SPACE) else left
    if len(left) < len(_SPACE):
        return []
    matrix = _matrix(table, left)
    places = (left[0], left[1], left[2])
    found = _of_three(table, places, roles, kind, unit)
    if len(left) > len(_SPACE) and not matrix:
        told = told and _keep_distances(table, places, roles)
    found = [replace(one, roles={**one.roles, **_if_cartesian(one, matrix)}) for one in found]
    return found if told else _doubted([*found, *_further(table, left, roles)])


def _further(table: Table, left: Sequence[int], roles: dict[int, Role]) -> list[Reading]:
    """x, y, z in columns of numbers behind the first three; the first may be a name then."""
    out = []
    named = "target" in {one.role for one in roles.values()}
    for k in range(1, len(left) - len(_SPACE) + 1):
        name = {} if named else {left[0]: Role("target", "order")}
        places = left[k : k + len(_SPACE)]
        out.append(Reading("cartesian", _xyz(places, roles | name, "cartesian", "order")))
    return out[:_OFFERED]


_OFFERED = 4
"""Further columns that are offered."""


_SPACE = AXES["cartesian"]


def _if_cartesian(one: Reading, matrix: dict[int, Role]) -> dict[int, Role]:
    return matrix if one.kind == "cartesian" else {}


def _without_names(table: Table, number: list[int]) -> tuple[dict[int, Role], list[int], bool]:
    """Names and times, the columns of numbers that are left, and whether names are beyond doubt."""
    words = [k for k in _words(table, set()) if not table.named[k].role]
    if words and len(number) > len(_SPACE) and table.content[number[0]].counts:
        number = number[1:]
    roles, _ = _others(table, {*number, *words})
    at = {one.role for one in roles.values()}
    if "target" in at:
        return roles, number, True
    name = _number_of_point(table, number)
    if name is not None and len(words) <= 1 and all(_tells_apart(table, k, name) for k in words):
        left = [k for k in number if k != name]
        group = {k: Role("group", "names") for k in words}
        return roles | group | {name: Role("target", "numbers")}, left, True
    leading = [k for k in words if not number or k < number[0]]
    if len(leading) > 1 and _is_instrument(table.content[leading[0]]):
        roles[leading[0]] = Role("instrument", "words")
        leading = leading[1:]
    names, told = _names(table, leading or words, at)
    return roles | names, number, told


def _number_of_point(table: Table, number: Sequence[int]) -> int | None:
    """A column of numbers that names points, beside three more; None where there is none.

    It is called so, or it is the first one and has digits only where coordinates have more.
    """
    if len(number) <= len(_SPACE):
        return None
    called = next((k for k in number if table.named[k].role == "target"), None)
    if called is not None:
        return called
    first, *others = number
    others = others[: len(_SPACE)]
    plain = any(table.content[k].whole for k in others)
    return first if table.content[first].whole and not plain else None


def _is_instrument(content: Content) -> bool:
    return all(_INSTRUMENT.fullmatch(cell) for cell in content.cells if cell)


def _matrix(table: Table, left: Sequence[int]) -> dict[int, Role]:
    """A covariance row by row behind the coordinates, known by its symmetry; empty where none is.

    Between them stand uncertainties, which the covariance says better.
    """
    if len(left) < len(_SPACE) + _MATRIX:
        return {}
    places = left[-_MATRIX:]
    C = table.numbers(places).reshape(-1, 3, 3)
    size = np.sqrt(np.abs(np.diagonal(C, axis1=1, axis2=2)))
    scale = size[:, :, None] * size[:, None, :]
    positive = (np.diagonal(C, axis1=1, axis2=2) > 0).all()
    if not len(C) or not positive or len(left) > len(_SPACE) + _MATRIX + len(AXES) + 1:
        return {}
    if (np.abs(C - C.transpose(0, 2, 1)) > _SYMMETRIC * scale).any() or (np.abs(C) > scale).any():
        return {}
    return {places[k]: Role(name, "matrix") for name, k in _SIX.items()}


def _of_three(
    table: Table,
    places: tuple[int, int, int],
    roles: dict[int, Role],
    kind: str | None,
    unit: str | None,
) -> list[Reading]:
    """The ways to read three columns: x, y, z, or a distance and two angles."""
    read = _named_numbers(table, places, roles)
    faces = _polar.in_two_faces(*read)
    ways = faces or [
        w for w in _polar.possible(read[0], unit) if not _polar.only_along(*read[:2], w)
    ]
    if kind in ("cartesian", "cylindrical"):
        return [Reading(kind, _xyz(places, roles, kind, "stated"))]
    if kind or faces:
        polar = _in_orders(places, roles, ways, "faces" if faces else "stated")
        return polar[:1] if kind or len(polar) == 1 else _doubted(polar)
    turning = _polar.rigid_ways(*read, ways, unit or "mm")
    if turning:
        polar = _in_orders(places, roles, turning, "rigid")
        return polar if len(polar) == 1 else _doubted(polar)
    if not ways:
        mixed = _polar.in_part(*read, unit or "mm")
        if mixed is not None:
            raise _of_two_kinds(int(np.array(table.sheet.lines)[table.whole(places)][mixed]))
        return [Reading("cartesian", _xyz(places, roles, "cartesian", "range"))]
    if _polar.rigid_space(*read, ways, unit or "mm"):
        return [Reading("cartesian", _xyz(places, roles, "cartesian", "rigid"))]
    cartesian = Reading("cartesian", _xyz(places, roles, "cartesian", "order"))
    polar = _in_orders(places, roles, ways, "order")
    return [replace(one, open="coordinates") for one in (polar[0], cartesian)]


def _of_two_kinds(line: int) -> InputError:
    return InputError(
        "the rows from here on and those above seem to be of two kinds, x, y, z and a distance "
        "with two angles",
        'split the export into one for each kind, or write coordinates = "cartesian" into '
        "[tracker] of campaign.toml if all are x, y, z",
        line=line,
    )


def _in_orders(
    places: Sequence[int], roles: dict[int, Role], ways: Sequence[Polar], why: Why
) -> list[Reading]:
    """Distance and angles in each order that is possible, the most usual one first."""
    orders = list(dict.fromkeys(way.order for way in ways))
    return [_angles(places, roles, [w for w in ways if w.order == one], why) for one in orders]


def _keep_distances(table: Table, places: tuple[int, int, int], roles: dict[int, Role]) -> bool:
    """Whether targets keep their distances in three columns of more: others would change them."""
    numbers, names, groups = _named_numbers(table, places, roles)
    return _polar.keeps(_polar.softness(numbers, names, groups))


def _named_numbers(
    table: Table, places: tuple[int, int, int], roles: dict[int, Role]
) -> tuple[Array, list[str], list[str]]:
    """Three columns of numbers with the target and what was read together, of the sound rows."""
    rows = table.whole(places)
    at = {one.role: place for place, one in roles.items()}
    names = table.cells(at.get("target"), rows)
    groups = _groups(table, at, rows, names)
    if names and all(_JOINT in name for name in names):
        groups, names = (list(part) for part in zip(*map(_split, names), strict=True))
    return table.numbers(places), names, groups


def _split(name: str) -> tuple[str, str]:
    group, _, target = name.rpartition(_JOINT)
    return group, target


def _groups(table: Table, at: Mapping[str, int], rows: Bools, names: Sequence[str]) -> list[str]:
    """What was read together: its group, or the round of names that has not come to its end."""
    own = table.cells(at.get("group"), rows)
    if "group" in at:
        return own
    seen: set[str] = set()
    number, out = 0, []
    for name in names:
        if name in seen:
            seen, number = set(), number + 1
        seen.add(name)
        out.append(str(number))
    return out


def _xyz(places: Sequence[int], roles: dict[int, Role], kind: str, why: Why) -> dict[int, Role]:
    return roles | {k: Role(axis, why) for k, axis in zip(places, AXES[kind], strict=True)}


def _angles(
    places: Sequence[int], roles: dict[int, Role], ways: Sequence[Polar], why: Why
) -> Reading:
    """Distance and angles in one order, with all ways to read them in it."""
    named = zip(ways[0].order, AXES["spherical"], strict=True)
    found = roles | {places[k]: Role(role, why) for k, role in named}
    return Reading("spherical", found, tuple(ways))
