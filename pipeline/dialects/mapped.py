"""Read any other delimited table, whose columns [tracker.mapping] of campaign.toml describes."""

from __future__ import annotations

from pipeline.base.errors import InputError, at, listed
from pipeline.dialects import _named, _tables
from pipeline.dialects._cells import bare, delimiter_of, is_plain
from pipeline.dialects._named import Header, Named
from pipeline.dialects._titles import titled
from pipeline.dialects.two_lines import parted
from pipeline.readers._reader import Export
from pipeline.readers._text import Text, squeezed
from pipeline.readers.export_settings import Columns, ExportSettings

_NAME = "table by [tracker.mapping]"
_ROLES = {
    **{f"s{axis}": f"std {axis}" for axis in "xyz"},
    **{f"u95_{axis}": f"u95 {axis}" for axis in "xyz"},
}
"""Role of a column by its name in [tracker.mapping.columns], if different."""


def read(text: Text, hints: ExportSettings, dialect: str = _NAME) -> Export:
    """Read a table whose columns campaign.toml describes.

    Raises:
        InputError: A column does not exist.
    """
    assert hints.mapping is not None
    mapping = hints.mapping
    if mapping.last is not None:
        text = until(text, mapping.last)
    if mapping.delimiter == " ":
        text = squeezed(text)
    header = _header(text, mapping)
    return _tables.read(text, hints, header, dialect, mapping.comment, mapping.time_format)


def _header(text: Text, mapping: Columns) -> Header:
    line = _header_line(text, mapping)
    sample = text.line(line or _first(text, mapping))
    delimiter = mapping.delimiter or delimiter_of(sample)
    titles = [bare(title) for title in sample.split(delimiter)]
    words = _words(titles, mapping, line)
    named = []
    for place, title in enumerate(titles):
        word = words.get(place, "")
        unit = _named.named(title).unit if line else None
        title = title if line else f"column {place + 1}"
        named.append(Named(title, _ROLES.get(word, word), unit))
    first = _first(text, mapping)
    return Header(line or first - 1, delimiter, tuple(named), mapping.first or 0)


def unread_times(text: Text, mapping: Columns) -> list[str]:
    """Titles of columns with dates or times that a mapping leaves out."""
    line = _header_line(text, mapping)
    if {"date", "time"} & {*mapping.columns} or not line:
        return []
    header = text.line(line)
    titles = [bare(one) for one in header.split(mapping.delimiter or delimiter_of(header))]
    return [one.title for one in titled(titles) if one.role in ("date", "time", "clock")]


def _words(titles: list[str], mapping: Columns, line: int) -> dict[int, str]:
    """Name that the mapping gives to each column, by index."""
    words: dict[int, str] = {}
    for word, column in mapping.columns.items():
        with at(line=line or None):
            place = _place(word, column, titles)
        if place in words:
            raise InputError(
                f"columns.{word} and columns.{words[place]} are the same column",
                "correct one of them in [tracker.mapping.columns]",
                file="campaign.toml",
            )
        words[place] = word
    return words


def _first(text: Text, mapping: Columns) -> int:
    """Line number of the first row, as stated or the first that is no blank or comment."""
    if mapping.first is not None:
        return _there(mapping.first, text, "first row")
    return next((n for n, line in text.lines() if is_plain(line, mapping.comment)), 1)


def _header_line(text: Text, mapping: Columns) -> int:
    """Line number of the header, 0 for none: as stated, else the first row if columns are named."""
    if mapping.header is not None:
        return _there(mapping.header, text, "header")
    by_name = any(isinstance(column, str) for column in mapping.columns.values())
    return _first(text, mapping) if by_name else 0


def _there(line: int, text: Text, what: str) -> int:
    """Check that a line number exists in the file.

    Raises:
        InputError: The file is shorter.
    """
    if line > len(text):
        raise InputError(
            f"the file has no line {line} for its {what}",
            "correct [tracker.mapping] of campaign.toml",
        )
    return line


def _place(word: str, column: str | int, titles: list[str]) -> int:
    if isinstance(column, int):
        if column > len(titles):
            raise InputError(
                f"there is no column {column} for {word}, only {len(titles)}",
                "correct [tracker.mapping.columns] of campaign.toml",
            )
        return column - 1
    said, whole = column.strip().lower(), [title.lower() for title in titles]
    stems = [parted(title)[0].strip() for title in whole]  # without the unit in brackets
    fitting = [k for k, title in enumerate(whole if said in whole else stems) if title == said]
    if len(fitting) != 1:
        many = "is no column" if not fitting else f"are {len(fitting)} columns"
        raise InputError(
            f'there {many} "{column}" for {word} among {listed(titles)}',
            "correct [tracker.mapping.columns] of campaign.toml, numbers from 1 work too",
        )
    return fitting[0]


def until(text: Text, last: int) -> Text:
    """The text up to and including a line."""
    starts = text.starts[: last + 1]
    return Text(text.name, text.data[: starts[-1]], text.encoding, starts)
