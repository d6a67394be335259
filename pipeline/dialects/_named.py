"""Interpret column titles: role, axis and unit."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources

from pipeline.base.errors import InputError
from pipeline.dialects._cells import IN_BRACKETS, bare, delimiter_of
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.readers._text import Text, shortened

_UNIT_WORDS = UNIT_WORDS | ANGLE_WORDS

_AXES = {
    "x": "x", "y": "y", "z": "z",
    "r": "range", "range": "range", "radius": "range", "distance": "range", "d": "range",
    "theta": "azimuth", "azimuth": "azimuth", "az": "azimuth", "hz": "azimuth",
    "phi": "vertical", "zenith": "zenith", "elevation": "elevation", "el": "elevation",
    "inclination": "elevation",
}  # fmt: skip
_SPACE = ("x", "y", "z")
COVARIANCE = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")
_FILLING = {
    "coordinate", "coord", "koordinate", "pos", "position", "angle", "value", "actual", "measured",
}  # fmt: skip
_STANDARD_WORDS = {
    "std", "stddev", "sigma", "uncertainty", "sd", "unc", "u", "1", "dev", "standard", "deviation",
}  # fmt: skip
DEVIATION = {"dev", "deviation"}
"""With an axis alone this means the deviation from a nominal place, not an uncertainty."""
_TIMES = ({"time"}, {"timestamp"}, {"date", "time"}, {"datetime"}, {"date"}, {"time", "stamp"})
_NAMES = {
    "collection": "collection", "group": "group", "group name": "group", "groupname": "group",
    "point group": "group",
    "target": "target", "target name": "target", "point": "target", "point name": "target",
    "pointname": "target", "point id": "target", "pointid": "target", "name": "target",
    "punkt": "target", "punktname": "target", "gruppe": "group",
    "reflector": "reflector",
    "delete": "delete", "deleted": "delete", "rms": "rms",
    **{one: one for one in COVARIANCE},
}  # fmt: skip
_OTHER_UNITS = {"km", "dm", "nm", "mil", "mils", "thou", "yd", "yard", "yards"}
_SHORT_WORD = 3
"""Maximum length of an abbreviated unit [1]: mm, in, deg."""
_SHORT_UNITS = {word for word in _UNIT_WORDS if len(word) <= _SHORT_WORD}
_EXPANDED_WORDS = {"u", "95", "expanded", "k", "2", "uncertainty"}
FOREIGN = tomllib.loads((resources.files(__package__) / "words.toml").read_text("utf-8"))
"""Words of other languages, those of `words.toml`."""
_FOREIGN_UNITS = "|".join(FOREIGN["unit"])
UNIT_LINE = re.compile(
    rf"\b(units?|einheit(en)?|co-?ordinates?|{'|'.join(FOREIGN['all'])}|koordinaten|lengths?|längen|{_FOREIGN_UNITS}|"
    rf"{'|'.join(FOREIGN['coordinates'])})\b",
    re.IGNORECASE,
)
_OF_COORDINATES = {
    "unit", "units", "einheit", "einheiten", "coordinate", "coordinates", "koordinaten", "length",
    "lengths", "längen", "linear", "distance", "distances", "position", "positions", "points",
    "x", "y", "z", "xyz", "angle", "angles", "angular", "winkel", "cartesian", "spherical",
    "cylindrical", "polar", "kartesisch", *FOREIGN["unit"], *FOREIGN["coordinates"],
}  # fmt: skip
"""Words before a unit that are compatible with its being that of the coordinates."""
_BETWEEN = {
    "in", "is", "are", "of", "the", "all", "and", "as", "m", "und", "sind", "alle",
    *FOREIGN["between"], *FOREIGN["all"],
}  # fmt: skip
_OF_THE_FILE = {
    "job", "file", "export", "exported", "report", "measurement", "measurements", "measured",
    "format", "datei", "messung", "messungen", "gemessen", "gemessene", "bericht", "projekt",
    "project", "system", "display", "default", "lineare", "der", "die",
}  # fmt: skip
"""Words before a unit that say whose unit it is, but not of which other quantity."""
_OPEN = _OF_COORDINATES | _BETWEEN | _OF_THE_FILE
UNITS = re.compile(rf"\b(units?|einheit(en)?|{_FOREIGN_UNITS})\b", re.IGNORECASE)
_APART = re.compile(r"[;,|\t]|  ")
WORD = re.compile(r"[^\W\d_]+|°")
_SHORT = re.compile(
    r"(?:[:=(\[,/]|\bin)\s*(m|in)(?=\s*(?:$|[)\],;/|]|gon\b|deg|rad|mm\b))", re.IGNORECASE
)
"""Units that are also ordinary words, at places where only a unit can be."""


@dataclass(frozen=True)
class Named:
    """One column of a header.

    Attributes:
        title: Title as written.
        role: `x`, `y`, `z`, `range`, `azimuth`, `vertical`, `zenith`, `elevation`; the same after
            `std ` or `u95 `; `time`, `group`, `target`, `collection`, `delete`, `rms`; or empty if
            unknown.
        unit: `mm`, `m`, `in`, `um`, `ft`, `ftUS`, `cm`, `deg`, `rad`, `gon`, or None if not stated.
    """

    title: str
    role: str
    unit: str | None


@dataclass(frozen=True)
class Header:
    """A header line.

    Attributes:
        line: Line number, counted from 1.
        delimiter: Separator of the columns.
        columns: Columns from left to right; an empty last one stands for a delimiter at the end of
            rows.
        first: Line number of the first row, 0 for the line after the header.
    """

    line: int
    delimiter: str
    columns: tuple[Named, ...]
    first: int = 0

    @property
    def begins(self) -> int:
        """Line number of the first row."""
        return self.first or self.line + 1

    def where(self, role: str) -> int | None:
        """Index of the column with a role; None if there is none."""
        return next((k for k, column in enumerate(self.columns) if column.role == role), None)

    def has(self, *roles: str) -> bool:
        """Whether there is a column for each of the roles."""
        return all(self.where(role) is not None for role in roles)


@lru_cache(10_000)
def named(title: str) -> Named:
    """Role and unit of a column, derived from its title."""
    rest = bare(title).lower()
    units = [one for one in IN_BRACKETS.findall(rest) if one in _UNIT_WORDS]
    unit = _UNIT_WORDS[units[-1]] if units else None
    rest = IN_BRACKETS.sub(lambda one: " " if one[1] in _UNIT_WORDS else one[0], rest)
    words = re.findall(r"[^\W\d_]+|[0-9]+", rest)
    if unit is None and len(words) > 1 and words[-1] in _SHORT_UNITS:
        unit = _UNIT_WORDS[words.pop()]
    return Named(bare(title), _role(words), unit)


def _role(words: Sequence[str]) -> str:
    bag = set(words)
    if bag in _TIMES:
        return "time"
    fused = re.fullmatch(r"(u|s|std|sigma)(x|y|z)(95)?", "".join(words))
    if fused:
        return f"{'u95' if fused[3] else 'std'} {fused[2]}"
    return _NAMES.get(" ".join(words)) or _of_axis(words)


def _of_axis(words: Sequence[str]) -> str:
    """Role of a column that refers to one axis: its coordinate or its uncertainty."""
    axes = [word for word in words if word in _AXES]
    if len(axes) != 1:
        return ""
    axis, others = _AXES[axes[0]], {*words} - {*axes} - _FILLING
    if not others:
        return axis
    if others <= _EXPANDED_WORDS and others & {"95", "expanded"}:
        return f"u95 {axis}"
    return f"std {axis}" if others <= _STANDARD_WORDS and others - DEVIATION else ""


def header(line: str, number: int, delimiter: str | None = None) -> Header:
    """Interpret a line as a header."""
    delimiter = delimiter or delimiter_of(line)
    return Header(number, delimiter, in_context([named(cell) for cell in line.split(delimiter)]))


def in_context(columns: Sequence[Named]) -> tuple[Named, ...]:
    """Adjust roles that depend on other titles: U(95) after its axis, a date with a time of day."""
    out: list[Named] = []
    titles = [_words(column.title) for column in columns]
    alternate = titles.count({"u", "95"}) == len(_SPACE)
    for column, words in zip(columns, titles, strict=True):
        behind = out[-1].role if out else ""
        if alternate and words == {"u", "95"} and behind in _SPACE:
            column = replace(column, role=f"u95 {behind}")
        if words == {"date"} and {"time"} in titles:
            column = replace(column, role="date")
        out.append(column)
    return tuple(out)


def _words(title: str) -> set[str]:
    rest = IN_BRACKETS.sub(lambda one: " " if "[" in one[0] else one[0], title.lower())
    return set(re.findall(r"[^\W\d_]+|[0-9]+", rest)) - {*UNIT_WORDS}


def find(lines: Sequence[str]) -> Header | None:
    """The first line that names three coordinates."""
    for number, line in enumerate(lines, 1):
        found = header(line, number)
        comment = line.lstrip().startswith(("//", "#"))
        if not comment and found.has("x", "y", "z"):
            return found
    return None


def is_unit_title(title: str) -> bool:
    """Whether a column states the unit of each row."""
    return bare(title).lower() in ("unit", "units", "einheit", "length unit")


def remark(text: Text, header: Header) -> str | None:
    """Comment mark of lines between rows; None if there is none or it is ambiguous.

    It is ambiguous if there are several, or if such a line has as many cells as a row.
    """
    if not any(mark in text.data for mark in (b"#", b"//", b"%", b"!")):  # as in most files
        return None
    begins = re.compile(rb"^[ \t]*(#|//|%|!).*$", re.MULTILINE)
    found = [(m[1].decode(), m[0].decode()) for m in begins.finditer(text.data)]
    marks = {mark for mark, _ in found}
    rows = any(line.count(header.delimiter) >= len(header.columns) - 1 for _, line in found)
    return marks.pop() if len(marks) == 1 and not rows else None


def said_units(line: str, of_coordinates: bool = False) -> set[str]:
    """Units of length and angle named in a line; words with other meanings are ignored.

    Args:
        line: A line about units.
        of_coordinates: Count only units after a word that means coordinates or units as such: a
            radius, a temperature or an unknown quantity has a unit of its own.
    """
    found, counts = set(), True
    units = _units_at(line)
    every = len(line)  # from where on it is about all readings: RUN 3 (all values in mm)
    for one in WORD.finditer(line):
        word = one[0].lower()
        if word in FOREIGN["all"]:
            every, counts = min(every, one.start()), True
        elif one.start() in units:
            found |= {units[one.start()]} if counts else set()
        elif of_coordinates and word not in _BETWEEN | _OF_THE_FILE:
            before = line[every : one.start()] or line[: one.start()]
            counts = word in _OF_COORDINATES and not _of_other(before)
    return found


def _units_at(line: str) -> dict[int, str]:
    """The units in a line by where their words begin."""
    short = {one.start(1) for one in _SHORT.finditer(line)}
    words = {one.start(): one[0].lower() for one in WORD.finditer(line)}
    return {at: _UNIT_WORDS[word] for at, word in words.items()
            if word in _UNIT_WORDS and (word not in ("m", "in") or at in short)}  # fmt: skip


def _of_other(before: str) -> bool:
    """Whether the words before `units` or `coordinates` refer them to another quantity."""
    words = WORD.findall(_APART.split(before)[-1].lower())
    return not {*words} <= _OPEN | {*_UNIT_WORDS}


def of_other_quantity(line: str) -> bool:
    """Whether a line states the unit of another quantity, such as a tolerance."""
    return any(_of_other(line[: one.start()]) for one in UNITS.finditer(line))


def known_units(columns: Sequence[Named]) -> None:
    """Check that no column of lengths has an unsupported unit.

    It would otherwise count as a column without a stated unit.

    Raises:
        InputError: One has.
    """
    for column in columns:
        words = re.findall(r"[^\W\d_]+", column.title.lower())
        if column.unit is None and words and words[-1] in _OTHER_UNITS:
            raise InputError(
                f'the coordinates of column "{shortened(column.title)}" are in {words[-1]}',
                f"export them in one of {', '.join(dict.fromkeys(UNIT_WORDS.values()))}",
            )


def one_unit(found: Header, roles: Sequence[str]) -> str | None:
    """The common unit of some columns, None if none states one.

    Raises:
        InputError: They state different ones.
    """
    columns = [column for column in found.columns if column.role in roles]
    known_units(columns)
    units = {column.unit for column in columns}
    if len(units) > 1:
        titles = ", ".join(column.title for column in columns)
        raise InputError(
            f"the columns {titles} have different units", "export all of them in the same unit"
        )
    return units.pop() if units else None
