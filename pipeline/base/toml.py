"""Reading and writing of TOML, and merging of records.

Written by hand, because people read and edit these files: the library tomli-w puts every number of
a list on a line of its own, five lines for a point of the tool.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from pipeline.base.errors import InputError
from pipeline.base.shown import in_toml, too_large

LARGEST_TEXT = 2**20
"""Maximum number of characters of a file written by people; a plan with a thousand poses has a
tenth of it."""
_LARGEST_NUMBER = 2**63
"""Bound of whole numbers in TOML, which have 64 bits."""
_SMALLER = "keep the data in the other files"
_MOST_PARTS = 20
"""Maximum number of parts of a dotted key, as tomllib takes quadratic time."""
_STRINGS = re.compile(
    r""""{3}(?:\\.|[^\\])*?(?:"{3}|\Z)|'{3}.*?(?:'{3}|\Z)"""
    r"""|"(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*""",
    re.DOTALL,
)
"""Strings and comments, also unterminated ones, each in one match."""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")


_AT_LINE = re.compile(r"\(at line (\d+),")
"""Position in messages of `tomllib`; at the end of the text there is none."""
_DECIMAL_COMMA = re.compile(r"=\s*\[?\s*[-+]?\d+,\d[^.]*$")
"""A number with a decimal comma at the beginning of a value that has no decimal point."""


def loads(text: str, file: str, most: int = LARGEST_TEXT) -> dict[str, Any]:
    """Parse a TOML text, in time linear in its length.

    Args:
        text: The TOML.
        file: Its name, for messages.
        most: Maximum number of characters.

    Raises:
        InputError: Not TOML, or larger than a file for people; names the place.
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
        own = {RecursionError: "nested too deeply", ValueError: "a number of thousands of digits"}
        why = own.get(type(problem), problem)
        raise _invalid(text, f"not valid TOML ({why})", file) from problem
    _numbers_of_64_bits(content, text, file)
    return content


def _invalid(text: str, thing: str, file: str) -> InputError:
    """Error for a text that is not TOML, with the line where the parser stopped."""
    at = _AT_LINE.search(thing)
    line = int(at[1]) if at else None
    return InputError(thing, remedy(text, line, "correct that place"), file=file, line=line)


def remedy(text: str, line: int | None, usual: str) -> str:
    """How to correct a line: a decimal point for a decimal comma, or the usual way."""
    there = text.splitlines()[line - 1 : line] if line else []
    commas = any(_DECIMAL_COMMA.search(one) for one in there)
    return "write numbers with a decimal point" if commas else usual


def _numbers_of_64_bits(content: Mapping[str, Any], text: str, file: str) -> None:
    left: list[Any] = [([], content)]
    while left:
        path, value = left.pop()
        if isinstance(value, Mapping | list):
            inner = value.items() if isinstance(value, Mapping) else enumerate(value)
            left += (([*path, key], one) for key, one in inner)
        elif isinstance(value, int) and not -_LARGEST_NUMBER <= value < _LARGEST_NUMBER:
            thing, line = "a whole number has more than 64 bits", line_of(text, path)
            raise InputError(thing, "correct it, or write it with a point", file=file, line=line)


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """A record updated with another; tables in both are merged, not replaced."""
    out = dict(old)
    for key, value in new.items():
        both = isinstance(value, Mapping) and isinstance(out.get(key), Mapping)
        out[key] = merged(out[key], value) if both else value
    return out


def given(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Changes without entries that are None and without empty tables."""
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
        return str(value)  # inf, -inf and nan are valid TOML
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


_PART = re.compile(r""""((?:\\.|[^"\\])*)"|'([^']*)'|([\w-]+)""")
"""One part of a key, bare or quoted."""
_KEYS = r"""((?:[\w-]++|"[^"]*"|'[^']*')(?:[ \t]*\.[ \t]*(?:[\w-]++|"[^"]*"|'[^']*'))*)"""
_HEADER = re.compile(rf"\s*(\[{{1,2}})\s*{_KEYS}\s*\]")
_ENTRY = re.compile(rf"\s*{_KEYS}\s*=")


def line_of(text: str, path: Sequence[str | int]) -> int | None:
    """Line of an entry, or of the innermost enclosing table that is written out.

    Args:
        text: Valid TOML.
        path: Keys from the outermost inwards; numbers from 0 count the tables of a `[[list]]`.
    """
    best, line = 0, None
    for number, found, value in _entries(text):
        if found[-1:] == [0] and list(path) == found[:-1]:
            found = found[:-1]  # a list of tables where one table should be
        if list(path[: len(found)]) != found:
            continue
        depth = len(found) + _within(value, path[len(found) :])
        if depth > best:
            best, line = depth, number
    return line


@contextmanager
def placed(file: str, text: str) -> Iterator[None]:
    """Add file and line to errors about an entry of a TOML file, unless they name another file."""
    try:
        yield
    except InputError as wrong:
        line = line_of(text, wrong.key) if wrong.line is None and wrong.key else wrong.line
        if wrong.file not in (None, file) or (wrong.file, wrong.line) == (file, line):
            raise
        raise InputError(**wrong.parts | {"file": file, "line": line}) from wrong


def _entries(text: str) -> Iterator[tuple[int, list[str | int], str]]:
    """Every header and key: its line, its full path, and the rest of its line."""
    counts: dict[tuple[str | int, ...], int] = {}
    table: list[str | int] = []
    within: list[str | int] = []
    depth = 0
    for number, line in enumerate(_STRINGS.sub(_blank, text).split("\n"), 1):
        if depth <= 0 and (header := _HEADER.match(line)):
            table = within = _counted(_parts(header[2]), counts, several=len(header[1]) == 2)
            yield number, table, ""
            continue
        entry = _ENTRY.match(line) if depth <= 0 else None
        if entry:
            within = [*table, *_parts(entry[1])]
        value = line[entry.end() :] if entry else line
        bare = _STRINGS.sub("", value)
        depth += sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))
        yield number, within, value


def _blank(found: re.Match[str]) -> str:
    """A one-line string unchanged; of other strings and comments only the line ends."""
    return "\n" * found[0].count("\n") if found[0].startswith(('"""', "'''", "#")) else found[0]


def _parts(key: str) -> list[str]:
    return [one[1] or one[2] or one[3] or "" for one in _PART.finditer(key)]


def _counted(
    parts: Sequence[str], counts: dict[tuple[str | int, ...], int], several: bool
) -> list[str | int]:
    """Path of a header, including the index of tables in a list."""
    path: list[str | int] = []
    for k, part in enumerate(parts, 1):
        path.append(part)
        here = tuple(path)
        if several and k == len(parts):
            counts[here] = counts.get(here, -1) + 1
        if here in counts:
            path.append(counts[here])
    return path


def _within(value: str, path: Sequence[str | int]) -> int:
    """Number of keys of a path that are found in an inline table, from the first on."""
    at = 0
    for count, part in enumerate(path):
        if isinstance(part, int):
            continue
        found = re.compile(rf"""(?<![\w-])["\']?{re.escape(part)}["\']?\s*=""").search(value, at)
        if found is None:
            return count
        at = found.end()
    return len(path)
