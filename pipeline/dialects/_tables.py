"""Read tables whose columns are named by a header or by campaign.toml."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, at, listed
from pipeline.dialects import _kinds
from pipeline.dialects._blocks import filled_down
from pipeline.dialects._cells import above, cells_or_none, is_remark
from pipeline.dialects._circle import within_a_circle
from pipeline.dialects._coordinates import (
    ANGULAR,
    AXES,
    VERTICALS,
    ZEROS,
    Angles,
    of_angles,
    settled_angles,
    settled_unit,
    uncertainties,
)
from pipeline.dialects._delimited import rows
from pipeline.dialects._export import EXPANDED, RMS, STANDARD, USUAL_FACTORS, diagonal, export
from pipeline.dialects._named import (
    COVARIANCE,
    UNIT_LINE,
    Header,
    Named,
    find,
    is_unit_title,
    one_unit,
    said_units,
)
from pipeline.dialects._table_times import SEARCHED, dated, form_of_times, sample, trusted_times
from pipeline.dialects._titles import horizontal, name_a_place, no_level_range
from pipeline.dialects._unit_words import UNIT_WORDS
from pipeline.readers._layout import Field, Kind, Layout, TypedRows
from pipeline.readers._reader import Export, Meaning
from pipeline.readers._text import Text, shortened
from pipeline.readers.export_settings import ExportSettings

_UNCERTAINTIES = {
    EXPANDED: ("u95 x", "u95 y", "u95 z"),
    STANDARD: ("std x", "std y", "std z"),
}
_FLAGS = ("delete", "active", "instrument")
"""Columns that decide whether a row counts."""
_NO = ("0", "no", "false", "n", "nein")
_BLANK = ("", "-")
_LOST_IF_MISSPELT = {
    "time": "time", "timestamp": "time", "delete": "delete", "deleted": "delete",
    "group": "group", "point group": "group",
}  # fmt: skip
_ALIKE = 0.75
"""Similarity (difflib's ratio) from which a title counts as a misspelling [1]."""
_NAMES = ("group", "target", "reflector")
_PARTS = ("pose", "state", "repeat")
"""Columns that form the group if no column is called group."""
_KINDS: dict[str, Kind] = {
    **dict.fromkeys((*_NAMES, *_PARTS, *_FLAGS, "date"), "name"), "time": "time",
    **dict.fromkeys(("std", "u95", *COVARIANCE), "number"),
}  # fmt: skip
"""Kind of cells of a column, by the first word of its role."""


@dataclass(frozen=True)
class _ThreeColumns:
    """The three columns of coordinates.

    Attributes:
        kind: Kind of coordinates.
        columns: The columns, in the order of `AXES`.
        places: Their indices, counted from 0.
    """

    kind: str
    columns: tuple[Named, ...]
    places: tuple[int, ...]

    @property
    def roles(self) -> list[str]:
        """Roles of all three."""
        return [column.role for column in self.columns]

    @property
    def titles(self) -> list[str]:
        """Titles of all three as written."""
        return [column.title for column in self.columns]

    @property
    def angular(self) -> list[str]:
        """Roles of the columns that are angles."""
        return [self.roles[k] for k in ANGULAR[self.kind]]


def below_header(text: Text, hints: ExportSettings, dialect: str) -> Export:
    """Read a table whose header was found when its dialect was recognised."""
    header = find(text.sample())
    assert header is not None
    return read(text, hints, header, dialect)


def read(
    text: Text,
    hints: ExportSettings,
    header: Header,
    dialect: str,
    comment: str | None = None,
    form: str | None = None,
) -> Export:
    """Read a table with a header.

    Args:
        text: The file; rows start below the header.
        hints: What campaign.toml adds.
        header: Its columns.
        dialect: Name of the reader.
        comment: Start of comment lines.
        form: Format of times, None to determine it.

    Raises:
        InputError: Unit, angles or kind of coordinates are not stated, or the table is ambiguous.
    """
    line = header.line or None
    with at(line=line):
        axes = _axes(header, hints)
        header, untimed = (header, None) if form else trusted_times(text, header, comment)
        form = form or form_of_times(text, header, comment)
    sorting = _sorting(text, header, comment)
    fields = {k: _field(c, k, axes, header.has("date")) for k, c in enumerate(header.columns)}
    angle = of_angles(hints.angle or one_unit(header, axes.angular))
    fields |= {k: replace(f, units=angle) for k, f in fields.items() if f.name in axes.angular}
    layout = Layout(
        fields=tuple((fields | sorting).values()),
        delimiter=header.delimiter,
        first=header.begins,
        decimal=hints.decimal,
        comment=comment,
        moment=form,
    )
    table = _below_nominal(rows(text, layout), text, header)
    table, sorted_by = _not_nominal(table, sorting.values())
    table = _not_twice(table, sorting.values())
    if header.has("date"):
        table = dated(table, layout.moment)
    with at(line=line):
        if axes.kind == "cartesian":
            _one_frame(table, line, sorting.values(), axes)
        meaning = _meaning(header, hints, table, axes)
        numbers = [*map(table.floats, axes.roles)]
        table = table.without(within_a_circle(axes.titles, numbers, table.line, meaning))
        _same_unit(text, header, meaning.unit)
        _unit_of_rows(text, header, meaning.unit, comment)
        table = _grouped(_counting(table, hints))
        _all_or_none(header)
        found = covariances(table, header, hints, meaning.unit)
    unused = _unread(fields.values(), sorted_by)
    readings = export(text, hints, dialect, table, meaning, axes.roles, found, unused)
    again = _again(text, header, readings.rejected)
    early = above(text, header.line, header.delimiter, axes.places)
    return replace(readings, rejected=(*early, *again), untimed=untimed)


def _unread(fields: Iterable[Field], sorted_by: Iterable[str]) -> list[str]:
    """Titles of the columns that are not read, and by which no rows are told apart."""
    return [one.title for one in fields if one.kind == "any" and one.title not in {"", *sorted_by}]


def _sorting(text: Text, header: Header, comment: str | None) -> dict[int, Field]:
    """Columns with few distinct words and no role, by index: they may distinguish kinds of rows."""
    places = [k for k, c in enumerate(header.columns) if c.title and not c.role]
    cells: list[list[str]] = list(sample(text, header, comment)) if places else []
    found = {k: _kinds.few(row[k] for row in cells if len(row) > k) for k in places}
    return {
        k: Field(f"words ({k + 1})", "name", needed=False, title=header.columns[k].title)
        for k, words in found.items()
        if words
    }


def _below_nominal(table: TypedRows, text: Text, header: Header) -> TypedRows:
    """Reject rows below a section title that calls them nominal, if others are measured."""
    numbers = [*range(1, header.line), *(number for number, _ in table.rejected)]
    marks = {n: kind for n in numbers if (kind := _kinds.section(text.line(n)))}
    if {*marks.values()} != {"nominal", "measured"}:
        return table
    starts, said = np.array(sorted(marks)), [marks[n] for n in sorted(marks)]
    above = np.searchsorted(starts, table.line) - 1
    measured = np.array([k < 0 or said[k] == "measured" for k in above.tolist()], dtype=bool)
    known = tuple((n, why) for n, why in table.rejected if n not in marks)
    reason = "it is below a line of nominal points; remove that line if it was measured"
    return replace(table, rejected=known).only(measured, reason)


def _not_nominal(table: TypedRows, sorting: Iterable[Field]) -> tuple[TypedRows, set[str]]:
    """Reject rows that a column marks as nominal beside others; return titles of such columns."""
    titles = set()
    for field in sorting:
        marks = table.columns[field.name].dictionary.to_pylist()
        found = _kinds.nominal(map(str, marks))
        if found:
            reason = f"its {shortened(field.title)} is {listed(sorted(found))}, so that nobody has "
            reason += "measured it; correct that if it was"
            table = table.only(~_cells_that(table, field.name, found.__contains__), reason)
            titles.add(field.title)
    return table, titles


def _not_twice(table: TypedRows, sorting: Iterable[Field]) -> TypedRows:
    """Reject averages of shots that are themselves in the table: they would count twice."""
    called = [name for name in _NAMES if name in table.columns]
    for field in sorting if called else ():
        mean = _cells_that(table, field.name, _kinds.is_average)
        if not mean.any():
            continue
        names = list(zip(*(table.columns[name].to_pylist() for name in called), strict=True))
        single = {name for name, averaged in zip(names, mean, strict=True) if not averaged}
        twice = mean & np.array([name in single for name in names], dtype=bool)
        reason = (
            f"its {shortened(field.title)} says that it is the average of other rows; remove it"
        )
        table = table.only(~twice, reason)
    return table


def _one_frame(
    table: TypedRows, line: int | None, sorting: Iterable[Field], axes: _ThreeColumns
) -> None:
    """Check that no column of words separates rows in which the same targets lie elsewhere.

    Raises:
        InputError: One does, and it is not stated which word is meant.
    """
    position = np.column_stack([table.floats(axis)[:SEARCHED] for axis in axes.roles])
    called = [name for name in _NAMES if name in table.columns]
    names = list(zip(*(table.columns[name][:SEARCHED].to_pylist() for name in called), strict=True))
    for field in sorting if names else ():
        words = list(map(str, table.columns[field.name][:SEARCHED].to_pylist()))
        if _kinds.apart(names, words, position):
            raise _kinds.several(field.title, words, line)


def _again(
    text: Text, header: Header, rejected: Sequence[tuple[int, str]]
) -> list[tuple[int, str]]:
    """Rejections, in which a repeated header is called one.

    Raises:
        InputError: A header with other columns or units is found, so that other rows follow.
    """
    out = []
    first = text.line(header.line).strip() if header.line else None
    for number, reason in rejected:
        if text.line(number).strip() == first:
            out.append((number, "the header comes again; remove the row"))
            continue
        if name_a_place(cells_or_none(text.line(number), header.delimiter)):
            raise InputError(
                "another header begins here, with other columns or units",
                "split the export there into two files and list them in [tracker] files",
                line=number,
            )
        out.append((number, reason))
    return out


def _same_unit(text: Text, header: Header, unit: str) -> None:
    """Check that no line between the rows changes the unit for those below it.

    Raises:
        InputError: One does.
    """
    place = text.data.find(b"nit", text.starts[header.begins - 1])
    while place >= 0:
        number = int(np.searchsorted(text.starts, place, side="right"))
        line = text.line(number)
        units = said_units(line) & {*UNIT_WORDS.values()} if UNIT_LINE.search(line) else {unit}
        if line.count(header.delimiter) < len(header.columns) - 1 and units - {unit}:
            raise InputError(
                f"the unit of length changes here to {listed(units - {unit})}, above it was {unit}",
                "split the export there into two files and list them in [tracker] files",
                line=number,
            )
        place = text.data.find(b"nit", text.starts[number])


def _unit_of_rows(text: Text, header: Header, unit: str, comment: str | None) -> None:
    """Check that a column of units contains only the unit of the table.

    Raises:
        InputError: It does not.
    """
    place = next((k for k, c in enumerate(header.columns) if is_unit_title(c.title)), None)
    if place is None:
        return
    for number, line in text.lines(header.begins):
        if is_remark(line, comment):
            continue
        cells = cells_or_none(line, header.delimiter) or []
        unit_here = UNIT_WORDS.get("".join(cells[place : place + 1]).lower(), unit)
        if unit_here != unit:
            raise InputError(
                f"the row is in {unit_here} by its unit, others or the file are in {unit}",
                "export all rows in one unit, or split the export",
                line=number,
            )


def _group_needs_target(header: Header) -> None:
    if header.has("group") and not header.has("target") and not header.has("reflector"):
        raise InputError(
            f"there is no column target among {listed(c.title for c in header.columns)}",
            "add it, or say which column it is in [tracker.mapping] of campaign.toml",
        )


def _once(header: Header) -> None:
    roles = [column.role for column in header.columns if column.role]
    twice = [role for role in dict.fromkeys(roles) if roles.count(role) > 1]
    if twice:
        titles = [column.title for column in header.columns if column.role == twice[0]]
        raise InputError(
            f"the columns {listed(titles)} both look like the {twice[0]}",
            "remove or rename one, or say which in [tracker.mapping] of campaign.toml",
        )


def _nearly(header: Header) -> None:
    """Check that no title resembles that of a missing column, which would be lost unnoticed."""
    for column in header.columns:
        if column.role or not column.title:
            continue
        near = get_close_matches(column.title.lower(), _LOST_IF_MISSPELT, n=1, cutoff=_ALIKE)
        if near and not header.has(_LOST_IF_MISSPELT[near[0]]):
            raise InputError(
                f'column "{shortened(column.title)}" is not known, but looks like "{near[0]}"',
                "correct its name, or say what it is in [tracker.mapping] of campaign.toml",
            )


def _axes(header: Header, hints: ExportSettings) -> _ThreeColumns:
    """The columns of coordinates, after checks of the header.

    Raises:
        InputError: The columns do not form any kind of coordinates, or one of them is ambiguous.
    """
    _once(header)
    if hints.mapping is None:  # a mapping states the role of each column
        _nearly(header)
    _group_needs_target(header)
    axes = _kind(header, hints)
    if axes.kind == "spherical":
        no_level_range(axes.titles[:1])
    return axes


def _kind(header: Header, hints: ExportSettings) -> _ThreeColumns:
    """The columns of coordinates.

    Raises:
        InputError: The columns do not form any kind of coordinates.
    """
    for kind, wanted in AXES.items():
        places = tuple(place for role in wanted if (place := _present(header, role)) is not None)
        if len(places) == len(wanted):
            stated = hints.coordinates if kind == "cartesian" else None
            return _ThreeColumns(stated or kind, tuple(header.columns[k] for k in places), places)
    lacking = next((role for role in AXES["cartesian"] if not header.has(role)), "x")
    raise InputError(
        f"there is no column {lacking}_mm among {listed(c.title for c in header.columns)}",
        "add it to the header and to every row",
    )


def _present(header: Header, role: str) -> int | None:
    alike = VERTICALS if role == "vertical" else (role,)
    return next((header.where(name) for name in alike if header.has(name)), None)


def _field(column: Named, place: int, axes: _ThreeColumns, apart: bool) -> Field:
    """How the cells of a column are read; `apart` if dates have a column separate from times."""
    kinds = _KINDS | dict.fromkeys(axes.roles, "number") | ({"time": "name"} if apart else {})
    kind = kinds.get(column.role.partition(" ")[0])
    if kind is not None:
        return Field(column.role, kind, column.role in (*axes.roles, *_NAMES), column.title)
    unused: Kind = (
        "any" if column.title or not place else "blank"
    )  # the index column of pandas has no title
    name = column.role or f"column {place + 1}"
    return Field(f"{name} ({place + 1})", unused, needed=False, title=column.title)


def _counting(table: TypedRows, hints: ExportSettings) -> TypedRows:
    """Keep rows not marked as deleted or inactive, and of the requested instrument."""
    counting: dict[str, Callable[[str], bool]] = {
        "delete": lambda mark: mark.lower() in (*_BLANK, *_NO),
        "active": lambda mark: mark.lower() not in _NO,
    }
    for flag in counting.keys() & table.columns.keys():
        kept = _cells_that(table, flag, counting[flag])
        reason = "the operator marked it as deleted; clear the mark if it is to be used"
        table = table.only(kept, reason)
    one = hints.mapping.instrument if hints.mapping else None
    if one is not None and "instrument" in table.columns:
        theirs = _cells_that(table, "instrument", lambda name: name == one)
        table = table.only(theirs, f"it is not of {one}; correct instrument if it is to be used")
    return table


def _grouped(table: TypedRows) -> TypedRows:
    """Add the group formed by pose, state and number of the pull, where it is blank from above."""
    table = filled_down(table, ["group"] if "group" in table.columns else _PARTS)
    parts = [table.columns[one].to_pylist() for one in _PARTS if one in table.columns]
    if not parts or "group" in table.columns:
        return table
    names = [" ".join(filter(None, row)) for row in zip(*parts, strict=True)]
    group = pa.array(names, pa.string()).dictionary_encode()
    return replace(table, columns=table.columns | {"group": group})


def _cells_that(table: TypedRows, name: str, fits: Callable[[str], bool]) -> Bools:
    """Rows whose cell in a text column fulfils a condition, shape (n,)."""
    marks = table.columns[name]
    fitting = [fits(str(mark)) for mark in marks.dictionary.to_pylist()]
    return np.array(fitting, dtype=bool)[np.asarray(marks.indices)]


def _meaning(
    header: Header, hints: ExportSettings, table: TypedRows, axes: _ThreeColumns
) -> Meaning:
    lengths = [role for role in axes.roles if role not in axes.angular]
    unit = settled_unit(one_unit(header, lengths), hints)
    third = axes.roles[2]
    zero = third if third in ZEROS else None
    stated = Angles(one_unit(header, axes.angular), zero, horizontal(header.columns))
    if stated.unit in UNIT_WORDS.values():
        raise InputError(
            f"the column of an angle is in {stated.unit}",
            'correct its title, or state coordinates = "cartesian"',
        )
    values = np.asarray(table.columns[third])
    return settled_angles(Meaning(unit, axes.kind), stated, values, hints)


def _all_or_none(header: Header) -> None:
    """Check that uncertainties of each kind exist for all axes or for none.

    Raises:
        InputError: They do not.
    """
    for roles in (*_UNCERTAINTIES.values(), COVARIANCE):
        lacking = [role for role in roles if not header.has(role)]
        if 0 < len(lacking) < len(roles):
            raise InputError(
                f"the uncertainties lack {listed(lacking)}",
                "correct the titles of their columns, or remove all of them",
            )


def covariances(
    table: TypedRows, header: Header, hints: ExportSettings, unit: str
) -> dict[str, Array]:
    """Covariances by kind in the units of the coordinates, (n, 6); NaN where a cell is empty."""

    def said(*roles: str) -> list[Array]:
        own = one_unit(header, roles)
        return [uncertainties(table.floats(role), own, unit) for role in roles]

    out = {}
    for kind, roles in _UNCERTAINTIES.items():
        if header.has(*roles):
            out[kind] = diagonal(said(*roles), hints.coverage_factor or USUAL_FACTORS[kind])
    if header.has(*COVARIANCE):
        out[STANDARD] = np.column_stack([table.floats(role) for role in COVARIANCE])
    if "rms" in table.columns:
        out[RMS] = diagonal([said("rms")[0] / np.sqrt(3.0)] * 3)
    return out
