"""Find the header of a log that is no plain table, and map the names of its columns to ours."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from unicodedata import normalize

from pipeline.base.errors import InputError, at, listed
from pipeline.dialects import recorded, taught, two_lines
from pipeline.dialects._cells import (
    MARKS,
    above,
    bare,
    delimiter_of,
    is_number,
    is_plain,
    is_remark,
)
from pipeline.dialects.two_lines import ALIKE, BELOW, UNITS, parted, with_unit
from pipeline.readers._log_table import Titled
from pipeline.readers._text import (
    SAMPLE_LINES,
    Text,
    is_workbook,
    refuse_other_programs,
    squeezed,
    text,
)
from pipeline.readers._text import opened as opened_text
from pipeline.readers.export_settings import LogForm

_WITH_UNIT = re.compile(r"(.*[0-9.,])\s*([^\W\d_]+|°)")
_NO_UNIT = re.compile(
    r"(nr|no|num|number|nummer|#|1|text|[hmsdty: .]+|[a-z]{2,4}[-./][a-z]{2,4}[-./][a-z]{2,4})[.]?"
)
"""Entries of such a line for columns without a unit: a number, a text, or a time format."""
_OF_COUNTS = ("", "1", "-", "–", "—", "#")
"""Units in the title of a column that has none."""
_COMPLETE = re.compile(
    rf".+_(?:{'|'.join(sorted(UNITS))}|kg|kp|c|pulses|si)"
    r"|(?:pose|repeat|pose_repeat|payload|branch|anchor|group|approach|target|series|time|remark)"
    r"(?:_[0-9]+)?"
)
"""Our names of columns, which say their unit or have none, whatever is behind a number below."""


def opened(
    name: str,
    data: bytes,
    stated: LogForm,
    table: str | None,
    key: str,
    holds: Callable[[Sequence[str]], bool] = bool,
) -> Titled:
    """Find the header of a log.

    It is the first line with all titles that campaign.toml states, else the first that names the
    column `key`; if there is none, the first line that is neither blank nor a comment.

    Args:
        name: Name of the file, for messages.
        data: Its content.
        stated: Description of its columns in campaign.toml.
        table: Table of campaign.toml that holds it; None if there is none.
        key: A column that every log of this kind has.
        holds: Whether our names of all columns are those of this kind, to select a sheet.

    Raises:
        InputError: The file is empty or not text; a title in campaign.toml is not in the file, or a
            column occurs twice.
    """
    with at(name):
        refuse_other_programs(name, data)
        own = {title.lower(): ours.lower() for title, ours in stated.columns.items()}
        sheet, mark = stated.sheet, stated.decimal

        def fits(one: Text) -> int:
            found = _found(one, own, key)
            return 0 if found is None else 1 + holds(_ours(found.titles, own))

        file = as_text(name, data, sheet, mark, table, fits)
        head = _found(file, own, key) or _no_remark(file)
        with at(line=head.line):
            ours = tuple(_ours(head.titles, own))
            _agree(head.titles, stated.columns, table)
            _unique(ours)
        file = squeezed(file) if head.delimiter == " " else file
        early = above(file, head.line, head.delimiter, [ours.index(key)]) if key in ours else ()
        units = head.written, head.behind, tuple(early)
        return Titled(file, head.line, head.first, head.delimiter, ours, *units)


def as_text(
    name: str,
    data: bytes,
    sheet: str | None,
    mark: str | None,
    table: str | None,
    fits: Callable[[Text], int],
) -> Text:
    """Open a log as a table; point lists and recordings of a controller are converted to one."""
    made = None if is_workbook(data) else taught.table(data) or recorded.table(data)
    return text(name, made) if made else opened_text(name, data, sheet, mark, table, fits)


@dataclass(frozen=True)
class LogHeader:
    """A line interpreted as a header.

    Attributes:
        line: Line number.
        first: Line number of the first row, after the line of units if there is one.
        delimiter: Separator of its cells.
        written: Its titles as written, each with the unit given below it.
        behind: Unit after the numbers of each column; empty if there is none.
    """

    line: int
    first: int
    delimiter: str
    written: tuple[str, ...]
    behind: tuple[str, ...]

    @property
    def titles(self) -> list[str]:
        """The titles in lower case."""
        return [title.lower() for title in self.written]


def _found(file: Text, own: Mapping[str, str], key: str) -> LogHeader | None:
    """The first line with all stated titles, else the first that names the column `key`."""
    some = [one for one in headers(file) if {*own.values(), key} & {*_ours(one.titles, own)}]
    stated = (one for one in some if {*own.values()} <= {*_ours(one.titles, own)} and own)
    return next(stated, next((one for one in some if key in _ours(one.titles, own)), None))


def _no_remark(file: Text) -> LogHeader:
    """The first line that is neither blank nor a comment; if there is none, the first not blank."""
    plain = (n for n, line in file.lines(1, SAMPLE_LINES) if is_plain(line, MARKS))
    n = next(plain, file.first()[0])
    return _header(n, file.line(n), file.line(n + 1) if n < len(file) else None)


def headers(file: Text) -> Iterator[LogHeader]:
    """The leading lines as headers, without rows of numbers."""
    yield from _headers(tuple(line for _, line in file.lines(1, SAMPLE_LINES + 1)))


@lru_cache(maxsize=32)
def _headers(lines: tuple[str, ...]) -> tuple[LogHeader, ...]:
    """Those of a file that begins so: `intake` opens it for every robot."""
    found = map(_header, count(1), lines[:SAMPLE_LINES], (*lines[1:], None))
    return tuple(one for one in found if not _of_numbers(one.written))


def _of_numbers(cells: Sequence[str]) -> bool:
    """Whether cells are those of a row: one has decimals, or more than half are numbers."""
    numbers = [cell for cell in cells if is_number(cell)]
    return 2 * len(numbers) > len([*filter(None, cells)]) or any(
        not cell.strip("+-").isdecimal() for cell in numbers
    )


def _header(line: int, content: str, next_line: str | None) -> LogHeader:
    """A line as a header."""
    delimiter = delimiter_of(content, " ")
    titles, below = _with_below(content, next_line, delimiter)
    none = ("",) * len(titles)
    titles, lines = two_lines.titles(titles, below)
    if lines > 1:
        return LogHeader(line, line + lines, delimiter, tuple(titles), none)
    units = tuple(map(_unit_below, below))
    of_units = any(units) and {unit.lower() for unit in units} <= BELOW
    behind = none if of_units else tuple(map(_unit_behind, titles, below))
    joined = map(with_unit, titles, units if of_units else behind)
    return LogHeader(line, line + (2 if of_units else 1), delimiter, tuple(joined), behind)


def _with_below(content: str, next_line: str | None, delimiter: str) -> tuple[list[str], list[str]]:
    """The cells of a line, with no mark of a comment before them if it is none, and those below it.

    Those are empty if they are not as many.
    """
    titles = _cut(content, delimiter)
    below = _cut(next_line, delimiter) if next_line is not None else []
    unmarked = _cut(_marked(content), delimiter) if is_remark(content, MARKS) else titles
    titles = unmarked if len(unmarked) == len(below) else titles
    return titles, below if len(below) == len(titles) else [""] * len(titles)


def _marked(line: str) -> str:
    """A line without the mark of a comment before it; unchanged if its first cell is the mark."""
    return re.sub(r"^\s*(?:%|#|!|//)+[ \t]*(?=[^\W\d_])", "", line)


def _unit_behind(title: str, cell: str) -> str:
    """The unit after the number in a cell; empty if there is none, or the title needs none."""
    if _COMPLETE.fullmatch(title.lower()):
        return ""
    found = _WITH_UNIT.fullmatch(cell.strip())
    known = found and is_number(found[1]) and found[2].lower() in BELOW
    return found[2] if found and known else ""


def _unit_below(cell: str) -> str:
    """The unit stated by a cell of a line of units; empty if it says what the numbers count."""
    unit = cell.strip("[](){}<>-–—/ ")
    return "" if _NO_UNIT.fullmatch(unit.lower()) else unit


def _cut(line: str, delimiter: str) -> list[str]:
    """The cells of a line above the data rows, as written."""
    cells = line.split() if delimiter == " " else line.split(delimiter)
    return [bare(cell) for cell in cells]


def _ours(titles: Sequence[str], stated: Mapping[str, str]) -> list[str]:
    """Our names of the columns; `Force [N]` is `force_n` unless campaign.toml says otherwise.

    What it says of `Force` also applies to `Force [N]`.
    """
    small = [title.lower() for title in titles]
    return [
        stated.get(title) or stated.get(parted(title)[0]) or _suffixed(title) for title in small
    ]


def _suffixed(title: str) -> str:
    stem, unit = parted(title)
    end = f"_{unit.replace('°', 'deg')}" if unit not in _OF_COUNTS else ""
    return stem.removesuffix(end) + end


def _agree(titles: Sequence[str], said: Mapping[str, str], table: str | None) -> None:
    """Check that every title in campaign.toml exists and agrees with the unit in its brackets.

    Raises:
        InputError: It does not; a title written out with its unit is trusted.
    """
    known = {stem: (title, unit) for title in titles for stem, unit in [parted(title)]}
    for title, ours in said.items():
        if title.lower() in titles:
            continue
        if title.lower() not in known:
            raise InputError(
                f'there is no column "{title}" among {listed(titles)}',
                f"correct [{table}.columns] of campaign.toml",
            )
        whole, unit = known[title.lower()]
        stated, named = (ALIKE.get(one, one) for one in (unit, ours.lower().rpartition("_")[2]))
        if stated in UNITS and named != stated:
            raise InputError(
                f'[{table}.columns] calls "{title}" {ours}, and the title says [{unit}]',
                f'correct it, or write "{whole}" = "{ours}" where the title is wrong',
            )


def _unique(titles: Sequence[str]) -> None:
    """Check that no two columns have the same name, as far as it can be seen.

    Raises:
        InputError: Two have.
    """
    seen = ["".join(filter(str.isprintable, normalize("NFKC", title))) for title in titles]
    twice = sorted({t for t, one in zip(titles, seen, strict=True) if one and seen.count(one) > 1})
    if twice:
        raise InputError(f"there are two columns {listed(twice)}", "remove or rename one")
