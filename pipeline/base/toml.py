"""TOML text to records and back; one record over another.

Written by hand, because people read and edit these files: the library for it, tomli-w, gives every
number of a list a line of its own, five lines for a point of the tool.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.base.errors import InputError
from pipeline.base.files import too_large
from pipeline.base.shown import in_toml

LARGEST = 2**20
"""Bytes of a file that people write; a plan with a thousand poses has a tenth of it."""
_LARGEST_NUMBER = 2**63
"""Whole numbers of TOML have 64 bits."""
_SMALLER = "keep the data in the other files"
_MOST_PARTS = 20
"""Parts of a dotted key; tomllib takes the square of them in time."""
_STRINGS = re.compile(
    r""""{3}(?:\\.|[^\\])*?(?:"{3}|\Z)|'{3}.*?(?:'{3}|\Z)"""
    r"""|"(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*""",
    re.DOTALL,
)
"""Strings and comments, also unfinished ones, each of them in one go."""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")


_AT_LINE = re.compile(r"\(at line (\d+),")
"""How `tomllib` says where it stopped; at the end of the text it says otherwise."""
_DECIMAL_COMMA = re.compile(r"=\s*\[?\s*[-+]?\d+,\d")
"""A number as much of Europe writes it, where a value begins."""


def loads(text: str, file: str, most: int = LARGEST) -> dict[str, Any]:
    """The record in a TOML text, in a time that grows with the text only.

    Args:
        text: The TOML.
        file: Its name, for messages.
        most: Letters at most.

    Raises:
        InputError: Not TOML, or more than a file for people has; names the place.
    """
    if len(text) > most:
        raise InputError(too_large(len(text), most), _SMALLER, file=file)
    if found := _LONG_KEY.search(_STRINGS.sub(lambda one: "s" + "\n" * one[0].count("\n"), text)):
        line = found.string.count("\n", 0, found.start()) + 1
        thing = f"a key has more than {_MOST_PARTS} parts"
        raise InputError(thing, "write it as a table", file=file, line=line)
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        why = "nested too deeply" if isinstance(problem, RecursionError) else problem
        raise _invalid(text, f"not valid TOML ({why})", file) from problem
    _numbers_of_64_bits(content, file)
    return content


def _invalid(text: str, thing: str, file: str) -> InputError:
    """What is said of a text that is no TOML, with the line where the reader stopped."""
    at = _AT_LINE.search(thing)
    line = int(at[1]) if at else None
    return InputError(thing, remedy(text, line, "correct that place"), file=file, line=line)


def remedy(text: str, line: int | None, usual: str) -> str:
    """What to do about a line: a point for a comma that makes two numbers of one, or as usual."""
    there = text.splitlines()[line - 1 : line] if line else []
    commas = any(_DECIMAL_COMMA.search(one) for one in there)
    return "write numbers with a decimal point" if commas else usual


def _numbers_of_64_bits(content: Mapping[str, Any], file: str) -> None:
    left: list[Any] = [content]
    while left:
        value = left.pop()
        if isinstance(value, Mapping):
            left += value.values()
        elif isinstance(value, list):
            left += value
        elif isinstance(value, int) and not -_LARGEST_NUMBER <= value < _LARGEST_NUMBER:
            thing = "a whole number has more than 64 bits"
            raise InputError(thing, "correct it, or write it with a point", file=file)


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """A record with the entries of another; tables in both are merged, not replaced."""
    out = dict(old)
    for key, value in new.items():
        both = isinstance(value, Mapping) and isinstance(out.get(key), Mapping)
        out[key] = merged(out[key], value) if both else value
    return out


def given(changes: Mapping[str, Any]) -> dict[str, Any]:
    """What was said of some changes: no entry that is None, no table without entries."""
    inner = {k: given(v) if isinstance(v, Mapping) else v for k, v in changes.items()}
    return {key: value for key, value in inner.items() if value is not None and value != {}}


def dumps(content: Mapping[str, Any]) -> str:
    """TOML of a record with tables, and lists of tables, one level deep; deeper ones are inline."""
    top = [f"{_key(k)} = {_value(v)}" for k, v in content.items() if not _tables(v)]
    return "\n".join([*top, *(_table(k, v) for k, v in content.items() if _tables(v)), ""])


def _tables(value: Any) -> bool:
    several = isinstance(value, list) and value and isinstance(value[0], Mapping)
    return isinstance(value, Mapping) or bool(several)


def _table(name: str, value: Any) -> str:
    if isinstance(value, list):
        return "\n".join(_lines(f"[[{_key(name)}]]", one) for one in value)
    return _lines(f"[{_key(name)}]", value)


def _lines(head: str, table: Mapping[str, Any]) -> str:
    return "\n".join(["", head, *(f"{_key(k)} = {_value(v)}" for k, v in table.items())])


def _key(name: str) -> str:
    plain = name.replace("_", "").replace("-", "").isalnum() and name.isascii()
    return name if plain else quoted(name)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return _list(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # inf, -inf and nan are words of TOML
    return quoted(value) if isinstance(value, str) else json.dumps(value)


def _list(values: Sequence[Any]) -> str:
    """Plain values on one line, rows of a matrix on one line each."""
    inner = [_value(value) for value in values]
    if values and isinstance(values[0], list | tuple | Mapping):
        return "[\n    " + ",\n    ".join(inner) + ",\n]"
    return f"[{', '.join(inner)}]"


def quoted(text: str) -> str:
    """A basic string of TOML."""
    return in_toml(text)
