"""Probable role of each column of a sheet, with the evidence, and alternative readings.

Titles take precedence, then the kind of the cells, then geometry. If only its position speaks for a
column, and another reading makes as much sense, both are returned.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, at, listed
from pipeline.dialects._cells import is_number
from pipeline.dialects._coordinates import AXES, VERTICALS, ZEROS
from pipeline.dialects._named import COVARIANCE
from pipeline.dialects._titles import (
    Triple,
    is_quantity,
    no_level_range,
    numbered,
    triples,
    uncertainties,
)
from pipeline.dialects._unit_words import ANGLE_WORDS
from pipeline.intake import _polar
from pipeline.intake._beside import Role, SheetTable, Why, roles_beside, roles_of_words, tells_apart
from pipeline.intake._contents import Content
from pipeline.intake._log_words import force_unit
from pipeline.intake._polar import Polar
from pipeline.intake._sheet import Sheet, cells_of
from pipeline.readers._layout import JOINT
from pipeline.readers.logs import SCALE

_INSTRUMENT = re.compile(r"(instrument|station|tracker|stn|standpunkt)[ _:-]*\w*", re.IGNORECASE)
_MATRIX = 9
"""Number of cells of a covariance, row by row."""
_SYMMETRIC = 1e-3
"""Maximum asymmetry of a covariance, relative to the roots of the diagonal [1]: four digits are
printed."""
_SIX = dict(zip(COVARIANCE, (0, 1, 2, 4, 5, 8), strict=True))
"""Positions of the six numbers of a covariance in its nine cells."""


@dataclass(frozen=True)
class RoleAssignment:
    """One way to read the columns of a sheet.

    Attributes:
        kind: `cartesian`, `spherical` or `cylindrical`.
        roles: By place, counted from 0: the words of [tracker.mapping] columns.
        ways: Possible meanings of distance and angles in the columns of these roles, as far as the
            numbers show; empty if titles do.
        open: The question to be asked before it can be used, None if nothing else makes sense.
    """

    kind: str
    roles: Mapping[int, Role]
    ways: tuple[Polar, ...] = ()
    open: Literal["columns", "coordinates"] | None = None

    def place(self, role: str) -> int | None:
        """The column of a role."""
        return next(iter(self.places(role)), None)

    def places(self, *roles: str) -> list[int]:
        """The columns of some roles, in their order, as far as present."""
        at = {one.role: k for k, one in reversed([*self.roles.items()])}
        return [at[role] for role in roles if role in at]


def readings(table: SheetTable, kind: str | None, unit: str | None) -> list[RoleAssignment]:
    """Every sensible way to read a table, the most plausible one first.

    Args:
        table: The table.
        kind: Kind of its coordinates where the file or a person states it.
        unit: Unit of length, likewise.

    Raises:
        InputError: A row contains several targets, or its distance is not a range.
    """
    units = tuple(SCALE)  # X (N) is a coordinate to the north
    forces = {k for k, c in enumerate(table.named) if not c.role and force_unit(c.title, units)}
    number = table.of_kind("number", forces)
    sets = [one for one in triples(table.named) if {*one.columns} <= {*number}]
    return _by_titles(table, sets) if sets else _by_cells(table, number, kind, unit)


def _by_cells(
    table: SheetTable, number: list[int], kind: str | None, unit: str | None
) -> list[RoleAssignment]:
    """The readings of columns of numbers whose titles name no coordinates; the rest as above."""
    called = {column.role for column in table.named}
    if called & {"azimuth", *VERTICALS}:
        with at(line=table.sheet.header):
            no_level_range(table.sheet.titles)
    found = _by_numbers(table, number, kind, unit)
    if sure := [one for one in found if _by_units(table, one)]:
        return _sole([replace(one, open=None) for one in sure])
    others = any(table.named[k].title for k in number if table.named[k].role != "target")
    return _doubted(found) if "x" in called or table.sheet.stray or others else found


def _by_units(table: SheetTable, one: RoleAssignment) -> bool:
    """Whether titles state the units of a distance and two angles, whatever their words."""
    units = [table.named[k].unit for k in one.places("range", "azimuth", "vertical")]
    angles = [unit in ANGLE_WORDS.values() for unit in units]
    return angles == [False, True, True] and bool(units[0])


def _doubted(
    found: list[RoleAssignment], about: Literal["columns", "coordinates"] = "columns"
) -> list[RoleAssignment]:
    return [replace(one, open=about) for one in found]


def _sole(found: list[RoleAssignment]) -> list[RoleAssignment]:
    """The only reading, or several of which one must be chosen."""
    return found if len(found) == 1 else _doubted(found)


def _by_titles(table: SheetTable, sets: Sequence[Triple]) -> list[RoleAssignment]:
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
        others, stated = roles_beside(table, {*roles})
        out.append(RoleAssignment(one.kind, roles | others))
        sure = sure and one.plain and stated
    return out if sure else _doubted(out)


def _one_target(table: SheetTable, sets: Sequence[Triple]) -> None:
    """Check that each row has one target, not x, y, z of several as cameras write them.

    Raises:
        InputError: It has several.
    """
    first = [one.columns[0] for one in sets if one.kind == "cartesian" and not one.nominal]
    for names in (*_above(table.sheet, first), numbered([table.named[k] for k in first])):
        stated = all(names) and not any(is_quantity(one) or is_number(one) for one in names)
        if len({*names}) > 1 and stated:
            raise InputError(
                f"each row contains x, y, z of several targets ({listed(dict.fromkeys(names))})",
                "write a row for each target, with its name: time,target,x_mm,y_mm,z_mm",
                line=table.sheet.header,
            )


def _above(sheet: Sheet, places: Sequence[int]) -> list[list[str]]:
    """The cells above some columns, for each line that has a cell for every column."""
    lines = (cells_of(line, sheet.delimiter) or [] for line in sheet.preamble)
    return [[cells[k] for k in places] for cells in lines if len(cells) == len(sheet.titles)]


def _plain(role: str) -> str:
    return "vertical" if role in ZEROS else role


def _mapped(role: str) -> str:
    """The word of a mapping for a role of a title."""
    return role.replace("std ", "s").replace("u95 ", "u95_")


def _titled_matrix(table: SheetTable) -> dict[int, Role]:
    """The columns of a covariance, where all six have their titles."""
    at = {c.title.lower(): k for k, c in enumerate(table.named)}
    return {at[name]: Role(name, "title") for name in _SIX} if at.keys() >= _SIX.keys() else {}


# --- without titles -------------------------------------------------------------------------------


def _by_numbers(
    table: SheetTable, number: list[int], kind: str | None, unit: str | None
) -> list[RoleAssignment]:
    """Ways to read columns of numbers that no title explains."""
    roles, left, stated = _without_names(table, number)
    known = [k for k in left if table.named[k].role]  # coordinates have no title
    left = [k for k in left if k not in known] if len(left) - len(known) >= len(_SPACE) else left
    if len(left) < len(_SPACE):
        return []
    matrix = _matrix(table, left)
    places = (left[0], left[1], left[2])
    found = _of_three(table, places, roles, kind, unit)
    if len(left) > len(_SPACE) and not matrix:
        stated = stated and _keep_distances(table, places, roles)
    found = [replace(one, roles={**one.roles, **_if_cartesian(one, matrix)}) for one in found]
    return found if stated else _doubted([*found, *_further(table, left, roles)])


def _further(
    table: SheetTable, left: Sequence[int], roles: dict[int, Role]
) -> list[RoleAssignment]:
    """x, y, z in columns of numbers after the first three; the first may be a name then."""
    out = []
    named = "target" in {one.role for one in roles.values()}
    for k in range(1, len(left) - len(_SPACE) + 1):
        name = {} if named else {left[0]: Role("target", "order")}
        places = left[k : k + len(_SPACE)]
        out.append(RoleAssignment("cartesian", _xyz(places, roles | name, "cartesian", "order")))
    return out[:_OFFERED]


_OFFERED = 4
"""Maximum number of further column triples that are offered."""


_SPACE = AXES["cartesian"]


def _if_cartesian(one: RoleAssignment, matrix: dict[int, Role]) -> dict[int, Role]:
    return matrix if one.kind == "cartesian" else {}


def _without_names(table: SheetTable, number: list[int]) -> tuple[dict[int, Role], list[int], bool]:
    """Names and times, the remaining columns of numbers, and whether the names are certain."""
    words = [k for k in table.of_kind("word") if not table.named[k].role]
    if words and len(number) > len(_SPACE) and table.content[number[0]].counts:
        number = number[1:]
    roles, _ = roles_beside(table, {*number, *words})
    at = {one.role for one in roles.values()}
    if "target" in at:
        return roles, number, True
    points = _by_points(table, number, words)
    if points:
        return roles | points, [k for k in number if k not in points], True
    names, stated = _by_words(table, number, words, at)
    return roles | names, number, stated


def _by_points(table: SheetTable, number: Sequence[int], words: Sequence[int]) -> dict[int, Role]:
    """Numbers that name points, and the words that may say their group; empty if there are none."""
    name = _number_of_point(table, number)
    if name is None or len(words) > 1 or not all(tells_apart(table, k, name) for k in words):
        return {}
    return {k: Role("group", "names") for k in words} | {name: Role("target", "numbers")}


def _by_words(
    table: SheetTable, number: Sequence[int], words: Sequence[int], known: set[str]
) -> tuple[dict[int, Role], bool]:
    """Names in columns of words, those before the numbers first, and whether they are certain."""
    leading = [k for k in words if not number or k < number[0]]
    if len(leading) > 1 and _is_instrument(table.content[leading[0]]):
        names, stated = roles_of_words(table, leading[1:], known)
        return names | {leading[0]: Role("instrument", "words")}, stated
    return roles_of_words(table, leading or words, known)


def _number_of_point(table: SheetTable, number: Sequence[int]) -> int | None:
    """A column of numbers that names points, in addition to three more; None if there is none.

    Either its title says so, or it is the first one and contains digits only, unlike the
    coordinates.
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


def _matrix(table: SheetTable, left: Sequence[int]) -> dict[int, Role]:
    """A covariance row by row after the coordinates, known by its symmetry; empty if there is none.

    Columns between them are uncertainties, which the covariance supersedes.
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
    table: SheetTable,
    places: tuple[int, int, int],
    roles: dict[int, Role],
    kind: str | None,
    unit: str | None,
) -> list[RoleAssignment]:
    """The ways to read three columns: x, y, z, or a distance and two angles."""
    if kind in ("cartesian", "cylindrical"):
        return [RoleAssignment(kind, _xyz(places, roles, kind, "stated"))]
    read, usual = _named_numbers(table, places, roles), unit or "mm"
    faces = _polar.in_two_faces(*read)
    ways = faces or _polar.beams(*read[:2], unit)
    if kind:
        return _in_orders(places, roles, ways, "faces" if faces else "stated")[:1]
    if faces:
        return _sole(_in_orders(places, roles, faces, "faces"))
    if turning := _polar.rigid_ways(*read, ways, usual):
        return _sole(_in_orders(places, roles, turning, "rigid"))
    if not ways:
        _of_one_kind(table, places, _polar.in_part(*read, usual))
        return [RoleAssignment("cartesian", _xyz(places, roles, "cartesian", "range"))]
    if _polar.rigid_space(*read, ways, usual):
        return [RoleAssignment("cartesian", _xyz(places, roles, "cartesian", "rigid"))]
    cartesian = RoleAssignment("cartesian", _xyz(places, roles, "cartesian", "order"))
    polar = _in_orders(places, roles, ways, "order")
    return _doubted([polar[0], cartesian], "coordinates")


def _of_one_kind(table: SheetTable, places: Sequence[int], change: int | None) -> None:
    """Refuse a table in which angles and a distance end or begin at some row.

    Raises:
        InputError: They do.
    """
    if change is not None:
        raise InputError(
            "the rows from here on and those above seem to be of two kinds, x, y, z and a distance "
            "with two angles",
            'split the export into one for each kind, or write coordinates = "cartesian" into '
            "[tracker] of campaign.toml if all are x, y, z",
            line=int(np.array(table.sheet.lines)[table.whole(places)][change]),
        )


def _in_orders(
    places: Sequence[int], roles: dict[int, Role], ways: Sequence[Polar], why: Why
) -> list[RoleAssignment]:
    """Distance and angles in each possible order, the most usual one first."""
    orders = list(dict.fromkeys(way.order for way in ways))
    return [_angles(places, roles, [w for w in ways if w.order == one], why) for one in orders]


def _keep_distances(
    table: SheetTable, places: tuple[int, int, int], roles: dict[int, Role]
) -> bool:
    """Whether targets keep their distances in these three columns of several."""
    numbers, names, groups = _named_numbers(table, places, roles)
    return _polar.keeps(_polar.softness(numbers, names, groups))


def _named_numbers(
    table: SheetTable, places: tuple[int, int, int], roles: dict[int, Role]
) -> tuple[Array, list[str], list[str]]:
    """Three columns of numbers with target and group, of the undamaged rows."""
    rows = table.whole(places)
    at = {one.role: place for place, one in roles.items()}
    names = table.cells(at.get("target"), rows)
    groups = _groups(table, at, rows, names)
    if names and all(JOINT in name for name in names):
        groups, names = (list(part) for part in zip(*map(_split, names), strict=True))
    return table.numbers(places), names, groups


def _split(name: str) -> tuple[str, str]:
    group, _, target = name.rpartition(JOINT)
    return group, target


def _groups(
    table: SheetTable, at: Mapping[str, int], rows: Bools, names: Sequence[str]
) -> list[str]:
    """What was read together: the group, or the round of names up to the next repetition."""
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
) -> RoleAssignment:
    """Distance and angles in one order, with all their possible meanings."""
    named = zip(ways[0].order, AXES["spherical"], strict=True)
    found = roles | {places[k]: Role(role, why) for k, role in named}
    return RoleAssignment("spherical", found, tuple(ways))
