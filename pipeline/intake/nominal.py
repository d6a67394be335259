"""Nominal places of reflectors in a table that lies beside the export: a sketch, typed off a sheet.

Every name stands there once with x, y, z, in the base frame or the flange frame, which is how a
list of places differs from readings. Distances between reflectors are the same in every frame: they
show the unit of the table, and confirm it.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain
from pipeline.dialects._named import WORD
from pipeline.dialects._unit_words import UNIT_WORDS
from pipeline.dialects.workbook import sheets
from pipeline.intake._sheet import WIDE_GAP
from pipeline.readers._layout import JOINT
from pipeline.readers._text import Text, is_workbook, opened
from pipeline.readers.logs import LENGTH
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.settings import REACH_M

Place = tuple[float, float, float]
Apart = Mapping[tuple[str, str], float]
"""Distances between targets as read [m], by both names."""
_Row = tuple[str, Place, tuple[Any, ...]]
"""Name, three numbers, and form of a row."""

_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?")
_DELIMITERS = (";", "\t", None, ",")
_WORD = re.compile(r"[^\W\d_]+")
_UNITS = {"m": "metres", "mm": "mm", "in": "inches"}
_MOST = 200
"""Maximum number of places: a cell has some tens of reflectors."""
_MOST_LINES = 1000
"""Maximum number of lines of such a table, with its drawing and remarks."""
_MOST_WORDS = 4
"""Maximum number of words in the name of a place [1]."""
_QUANTITY = re.compile(r"[0-9]\s*(?:[^\W\d_]+|\")")
_SHORT_UNIT = re.compile(r"[\[(]\s*(m|in)\s*[\]),;]")
"""Units that are also ordinary words, where only a unit can be."""
_BODY = 3
"""Number of points whose three distances do not show which of them is wrong [1]."""
_FEWEST = 2
"""Minimum number of reflectors of the export in a table of places; fewer have no distance."""


@dataclass(frozen=True)
class PlaceTable:
    """A table in which every name stands once, with three numbers.

    Attributes:
        numbers: x, y, z by name, in the unit of the file.
        form: Form of its rows: separator, number of cells, decimals.
        block: Number of the part of the file between other lines that has the row, by name.
        unit: The only unit of length that other lines name; None if they name none or several.
    """

    numbers: Mapping[str, Place]
    form: tuple[object, ...]
    block: Mapping[str, int] = field(default_factory=dict)
    unit: str | None = None


@dataclass(frozen=True)
class NominalPlaces:
    """Tables of nominal places beside an export.

    Attributes:
        places: Position [m] by name as in campaign.toml, `load_point` among them.
        source: The file and unit of each.
        seen: A sentence on each file.
    """

    places: dict[str, Place] = field(default_factory=dict)
    source: dict[str, str] = field(default_factory=dict)
    seen: tuple[str, ...] = ()


def tables(files: Mapping[str, bytes]) -> dict[str, PlaceTable]:
    """The files that may be lists of places, by name.

    If files of one form share names, those of this form are readings, one group in each.
    """
    found: dict[str, PlaceTable] = {}
    for file, data in files.items():
        if not file.endswith(".toml"):
            with contextlib.suppress(InputError):
                found |= {name: one for name, at in _texts(file, data) if (one := _table(at))}
    alike: dict[object, list[str]] = {}
    for one in found.values():
        alike.setdefault(one.form, []).extend(one.numbers)
    return {k: one for k, one in found.items() if len({*alike[one.form]}) == len(alike[one.form])}


def _texts(file: str, data: bytes) -> Iterator[tuple[str, Text]]:
    """A file, or each of the several sheets of a workbook, by name."""
    there = sheets(file, data) if is_workbook(data) else {}
    if len(there) < 2:
        yield file, opened(file, data, None, None, None, lambda text: len(_rows(text)[0]))
    for name, text in there.items() if len(there) > 1 else ():
        yield f'{file}, sheet "{name}"', text


def _table(text: Text) -> PlaceTable | None:
    rows, others = _rows(text)
    numbers = {name: at for name, at, _ in rows}
    if not _FEWEST <= len(numbers) == len(rows) <= _MOST:
        return None
    block = {name: form[-1] for name, _, form in rows}
    units = {one for line in others for one in _units(line)} & LENGTH.keys()
    return PlaceTable(numbers, rows[0][2][:-1], block, min(units) if len(units) == 1 else None)


def _units(line: str) -> set[str]:
    """Units of length that a line names, not behind a number: that of a nest, or of a travel."""
    bare = _QUANTITY.sub(" ", line)
    words = {word for word in WORD.findall(bare.lower()) if word not in ("m", "in")}
    return {UNIT_WORDS[word] for word in words | {*_SHORT_UNIT.findall(bare)} if word in UNIT_WORDS}


def _rows(text: Text) -> tuple[list[_Row], list[str]]:
    """Name, three numbers and form of every line that consists of these, and the other lines."""
    found: list[_Row] = []
    others: list[str] = []
    for _, line in text.lines() if len(text) < _MOST_LINES else ():
        row = _row(line)
        here = [row] if row else [*filter(None, map(_row, WIDE_GAP.split(line)))]
        others += [line] if line.strip() and not here else []
        found += [(name, at, (*form, len(others))) for name, at, form in here]
        if len(found) > _MOST:
            break
    return found, others


def _row(line: str) -> _Row | None:
    """Name, three numbers and form of a line, by the first delimiter that yields them."""
    return next(filter(None, (_cut(line, delimiter) for delimiter in _DELIMITERS)), None)


def _cut(line: str, delimiter: str | None) -> _Row | None:
    """The same by one delimiter; a number of the row may precede the name.

    The name may be a whole number, and of several words where blanks separate the cells.
    """
    cells = _with_whole_name(
        [cell.strip(" \"'") for cell in line.strip().split(delimiter)], delimiter
    )
    counted = len(cells) > _FEWEST + 1 and cells[0].isdecimal()
    at = _of_three([False] * counted + [bool(_NUMBER.fullmatch(one)) for one in cells[counted:]])
    if at is None or JOINT in cells[at - 1] or (at > counted and not _WORD.search(cells[at - 1])):
        return None
    three = [cell.replace(",", ".") for cell in cells[at : at + 3]]
    x, y, z = map(float, three)
    decimals = tuple(len(cell.partition(".")[2]) for cell in three)
    return cells[at - 1], (x, y, z), (delimiter, len(cells), decimals)


def _with_whole_name(cells: list[str], delimiter: str | None) -> list[str]:
    """The cells, where blanks separate them with the first few words as one name."""
    words = list(itertools.takewhile(str.isalpha, cells)) if delimiter is None else []
    several = 1 < len(words) <= _MOST_WORDS
    return [" ".join(words), *cells[len(words) :]] if several else cells


def _of_three(number: Sequence[bool]) -> int | None:
    """The first of three numbers behind one cell that is none, or two; None if others follow."""
    at = next((k for k in range(1, min(3, len(number) - 2)) if all(number[k : k + 3])), None)
    return None if at is None or any(number[at + 3 :]) or number[at - 1] else at


def may_be_of(table: PlaceTable, targets: Collection[str]) -> bool:
    """Whether the names are those of targets, apart from a few as the load point."""
    known = sum(name in targets for name in table.numbers)
    return known >= _FEWEST and known > len(table.numbers) - known


def of_targets(table: PlaceTable, targets: Collection[str]) -> PlaceTable | None:
    """The parts of a table that name targets, if these are most of their names; else None.

    Other parts are of something else, as the rows of a robot's geometry.
    """
    blocks = {table.block[name] for name in table.numbers if name in targets}
    numbers = {name: at for name, at in table.numbers.items() if table.block[name] in blocks}
    found = replace(table, numbers=numbers)
    return found if may_be_of(found, targets) else None


def placed(
    found: Mapping[str, PlaceTable], measured: Sequence[str], base: Sequence[str], apart_m: Apart
) -> NominalPlaces:
    """The places in metres, as far as distances confirm them.

    Args:
        found: The tables of places, by file.
        measured: Targets on the effector.
        base: Base reflectors.
        apart_m: Distances between either as read.
    """
    places: dict[str, Place] = {}
    source: dict[str, str] = {}
    seen = []
    each = [(file, part) for file, one in found.items() for part in _in_one_unit(one, apart_m)]
    for file, table in each:
        mine, sentence = _of(table, file, measured, base, apart_m)
        new = {name: at for name, at in mine.places.items() if name not in places}
        places |= new
        source |= {name: mine.source[name] for name in new}
        seen.append(sentence)
    return NominalPlaces(places, source, tuple(seen))


def _in_one_unit(table: PlaceTable, apart_m: Apart) -> list[PlaceTable]:
    """The table, or each of its parts if distances show different units in them."""
    blocks = dict.fromkeys(table.block[name] for name in table.numbers)
    parts = [replace(table, numbers={name: at for name, at in table.numbers.items()
                                     if table.block[name] == one}) for one in blocks]  # fmt: skip
    units = {_unit(part, apart_m) for part in parts} - {None}
    return parts if len(units) > 1 else [table]


def _unit(table: PlaceTable, apart_m: Apart) -> str | None:
    """The unit in which distances are those read, apart from those of one name; None if in none."""
    off = {unit: _off(table, factor, apart_m) for unit, factor in LENGTH.items()}
    unit = min(off, key=off.__getitem__)
    near = off[unit] < GROSS_DISTANCE_M
    return unit if near and _worst(table, LENGTH[unit], apart_m)[2] < GROSS_DISTANCE_M else None


def _of(
    table: PlaceTable, file: str, measured: Sequence[str], base: Sequence[str], apart_m: Apart
) -> tuple[NominalPlaces, str]:
    """The places of one table, and the sentence on it."""
    begin = f"{file} is a list of nominal places, not an export"
    off = min(_off(table, factor, apart_m) for factor in LENGTH.values())
    unit = _unit(table, apart_m) or (table.unit if off == np.inf else None)
    own = [name for name in table.numbers if name in (*measured, *base)]
    if unit is None or not own:
        why = f"its distances are {_mm(off)} or more from those read" if off < np.inf else (
            "no distance can be compared with the readings yet"
        )  # fmt: skip
        return NominalPlaces(), f"{begin}; {why}: fill in its places by hand"
    renamed = dict(zip(own, own, strict=True))
    if (load := _load_point(table, measured, base, LENGTH[unit])) is not None:
        renamed[load] = "load_point"
    also = f", and {load} as load_point" if load else ""
    return _in_metres(table, file, unit, renamed), (
        f"{begin}: {listed(own, most=12)}{also} in {_UNITS[unit]}, "
        f"{_compared(table, LENGTH[unit], apart_m)}; confirm them in campaign.toml"
    )


def _in_metres(
    table: PlaceTable, file: str, unit: str, renamed: Mapping[str, str]
) -> NominalPlaces:
    """The places of a table in one of its units, by our names for those in it."""
    places = {ours: _metres(table.numbers[name], LENGTH[unit]) for name, ours in renamed.items()}
    source = {
        ours: f"{file}, {_UNITS[unit]}{'' if ours == name else f', {name}'}: confirm it"
        for name, ours in renamed.items()
    }
    return NominalPlaces(places, source)


def _compared(table: PlaceTable, factor: float, apart_m: Apart) -> str:
    """How far distances are from those read, and whose are clearly farther than all others."""
    off = _each_off(table, factor, apart_m)
    if not off:
        return "as it states; none of their distances can be compared with those read yet"
    worst, most, rest = _worst(table, factor, apart_m)
    if most <= CLEARLY_NEARER * rest:
        return f"distances within {_mm(most)} of those read"
    return (
        f"distances within {_mm(rest)} of those read, but those of {worst} up to {_mm(most)} off: "
        "measure or correct it"
    )


def _worst(table: PlaceTable, factor: float, apart_m: Apart) -> tuple[str, float, float]:
    """The name without which distances agree best, the largest difference with and without it [m].

    Three points do not show which of them is wrong.
    """
    off = _each_off(table, factor, apart_m)
    names = dict.fromkeys(name for pair in off for name in pair)
    most = max(off.values())
    rest = {name: max((d for pair, d in off.items() if name not in pair), default=most)
            for name in names}  # fmt: skip
    worst = min(rest, key=rest.__getitem__)
    return worst, most, rest[worst] if len(names) > _BODY else most


def _off(table: PlaceTable, factor: float, apart_m: Apart) -> float:
    """Median difference of distances stated and read [m]; infinite if none is in both."""
    off = _each_off(table, factor, apart_m)
    return float(np.median([*off.values()])) if off else np.inf


def _each_off(table: PlaceTable, factor: float, apart_m: Apart) -> dict[tuple[str, str], float]:
    """Differences of distances stated and read [m], of pairs in both."""
    return {
        (one, other): abs(factor * math.dist(table.numbers[one], table.numbers[other]) - read)
        for (one, other), read in apart_m.items()
        if {one, other} <= table.numbers.keys()
    }


def _load_point(
    table: PlaceTable, measured: Sequence[str], base: Sequence[str], factor: float
) -> str | None:
    """The only name that is no target, if it stands among those on the effector."""
    names = list(table.numbers)
    others = [name for name in names if name not in (*measured, *base)]
    on = [k for k, name in enumerate(names) if name in measured]
    if len(others) != 1 or not on or max(map(abs, table.numbers[others[0]])) * factor > REACH_M:
        return None
    return others[0] if min(on) - 1 <= names.index(others[0]) <= max(on) + 1 else None


def _metres(at: Place, factor: float) -> Place:
    x, y, z = (float(f"{value * factor:.12g}") for value in at)
    return x, y, z


def _mm(metres: float) -> str:
    return f"{plain(1e3 * metres, 2)} mm"
