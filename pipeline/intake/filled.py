"""Data of a filled-in measurement sheet besides its logs: the sheet `set-up` of the workbook.

Its rows are keys of campaign.toml with a value, or three of a position, and their unit; a row
without a key is a note. Numbers may be written in any common way.
"""

from __future__ import annotations

import contextlib
import datetime
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pydantic import TypeAdapter, ValidationError

from pipeline.base.errors import InputError
from pipeline.base.shown import printable
from pipeline.base.strict import Temperature
from pipeline.dialects._cells import cells_or_none
from pipeline.intake.blank import KnownData
from pipeline.readers._text import is_workbook, opened
from pipeline.readers.logs import FORCE, LENGTH
from pipeline.reduction.settings import HALL_M, REACH_M

_SHEET = "set-up"
_HEAD = ("key", "what", "unit")
_KEY = ("key", "schlüssel", "clé")
_FRAMES = {"tool": REACH_M, "base_frame": HALL_M}
_WORDS = ("robot", "operator", "robot_unit.serial", "instrument.model", "instrument.serial",
          "scale.serial")  # fmt: skip
_DAY = re.compile(r"(\d{4})-(\d\d?)-(\d\d?)|(\d\d?)\.\s?(\d\d?)\.\s?(\d{4})")


@dataclass(frozen=True)
class _Row:
    """A filled row.

    Attributes:
        line: Its line.
        key: Of campaign.toml; empty for a note.
        what: In words.
        unit: As written.
        cells: Filled cells.
    """

    line: int
    key: str
    what: str
    unit: str
    cells: tuple[str, ...]


def filled_in(files: Mapping[str, bytes]) -> tuple[KnownData, list[str]]:
    """Content of the first sheet `set-up`, and what of it could not be used, in sentences.

    Args:
        files: Content by name.
    """
    for name, data in files.items():
        if is_workbook(data):
            with contextlib.suppress(InputError):
                return _known(name, [*_rows(name, data)])
    return KnownData(), []


def _rows(name: str, data: bytes) -> Iterator[_Row]:
    text = opened(name, data, _SHEET, None, None, lambda _: 1)
    below = False
    for line, said in text.lines():
        cells = cells_or_none(said.strip("\r\n"), "\t") or []
        if below and len(cells) > len(_HEAD) and any(cells[len(_HEAD) :]):
            key, what, unit, *rest = cells
            yield _Row(line, key, what, unit, tuple(one for one in rest if one))
        below = below or (cells[:1] != [] and cells[0].lower() in _KEY)


def _known(name: str, rows: list[_Row]) -> tuple[KnownData, list[str]]:
    known, wrong = KnownData(), []
    for row in rows:
        try:
            known = _with(known, row)
        except ValueError as problem:
            text = printable(" ".join(row.cells), 60)
            wrong.append(
                f'{name}, line {row.line}: {row.key} is "{text}", {problem}; it stays open.'
            )
    return known, wrong


def _with(known: KnownData, row: _Row) -> KnownData:
    """The known data with one more row.

    Raises:
        ValueError: Its content is not valid; the reason in words.
    """
    table, _, name = row.key.rpartition(".")
    if row.key in _WORDS:
        return replace(known, words={**known.words, row.key: " ".join(row.cells)})
    if row.key == "date":
        return replace(known, words={**known.words, "date": _day(" ".join(row.cells))})
    if row.key == "temperature_c":
        return replace(known, temperature_c=_degrees(row))
    if row.key == "scale.sigma_n":
        return replace(known, sigma_n=_above_zero(row))
    if table in _FRAMES:
        return replace(known, places={**known.places, name: _place(row, _FRAMES[table])})
    if table == "test_pose" and name in ("q", "axes", "force_n"):
        return replace(known, test_pose={**known.test_pose, name: _numbers(row, {}, "")})
    note = f"{row.what or row.key}: {' '.join(row.cells)} {row.unit}".strip()
    return replace(known, notes=(*known.notes, printable(note, 200)))


def _day(text: str) -> str:
    found = _DAY.match(text)
    if found is None:
        raise ValueError("no date as 2026-03-01 or 1.3.2026")
    a, b, c, day, month, year = found.groups()
    try:
        return datetime.date(*map(int, (a, b, c) if a else (year, month, day))).isoformat()
    except ValueError:
        raise ValueError("no day of any year") from None


def _degrees(row: _Row) -> float:
    (found,) = _numbers(row, {"degc": 1.0, "°c": 1.0, "c": 1.0}, "degc", 1)
    try:
        return TypeAdapter(Temperature).validate_python(found)
    except ValidationError:
        raise ValueError("no temperature of a hall in degC") from None


def _above_zero(row: _Row) -> float:
    (found,) = _numbers(row, FORCE, "n", 1)
    if found <= 0:
        raise ValueError("not above zero")
    return found


def _place(row: _Row, most_m: float) -> tuple[float, float, float]:
    x, y, z = _numbers(row, LENGTH, "m", 3)
    if max(map(abs, (x, y, z))) > most_m:
        raise ValueError(f"beyond {most_m:g} m: is the unit right")
    return x, y, z


def _numbers(
    row: _Row, units: Mapping[str, float], usual: str, count: int | None = None
) -> list[float]:
    """Numbers of a row in SI, one per cell or all in one.

    Raises:
        ValueError: They are not numbers, too few or too many, or in another unit.
    """
    unit = (row.unit or usual).lower()
    factor = units.get(unit) if units else 1.0
    if factor is None:
        raise ValueError(f'in "{row.unit}", which is none of {", ".join(units)}')
    cells = re.findall(r"[^;\s]+", " ".join(row.cells))
    try:
        values = [float(one.replace(",", ".")) for one in cells]
    except ValueError:
        raise ValueError("not a number" if count == 1 else "no numbers") from None
    if count not in (None, len(values)):
        raise ValueError(f"{len(values)} numbers and not {count}")
    return [float(f"{value * factor:.12g}") for value in values]
