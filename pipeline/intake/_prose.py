"""Whether a text is prose: a letter, a data sheet, a note with a few numbers in it."""

from __future__ import annotations

import re
from functools import lru_cache

from pipeline.base.doors import found
from pipeline.base.errors import InputError
from pipeline.dialects._cells import MARKS, is_number, is_plain
from pipeline.readers._text import is_workbook, text

PROSE = "it is text for people, not a table; what it says of the campaign is to be typed in"
"""Why prose is not used."""
_LETTERS = 16
"""Minimum number of letters in a line of prose [1]; titles have cells, rows have numbers."""
_LEAST = 4
"""Minimum number of such lines [1]: a table may have some remarks above its rows."""
_LOOKED_AT = 400
"""Number of lines that show it [1]."""


@lru_cache(maxsize=64)
def is_prose(name: str, data: bytes) -> bool:
    """Whether a third of the lines are of words, and more than are rows of numbers.

    A robot program is none, whatever its remarks.
    """
    of_controller = found("pipeline.dialects:of_controller")
    if name.endswith(".toml") or is_workbook(data) or (of_controller and of_controller(data)):
        return False
    try:
        lines = [line for _, line in text(name, data).lines(1, _LOOKED_AT) if is_plain(line, MARKS)]
    except InputError:
        return False
    kinds = [_kind(line) for line in lines]
    words = kinds.count("words")
    return words >= _LEAST and words > kinds.count("numbers") and 3 * words > len(kinds)


def _kind(line: str) -> str:
    """`words`, `numbers` or neither, of a line."""
    cells = re.findall(r"[^\s;,|]+", line)
    numbers = sum(map(is_number, cells))
    if numbers > 1 and 2 * numbers >= len(cells):
        return "numbers"
    letters, digits = (sum(map(kind, line)) for kind in (str.isalpha, str.isdigit))
    row = not cells or is_number(cells[0]) or re.search(r"[;\t|<>{}]", line)
    words = letters >= _LETTERS and letters > 2 * digits and 3 * numbers <= len(cells)
    return "words" if words and not row else ""
