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
from dataclasses import dataclass, field

import numpy as np

from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain
from pipeline.dialects.workbook import sheets
from pipeline.readers._layout import JOINT
from pipeline.readers._text import Text, is_workbook, opened
from pipeline.readers.logs import LENGTH
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.settings import REACH_M

Place = tuple[float, float, float]
Apart = Mapping[tuple[str, str], float]
"""Distances between targets as read [m], by both names."""

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
_WIDE_GAP = re.compile(r"\t+| {2,}")
_FEWEST = 2
"""Minimum number of reflectors of the export in a table of places; fewer have no distance."""


@dataclass(frozen=True)
class PlaceTable:
    """A table in which every name stands once, with three numbers.

    Attributes:
        numbers: x, y, z by name, in the unit of the file.
        form: Form of its rows: separator, number of cells, decimals.
    """

    numbers: Mapping[str, Place]
    form: tuple[object, ...]


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
        yield file, opened(file, data, None, None, None, lambda text: len(_rows(text)))
    for name, text in there.items() if len(there) > 1 else ():
        yield f'{file}, sheet "{name}"', text


def _table(text: Text) -> PlaceTable | None:
    rows = _rows(text)
    numbers = {name: at for name, at, _ in rows}
    if not _FEWEST <= len(numbers) == len(rows) <= _MOST:
        return None
    return PlaceTable(numbers, rows[0][2])


def _rows(text: Text) -> list[tuple[str, Place, tuple[object, ...]]]:
    """Name, three numbers and form of every line that consists of these."""
    found: list[tuple[str, Place, tuple[object, ...]]] = []
    for _, line in text.lines() if len(text) < _MOST_LINES else ():
        row = _row(line)
        found += [row] if row else filter(None, map(_row, _WIDE_GAP.split(line)))
        if len(found) > _MOST:
            break
    return found


def _row(line: str) -> tuple[str, Place, tuple[object, ...]] | None:
    """Name, three numbers and form of a line, by the first delimiter that yields them."""
    return next(filter(None, (_cut(line, delimiter) for delimiter in _DELIMITERS)), None)


def _cut(line: str, delimiter: str | None) -> tuple[str, Place, tuple[object, ...]] | None:
    """The same by one delimiter; a number of the row may precede the name.

    The name may be a whole number, and of several words where blanks separate the cells.
    """
    cells = _with_whole_name(
        [cell.strip(" \"'") for cell in line.strip().split(delimiter)], delimiter
    )
    counted = cells[:1] != [] and cells[0].isdecimal() and len(cells) > _FEWEST + 1
    numbers = [bool(_NUMBER.fullmatch(cell)) for cell in cells]
    at = _of_three([False, *numbers[1:]] if counted else numbers)
    if at is None or at > 2 or JOINT in cells[at - 1]:
        return None
    if not _WORD.search(cells[at - 1]) and at > counted:
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
    """The first of three numbers behind a cell that is none, None if others follow."""
    at = next((k for k in range(1, len(number) - 2) if all(number[k : k + 3])), None)
    return None if at is None or any(number[at + 3 :]) or number[at - 1] else at


def may_be_of(table: PlaceTable, targets: Collection[str]) -> bool:
    """Whether the names are those of targets, apart from a few as the load point."""
    known = sum(name in targets for name in table.numbers)
    return known >= _FEWEST and known > len(table.numbers) - known


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
    for file, table in found.items():
        mine, sentence = _of(table, file, measured, base, apart_m)
        new = {name: at for name, at in mine.places.items() if name not in places}
        places |= new
        source |= {name: mine.source[name] for name in new}
        seen.append(sentence)
    return NominalPlaces(places, source, tuple(seen))


def _of(
    table: PlaceTable, file: str, measured: Sequence[str], base: Sequence[str], apart_m: Apart
) -> tuple[NominalPlaces, str]:
    """The places of one table, and the sentence on it."""
    begin = f"{file} is a list of nominal places, not an export"
    off = {unit: _off(table, factor, apart_m) for unit, factor in LENGTH.items()}
    unit = min(off, key=off.__getitem__)
    if not off[unit] < GROSS_DISTANCE_M:
        why = f"its distances are {_mm(off[unit])} from those read" if off[unit] < np.inf else (
            "no distance can be compared with the readings yet"
        )  # fmt: skip
        return NominalPlaces(), f"{begin}; {why}: fill in its places by hand"
    own = [name for name in table.numbers if name in (*measured, *base)]
    renamed = dict(zip(own, own, strict=True))
    if (load := _load_point(table, measured, base, LENGTH[unit])) is not None:
        renamed[load] = "load_point"
    places = {ours: _metres(table.numbers[name], LENGTH[unit]) for name, ours in renamed.items()}
    source = {
        ours: f"{file}, {_UNITS[unit]}{'' if ours == name else f', {name}'}: confirm it"
        for name, ours in renamed.items()
    }
    also = f", and {load} as load_point" if load else ""
    return NominalPlaces(places, source), (
        f"{begin}: {listed(own, most=12)}{also} in {_UNITS[unit]}, distances within "
        f"{_mm(off[unit])} of those read; confirm them in campaign.toml"
    )


def _off(table: PlaceTable, factor: float, apart_m: Apart) -> float:
    """Median difference of distances stated and read [m]; infinite if none is in both."""
    off = [
        abs(factor * math.dist(table.numbers[one], table.numbers[other]) - read)
        for (one, other), read in apart_m.items()
        if {one, other} <= table.numbers.keys()
    ]
    return float(np.median(off)) if off else np.inf


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
