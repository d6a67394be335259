"""TOML text to records and back; one record over another.

Written by hand, because people read and edit these files: the library for it, tomli-w, gives every
number of a list a line of its own, five lines for a point of the tool.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.base.errors import InputError


def loads(text: str, file: str) -> dict[str, Any]:
    """The record in a TOML text.

    Raises:
        InputError: Not TOML; names the place.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise InputError(
            f"not valid TOML ({problem})", "correct that place", file=file
        ) from problem


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
    return name if plain else json.dumps(name)


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
    """A basic string of TOML, which escapes what JSON escapes."""
    return json.dumps(text, ensure_ascii=False)
