"""SpatialAnalyzer's ASCII point export, with or without its `//` header.

A row is a name, three coordinates (Cartesian, spherical, cylindrical) and optional columns:
timestamp, uncertainties, weather, RMS. The name comes in four modes: `Collection::Group::Target`,
`Group::Target`, the same parts in columns of their own, or the target alone. Collections are read
only if `names` in [tracker] says that groups are called by them. Optional columns are used only if
the header names them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from pipeline.base.errors import InputError, at
from pipeline.dialects import _named, _tables, table, titled
from pipeline.dialects._cells import DELIMITERS, cells_or_none, is_number, is_plain, is_remark
from pipeline.dialects._circle import within_a_circle
from pipeline.dialects._coordinates import (
    AXES,
    KIND_WORDS,
    Angles,
    angular,
    of_angles,
    settled,
    settled_angles,
    settled_unit,
)
from pipeline.dialects._delimited import rows
from pipeline.dialects._export import export
from pipeline.dialects._named import Header, Named
from pipeline.dialects._table_times import form_of
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.readers._iso import ISO
from pipeline.readers._layout import JOINT, Field, Kind, Layout
from pipeline.readers._reader import Export, Meaning, OutgoingReadings, Reader, written
from pipeline.readers._text import SAMPLE_LINES, Text
from pipeline.readers.export_settings import ExportSettings

_T = TypeVar("_T")

_COMMENT = "//"
_AXES = ("1", "2", "3")
_PARTS = ("group", "target")
_SHORT_UNIT = re.compile(
    rf"{_named.UNITS.pattern}\s*[:=]?\s*(?P<said>mm|m|in)\b|[\[(](?P<below>mm|m|in)[\])]",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _RowShape:
    """Structure of the rows.

    Attributes:
        delimiter: Separator of cells.
        compound: Number of names joined by `::` in the first cell, 0 if names have their own
            columns.
        names: Names of the leading columns, `target` last.
        rest: Columns after the three coordinates.
        form: Format of times.
    """

    delimiter: str
    compound: int
    names: tuple[str, ...]
    rest: tuple[Named, ...]
    form: str


def _recognise(lines: Sequence[str]) -> bool:
    """Whether rows other than comments have a name of one to three parts, then three numbers."""
    comments = [line for line in lines if is_remark(line, _COMMENT)]
    sample = [line for line in lines if is_plain(line, _COMMENT)]
    shape = _shape(sample, comments)
    if shape is None or _named.find(sample) or titled.recognise(sample):  # rows below a header
        return False
    return bool(comments) or shape.compound > 0


def _read(text: Text, hints: ExportSettings) -> Export:
    """Read a SpatialAnalyzer export.

    Raises:
        InputError: Its unit or its angles are not stated.
    """
    if not _says_kind(text) and hints.coordinates is None:
        return table.read(text, hints, READER.name)
    first = next(n for n, line in text.lines() if is_plain(line, _COMMENT))
    comments = [line for _, line in text.lines(1, first - 1) if line.strip()]
    shape = _shape_from(text, first, comments, bool(hints.names))
    stated = _stated(comments, hints, first)
    layout = Layout(
        _fields(shape, stated),
        shape.delimiter,
        first,
        hints.decimal,
        _COMMENT,
        shape.form,
        shape.compound,
    )
    found = rows(text, layout)
    with at(line=first):
        third = np.asarray(found.columns[_AXES[2]])
        meaning = settled_angles(stated.meaning, stated.angles, third, hints)
    titles, numbers = [f"{axis} of the coordinates" for axis in _AXES], map(found.floats, _AXES)
    found = found.without(within_a_circle(titles, [*numbers], found.line, meaning))
    covariances = _tables.covariances(
        found, Header(0, shape.delimiter, shape.rest), hints, meaning.unit
    )
    unused = [n.title for n in shape.rest if not n.role or n.role == "rms"]
    return export(text, hints, READER.name, found, meaning, _AXES, covariances, unused)


def _shape_from(text: Text, first: int, comments: Sequence[str], split_later: bool) -> _RowShape:
    """Structure of the rows from line `first` on; joined names stay whole if they are split later.

    They are if the settings state which part is what.
    """
    sample = [line for _, line in text.lines(first, SAMPLE_LINES) if is_plain(line, _COMMENT)]
    shape = _shape(sample, comments)
    assert shape is not None  # recognised before
    whole = split_later and shape.compound
    return replace(shape, compound=0, names=("target",)) if whole else shape


def _says_kind(text: Text) -> bool:
    """Whether comments state the kind of coordinates; otherwise any three numbers are possible."""
    head = [line for line in text.sample() if is_remark(line, _COMMENT)]
    words = set(re.findall(r"[a-z]+", " ".join(head).lower()))
    return bool(words & KIND_WORDS.keys() or _kinds_by_titles(head))


def _shape(sample: Sequence[str], comments: Sequence[str]) -> _RowShape | None:
    """Structure of the rows, from the first sound ones and the header; None if they have none.

    A damaged row is ignored, but at least half of the rows must be alike.
    """
    whole = "".join(sample)
    delimiters = sorted(DELIMITERS, key=whole.count, reverse=True)
    shapes = (_shape_by(delimiter, sample, comments) for delimiter in delimiters)
    return next((shape for shape in shapes if shape), None)


def _shape_by(delimiter: str, sample: Sequence[str], comments: Sequence[str]) -> _RowShape | None:
    cut = [cells for line in sample if (cells := cells_or_none(line, delimiter))]
    for cells in cut:
        titles = _titles(comments, len(cells), delimiter)
        compound = cells[0].count(JOINT) + 1 if JOINT in cells[0] else 0
        count = 1 if compound else _names(cells, titles)
        alike = [row[count + 3 :] for row in cut if len(row) == len(cells)]
        if _fits(cells, compound, count) and 2 * len(alike) >= len(sample):
            rest, form = _rest(alike, titles, count + 3)
            return _RowShape(delimiter, compound, _parts(compound or count), rest, form)
    return None


def _parts(count: int) -> tuple[str, ...]:
    """What each of some names, joined or in columns, stands for; the last is the target."""
    above = [f"collection {k}" for k in range(count - len(_PARTS))]
    return (*above, *_PARTS)[-count:]


def _fits(cells: Sequence[str], compound: int, count: int) -> bool:
    """Whether joined names, or one to three, precede three numbers."""
    numbers = cells[count : count + 3]
    named = compound or 1 <= count <= len(_PARTS) + 1
    return bool(named) and len(numbers) == 3 and all(map(is_number, numbers))


def _rest(
    cells: Sequence[Sequence[str]], titles: Sequence[Named], first: int
) -> tuple[tuple[Named, ...], str]:
    """Columns from `first` on, and the format of times, which are recognised by it."""
    out, form = [], ISO
    for place, column in enumerate(zip(*cells, strict=True)):
        named = titles[first + place] if titles else Named(f"field {place + 1} behind Z", "", None)
        found = form_of(column, titles)
        if found and not named.role:
            named = replace(named, role="time")
        if found and named.role == "time":
            form = found
        out.append(named)
    return tuple(out), form


def _names(cells: Sequence[str], titles: Sequence[Named]) -> int:
    """Number of leading columns that are names."""
    if titles:
        return next((k for k, n in enumerate(titles) if n.role in ("x", "range")), 0)
    return next((k for k, cell in enumerate(cells) if is_number(cell)), 0)


def _titles(comments: Sequence[str], count: int, delimiter: str) -> list[Named]:
    """Column titles of the header, if there are as many as cells in a row."""
    for line in reversed(comments):
        found = _named.header(line.strip().removeprefix(_COMMENT), 0, delimiter)
        roles = [column.role for column in found.columns]
        if len(roles) == count and ("x" in roles or "range" in roles):
            return list(found.columns)
    return []


def _fields(shape: _RowShape, stated: _Statement) -> tuple[Field, ...]:
    """Fields of names, coordinates and further columns; those without a role are not read."""
    out = [Field(n, "name" if n in _PARTS else "any", n in _PARTS) for n in shape.names]
    angle = of_angles(stated.angle)
    turning = angular(stated.meaning)
    out += [
        Field(axis, "number", units=angle if k in turning else {}) for k, axis in enumerate(_AXES)
    ]
    for place, column in enumerate(shape.rest):
        kind = _kind(column)
        role = column.role if kind in ("time", "number") else f"rest {place}"
        out.append(Field(role, kind, False))
    return tuple(out)


def _kind(column: Named) -> Kind:
    """What the cells of a further column are; those without a role are not read."""
    if column.role == "time":
        return "time"
    if column.role.startswith(("std ", "u95 ")) or column.role == "rms":
        return "number"
    return "any" if column.title else "blank"


@dataclass(frozen=True)
class _Statement:
    """What header and settings state before a row is read.

    Attributes:
        meaning: Unit and kind of the coordinates.
        angles: Unit, zero and sense of the angles by the header.
        angle: Unit of the angles, None where it is not stated.
    """

    meaning: Meaning
    angles: Angles
    angle: str | None


def _stated(comments: Sequence[str], hints: ExportSettings, line: int) -> _Statement:
    """Meaning of the numbers according to the header."""
    head = [comment for comment in comments if is_remark(comment, _COMMENT)]
    text = "\n".join(line for line in head if not _named.of_other_quantity(line))
    words = {*_named.WORD.findall(text.lower())}
    unit = _only(_units(text, words), "units of length")
    kinds = _said(words, KIND_WORDS) | _kinds_by_titles(head)
    stated = _only(kinds, "kinds of coordinates")
    if stated is None and hints.coordinates is None:
        stated = "cartesian"
    with at(line=line):
        unit = settled_unit(unit, hints)
        kind = settled(stated, hints.coordinates, "coordinates", 'coordinates = "..."')
    if kind == "cartesian":
        return _Statement(Meaning(unit), Angles(), None)
    angle = _only(_said(words, ANGLE_WORDS), "angles")
    zeros = words & {"zenith", "elevation"} if kind == "spherical" else set()
    angles = Angles(angle, _only(zeros, "vertical angles"), "counter-clockwise")
    return _Statement(Meaning(unit, kind), angles, hints.angle or angle)


def _units(text: str, words: set[str]) -> set[str]:
    """Units of length that a text states; short ones count only after `units` or in brackets."""
    long = {word: unit for word, unit in UNIT_WORDS.items() if len(word) > 2}
    short = {one["said"] or one["below"] for one in _SHORT_UNIT.finditer(text)}
    return _said(words, long) | set(map(str.lower, short))


def _said(words: set[str], known: Mapping[str, _T]) -> set[_T]:
    """Meanings of the known ones among some words."""
    return {known[word] for word in words & known.keys()}


def _only(found: set[str], what: str) -> str | None:
    if len(found) > 1:
        raise InputError(
            f"the header names several {what} ({', '.join(sorted(found))})",
            "export it again or correct the header",
        )
    return next(iter(found), None)


def _kinds_by_titles(comments: Sequence[str]) -> set[str]:
    """Kinds of coordinates that match the column titles in the header."""
    found = set()
    for comment in comments:
        for delimiter in DELIMITERS:
            cut = _named.header(comment.strip().removeprefix(_COMMENT), 0, delimiter)
            roles = {
                "vertical" if c.role in ("zenith", "elevation") else c.role for c in cut.columns
            }
            found |= {kind for kind, axes in AXES.items() if set(axes) <= roles}
    return found


def _write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write a Cartesian export with header and timestamps."""
    words = {"mm": "Millimeters", "m": "Meters", "in": "Inches"}
    head = [
        "// SpatialAnalyzer ASCII point export",
        f"// Cartesian, Units: {words[unit]}",
        "// Collection::Group::Target, X, Y, Z, Timestamp",
    ]
    lines = [
        f"A::{group}::{target}, {', '.join(xyz)}, {time:%m/%d/%y %H:%M:%S}"
        for group, target, xyz, time in written(readings, unit, digits)
    ]
    return "\r\n".join([*head, *lines, ""]).encode()


READER = Reader("SpatialAnalyzer ASCII", _recognise, _read, _write, suffix=".txt", general=True)
