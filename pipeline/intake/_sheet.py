"""Cut a file into a table of cells: separator, preamble, titles, first row, blocks.

The meaning of columns is not decided here. The separator is the one that cuts most lines alike into
rows of numbers; lines above the first row are titles, units or preamble. What these state of the
whole table (kind of coordinates, units, sense of azimuths) is collected from them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.base.errors import InputError
from pipeline.dialects._cells import (
    IN_BRACKETS,
    MARKS,
    bare,
    cells_or_none,
    is_number,
    is_plain,
    is_remark,
    is_turn,
    seems_turn,
)
from pipeline.dialects._coordinates import AXES, KIND_WORDS, ZEROS
from pipeline.dialects._named import FOREIGN, UNIT_LINE, WORD, said_units
from pipeline.dialects._titles import name_a_place, titled
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.readers._text import Text

_SEPARATORS = (";", "\t", "|", ",", " ")
"""Possible separators of cells; of two that cut a file alike the first is taken, which is the rarer
character."""
_SAMPLED = 400
"""Number of lines from which a table is recognised: the longest preamble seen has 60, and a pose
has 10 rows."""
_LEAST = 3
"""Minimum number of numbers in a row: a point."""
WIDE_GAP = re.compile(r"\t+| {2,}")
_ABOVE = 3
"""Number of lines above the first row in which titles are looked for: titles, units and a rule."""
_RULE = re.compile(r"[-=_+|\s;,]+")


@dataclass(frozen=True)
class Sheet:
    """A table in a file.

    Attributes:
        delimiter: Separator of cells; a blank stands for any run of blanks and tabs.
        header: Line of the titles, 0 if there are none.
        commented: Comment mark of the line of the titles, None if it has none.
        first: Line of the first row.
        comment: Comment mark of lines that are not rows, None if there are none.
        titles: One for each column, empty where there is none.
        units: Units in the line below the titles, one for each column; empty where it has none.
        columns: Cells of the sampled rows, column by column.
        lines: Line of each sampled row.
        preamble: Lines above titles and rows.
        stray: Whether a line above the first row seems to contain titles, but not one per column.
        blocks: Lines at which the same titles occur again.
    """

    delimiter: str
    header: int
    commented: str | None
    first: int
    comment: str | None
    titles: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    preamble: tuple[str, ...]
    stray: bool
    blocks: tuple[int, ...]

    @property
    def top(self) -> int:
        """Line of the titles, or of the first row if there are none."""
        return self.header or self.first

    @property
    def titled(self) -> bool:
        """Whether the columns have titles."""
        return self.header > 0


@dataclass(frozen=True)
class _Rows:
    """Lines that one separator cuts into equally many cells.

    `chunks` is how many of them stand between two wide gaps of most lines, if blanks separate them.
    """

    delimiter: str
    width: int
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    chunks: tuple[int, ...] = ()

    @property
    def rank(self) -> tuple[int, int]:
        numbers = sum(map(is_number, self.rows[0][1])) if self.rows else 0
        return len(self.rows), numbers


def sheet(text: Text) -> Sheet | None:
    """The table in a file, None if no separator gives rows with three numbers."""
    lines = list(text.lines(1, _SAMPLED))
    mark = _mark(lines)
    found = max((_rows(lines, one, mark) for one in _SEPARATORS), key=lambda one: one.rank)
    if not found.rows:
        return None
    found = _below_titles(_without_numbered_titles(found), lines, mark)
    above = [(n, line) for n, line in lines if n < found.rows[0][0]]
    header, titles, units, stray = _titles(above, found, mark)
    commented = next((m for m in MARKS if header and is_remark(text.line(header), m)), None)
    return Sheet(
        delimiter=found.delimiter,
        header=header,
        commented=commented,
        first=_first(above, found, header, mark),
        comment=mark,
        titles=titles,
        units=units,
        columns=tuple(zip(*(cells for _, cells in found.rows), strict=True)),
        lines=tuple(n for n, _ in found.rows),
        preamble=tuple(line for n, line in above if n != header),
        stray=stray,
        blocks=_blocks(text, header),
    )


def cells_of(line: str, delimiter: str) -> list[str] | None:
    """The cells of a line; if the separator is a blank, runs of blanks and tabs count as one."""
    if delimiter != " ":
        return cells_or_none(line, delimiter)
    return cells_or_none(" ".join(line.split()), " ") if '"' in line else line.split()


def _mark(lines: Sequence[tuple[int, str]]) -> str | None:
    """The comment mark: the most frequent one at the start of lines, if some lines have none."""
    begins = Counter(m for _, line in lines for m in MARKS if is_remark(line, m))
    if not begins:
        return None
    mark, often = begins.most_common(1)[0]
    rows = sum(bool(line.strip()) for _, line in lines)
    return mark if often < rows else None


def _rows(lines: Sequence[tuple[int, str]], delimiter: str, mark: str | None) -> _Rows:
    """The lines with the most frequent number of cells among those that contain a point."""
    found: dict[int, list[tuple[int, tuple[str, ...]]]] = {}
    for number, line in lines:
        cells = cells_of(line, delimiter) if is_plain(line, mark) else None
        if delimiter == " " and _has_turn(line):
            continue
        if cells and sum(map(is_number, cells)) >= _LEAST:
            found.setdefault(len(cells), []).append((number, tuple(cells)))
    if not found:
        return _Rows(delimiter, 0, ())
    width = max(found, key=lambda one: len(found[one]))
    rows = tuple(found[width])
    return _Rows(delimiter, width, rows, _chunks(dict(lines), rows) if delimiter == " " else ())


def _has_turn(line: str) -> bool:
    """Whether one of three or more cells is an angle whose parts are apart by single blanks.

    Degrees and minutes alone may be two cells, unless tabs separate cells.
    """
    tabs = "\t" in line
    cells = [cell.strip() for cell in (line.split("\t") if tabs else WIDE_GAP.split(line.strip()))]
    turns = [cell for cell in cells if (seems_turn if tabs else is_turn)(cell)]
    return bool(turns) and len(turns) + sum(map(is_number, {*cells} - {*turns})) >= _LEAST


def _chunks(
    lines: Mapping[int, str], rows: Sequence[tuple[int, tuple[str, ...]]]
) -> tuple[int, ...]:
    """How many cells stand between two wide gaps of most rows, which blanks separate."""
    cut = (WIDE_GAP.split(lines[number].strip()) for number, _ in rows)
    often = Counter(tuple(len(chunk.split()) for chunk in one) for one in cut)
    return often.most_common(1)[0][0]


def _without_numbered_titles(found: _Rows) -> _Rows:
    """The rows without a first one that only counts the columns, as pandas writes it."""
    counted = [cell for cell in found.rows[0][1] if cell]
    starts = [str(k) for k in range(len(counted))], [str(k + 1) for k in range(len(counted))]
    if counted not in starts or len(found.rows) == 1 or found.rows[0][0] != 1:
        return found
    return replace(found, rows=found.rows[1:])


def _below_titles(found: _Rows, lines: Sequence[tuple[int, str]], mark: str | None) -> _Rows:
    """The rows below a line that names coordinates; only a damaged file has some above it."""
    first, last = found.rows[0][0], found.rows[-1][0]
    if any(n < first and name_a_place(_fitting(line, found, mark)) for n, line in lines):
        return found
    below = (
        n for n, line in lines if first < n < last and name_a_place(_fitting(line, found, mark))
    )
    header = next(below, None)
    if header is None:
        return found
    return replace(found, rows=tuple(row for row in found.rows if row[0] > header))


def _titles(
    above: Sequence[tuple[int, str]], found: _Rows, mark: str | None
) -> tuple[int, tuple[str, ...], tuple[str, ...], bool]:
    """Line of the titles, titles, units, and whether there seem to be titles that do not fit."""
    nothing = ("",) * found.width
    units, stray = nothing, False
    near, last = _near(above, found, mark)
    for number, line in reversed(near):
        cells = _fitting(line, found, mark)
        if cells is None:
            stray = stray or _names_axes(line)
        elif _are_units(cells):
            units = tuple(cells)
        elif number <= last and _are_titles(cells, found):
            return number, tuple(map(bare, cells)), units, False
    return 0, nothing, units, stray


def _near(
    above: Sequence[tuple[int, str]], found: _Rows, mark: str | None
) -> tuple[list[tuple[int, str]], int]:
    """Lines above in which titles and units may be, and the last that may be the titles.

    A line that names three coordinates is the titles, however many unreadable rows follow. Such a
    line in a comment may be a remark on titles below it.
    """
    near = [(n, line) for n, line in above if line.strip() and not _RULE.fullmatch(line)]
    for k in reversed(range(len(near))):
        number, line = near[k]
        if not is_remark(line, mark) and name_a_place(_fitting(line, found, mark)):
            return near[k : k + 2], number
    return near[-_ABOVE:], found.rows[0][0]


def _are_titles(cells: Sequence[str], found: _Rows) -> bool:
    """Whether cells may be titles: for at least half of the columns, and none is a number.

    If blanks separate them, where any words could be, at least one must be known.
    """
    if any(map(is_number, cells)) or 2 * sum(map(bool, cells)) < found.width:
        return False
    columns = titled(cells)
    return found.delimiter != " " or any(column.role for column in columns) or name_a_place(cells)


def _first(above: Sequence[tuple[int, str]], found: _Rows, header: int, mark: str | None) -> int:
    """Line of the first row, even an unreadable one, which is then reported.

    Below titles any line of as many cells is one; without titles, one that lacks a number only.
    """
    below = [one for one in above if one[0] > header and is_plain(one[1], mark)]
    if header:
        return next((n for n, line in below if _may_be_row(line, found, mark)), found.rows[0][0])
    first = found.rows[0][0]
    for number, line in reversed(above):
        if not (is_plain(line, mark) and _nearly_a_row(_fitting(line, found, mark), found)):
            break
        first = number
    return first


def _may_be_row(line: str, found: _Rows, mark: str | None) -> bool:
    """Whether a line below titles has as many cells as a row, and neither rules nor units."""
    cells = None if _RULE.fullmatch(line) else _fitting(line, found, mark)
    return bool(cells) and not _are_units(cells or [])


def _nearly_a_row(cells: Sequence[str] | None, found: _Rows) -> bool:
    """Whether a line has all but one of a point's numbers, where the first row has numbers."""
    both = zip(cells or (), found.rows[0][1], strict=False)
    return sum(is_number(own) and is_number(below) for own, below in both) >= _LEAST - 1


def _fitting(line: str, found: _Rows, mark: str | None) -> list[str] | None:
    """The cells of a line above the rows, one for each column; None if they do not fit."""
    line = line.strip(" \r\n") if found.delimiter != " " else line.strip()
    for begin in {mark, *MARKS} - {None}:
        line = line.removeprefix(str(begin))
    ways = _ways(line, found)
    fitting = (_padded(cells, found) for cells in ways if cells)
    return next((fits for fits in fitting if fits is not None), None)


def _ways(line: str, found: _Rows) -> list[list[str] | None]:
    """Ways to cut a line above the rows, the likeliest first."""
    ways = [cells_of(line, found.delimiter)]
    gaps = [cell.strip() for cell in WIDE_GAP.split(line.strip())]
    if len(gaps) == len(found.chunks) and sum(found.chunks) == found.width:
        own = [*zip(gaps, found.chunks, strict=True)]
        if not any(_over_several(title, k) for title, k in own):
            ways.insert(0, [cell for title, k in own for cell in _of_chunk(title, k)])
    if found.delimiter == " " or name_a_place(gaps):  # as SpatialAnalyzer writes above commas
        ways.append(gaps)
    return ways


def _over_several(title: str, count: int) -> bool:
    """Whether the title of one coordinate is above several cells, none of which is all of it."""
    words = IN_BRACKETS.sub("", title).split()
    return 1 < count != len(words) and titled([title])[0].role in _ALONE


_ALONE = {*AXES["cartesian"], *AXES["spherical"], *ZEROS}
"""Roles of columns with one number each."""


def _of_chunk(title: str, count: int) -> list[str]:
    """Titles of so many cells: its words, or one of two words, or one above several cells."""
    words = title.split()
    return words if len(words) == count else [title, *[""] * (count - 1)]


def _padded(cells: list[str], found: _Rows) -> list[str] | None:
    """As many cells as there are columns: empty ones at the end are added or removed."""
    while len(cells) > found.width and not cells[-1]:
        cells = cells[:-1]
    if len(cells) < found.width:
        behind = (row[len(cells) :] for _, row in found.rows)
        if not any(map(any, behind)):
            return [*cells, *[""] * (found.width - len(cells))]
    return cells if len(cells) == found.width else None


def _are_units(cells: Sequence[str]) -> bool:
    """Whether all cells are units, empty ones aside."""
    filled = (cell for cell in cells if cell.strip("[]()- "))
    return all(cell.strip("[]() ").lower() in UNIT_WORDS | ANGLE_WORDS for cell in filled)


def _names_axes(line: str) -> bool:
    """Whether a line seems to name three coordinates."""
    words = set(re.findall(r"[^\W\d_]+", line.lower()))
    return {"x", "y", "z"} <= words or len(words & {"hz", "v", "d", "azimuth", "range"}) > 1


def _blocks(text: Text, header: int) -> tuple[int, ...]:
    """Lines with the same titles as the header, including the header itself."""
    if not header:
        return ()
    same = text.line(header).strip().encode()
    if text.data.count(same) == 1:
        return (header,)
    return tuple(n for n, line in text.lines(header) if line.strip().encode() == same)


@dataclass(frozen=True)
class TableStatements:
    """Statements of the lines above a table, which hold for the whole table.

    Attributes:
        kinds: Kinds of coordinates.
        units: Units of length.
        angles: Units of angles.
        senses: Senses in which azimuths increase.
    """

    kinds: frozenset[str]
    units: frozenset[str]
    angles: frozenset[str]
    senses: frozenset[str]

    @classmethod
    def of(cls, found: Sheet) -> TableStatements:
        """Collect words from lines about units or the kind of coordinates, and from no others.

        A reflector's diameter in millimetres says nothing about the coordinates. Only the sense of
        azimuths is taken from any line.
        """
        kinds, units, angles, senses = set(), set(), set(), set()
        for line in found.preamble:
            words = WORD.findall(line.lower())
            senses |= _senses(line.lower())
            here = {KIND_WORDS[word] for word in words if word in KIND_WORDS}
            kinds |= here
            if not here and not UNIT_LINE.search(line):
                continue
            said = said_units(line, of_coordinates=True)
            units |= said & {*UNIT_WORDS.values()}
            angles |= said & {*ANGLE_WORDS.values()}
        return cls(*map(frozenset, (kinds, units, angles, senses)))

    def only(self, what: str) -> str | None:
        """The only statement on something, None if there is none.

        Raises:
            InputError: There are several.
        """
        found = sorted(getattr(self, what))
        if len(found) > 1:
            raise InputError(
                f"the lines above the table name several {what} ({', '.join(found)})",
                "correct them, or describe the table in [tracker.mapping] of campaign.toml",
            )
        return found[0] if found else None


def _senses(line: str) -> set[str]:
    """Sense in which azimuths increase, by the words of a line in small letters.

    Coordinates called spherical or cylindrical count from x towards y, those called polar may not.
    """
    for sense, words in FOREIGN["senses"].items():
        if re.search("|".join(words), line):
            return {sense}
    return {"counter-clockwise"} if {"spherical", "cylindrical"} & {*WORD.findall(line)} else set()
