"""Text of programs: lines, comments and strings, nested lists, entries between commas."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from pipeline.base.errors import InputError
from pipeline.programs.program import NUMBER_PATTERN, Number, number

LARGEST_PROGRAM = 2**26
"""Maximum size of a program [B]; milling programs of 100 000 points have a tenth of it."""

_MARK = "\xef\xbb\xbf"
"""Byte order mark of UTF-8, read as Latin-1: editors put it before the first word of a file, which
may then be copied behind another."""
_PLAIN = re.compile(rf"\s*({NUMBER_PATTERN})\s*")


@dataclass(frozen=True)
class Source:
    """A file of a program.

    Attributes:
        file: Name of the file.
        text: Its characters, one per byte.
        silent: Matches comments and strings, each within a line.
    """

    file: str
    text: str
    silent: re.Pattern[str]

    @cached_property
    def plain(self) -> str:
        """The text with comments and strings blanked; every other character keeps its place.

        Lines end with a line feed, also those that ended with a carriage return alone.
        """
        begun = re.sub(r"\r(?!\n)", "\n", self.text).replace(_MARK, " " * len(_MARK))
        return self.silent.sub(lambda found: " " * len(found[0]), begun)

    @cached_property
    def closing(self) -> dict[int, int]:
        """Place of the closing bracket for each opening one that is closed."""
        pairs, open_ = {}, []
        for found in _BRACKET.finditer(self.plain):
            if found[0] in _OPENING:
                open_.append(found)
            elif open_ and _CLOSING[_OPENING.index(open_[-1][0])] == found[0]:
                pairs[open_.pop().start()] = found.start()
            else:
                open_.clear()
        return pairs

    @cached_property
    def _ends(self) -> list[int]:
        return [found.end() for found in re.finditer(r"\r\n|\r|\n", self.text)]

    def line(self, at: int) -> int:
        """Line of a character, from 1."""
        return bisect_right(self._ends, at) + 1

    @property
    def lines(self) -> Iterator[tuple[int, str]]:
        """Yield where each line begins, and its text without comments and strings."""
        starts = [0, *self._ends]
        for start, end in zip(starts, [*self._ends, len(self.plain)], strict=True):
            yield start, self.plain[start:end].rstrip("\r\n")


def one_byte_characters(file: str, data: bytes) -> str:
    """Decode a program to one character per byte, whatever its encoding.

    All keywords of the languages are ASCII, on which all these encodings agree.

    Raises:
        InputError: It is UTF-16 or not text.
    """
    if b"\0" in data:
        raise InputError("is UTF-16 or no text", "save it as plain text", file=file)
    return data.decode("latin-1")


@dataclass(frozen=True)
class ListItem:
    """Text between two commas.

    Attributes:
        start: Index of its first character that is not blank.
        end: Index behind its last character, blanks included.
        text: The text without the blanks around it.
    """

    start: int
    end: int
    text: str

    @property
    def number(self) -> Number | None:
        """The entry as a number; None if it is not one."""
        found = _PLAIN.fullmatch(self.text)
        return None if found is None else number(self.start, found[1])


_OPENING, _CLOSING = "([{", ")]}"
_SIGN = re.compile(r"[\[\](){},]")
_BRACKET = re.compile(r"[\[\](){}]")


def entries(plain: str, start: int, end: int) -> list[ListItem]:
    """Split a stretch of text at its commas, except those within brackets."""
    commas, depth = [], 0
    for found in _SIGN.finditer(plain, start, end):
        depth += (found[0] in _OPENING) - (found[0] in _CLOSING)
        if found[0] == "," and depth == 0:
            commas.append(found.start())
    out = []
    for first, last in pairwise([start - 1, *commas, end]):
        text = plain[first + 1 : last]
        out.append(ListItem(last - len(text.lstrip()), last, text.strip()))
    return out


def inner(source: Source, entry: ListItem, opening: str = "[") -> list[ListItem] | None:
    """Entries of a list; None if the entry is not a list."""
    if not entry.text.startswith(opening):
        return None
    last = source.closing.get(entry.start)
    if last is None or last != entry.start + len(entry.text) - 1:
        return None
    return entries(source.plain, entry.start + len(opening), last)


def numbers(found: Sequence[ListItem] | None) -> tuple[Number, ...] | None:
    """All entries as numbers; None if one of them is not a number."""
    if found is None:
        return None
    read = [entry.number for entry in found]
    return None if None in read else tuple(number for number in read if number is not None)
