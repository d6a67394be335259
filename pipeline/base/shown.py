"""Display and storage of foreign text: it must not control a terminal or break a file.

`printable` is for people, `in_json` and `in_toml` are for files. Our own sentences put
what to type between backticks; `runs` and `quoted` show it without them.
"""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import sys
from collections.abc import Iterator
from typing import TextIO

_ODD = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u180e\u200b-\u200f\u2028-\u202e"
    "\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb\ufffe\uffff\U000e0000-\U000e0fff]"
)
"""Control and format characters, line ends, lone surrogates, and noncharacters."""
_HALF = re.compile("[\ud800-\udfff]")
_IN_STRINGS = re.compile(f"(?!\n){_ODD.pattern}")
"""The same without line feeds, which JSON escapes itself and uses for its layout."""


def printable(text: str, most: int | None = None) -> str:
    r"""One printable line: \x1b for an escape, with the middle left out if it is long."""
    if most is not None and len(text) > 2 * most:  # what is left out need not be escaped
        text = text[:most] + text[-most:]
    plain = _ODD.sub(_named, text)
    if most is None or len(plain) <= most:
        return plain
    end = most // 3
    return f"{plain[: most - end - 3]} … {plain[-end:]}"


def _named(found: re.Match[str]) -> str:
    code = ord(found[0])
    if 0xDC80 <= code <= 0xDCFF:  # the byte itself
        code -= 0xDC00
    if code < 0x100:
        return _SHORT.get(found[0], f"\\x{code:02x}")
    return f"\\u{code:04x}" if code < 2**16 else f"\\U{code:08x}"


_SHORT = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def is_printable(text: str) -> bool:
    """Whether it can be shown unchanged."""
    return _ODD.search(text) is None


_WORD = r"[ \n](?:(?:--)?\w[\w.,/=%-]*|'[^'`\n]*')"
_TYPED = re.compile(
    rf"`(pipeline(?:{_WORD})*|dask scheduler|dask worker tcp://[\w.:-]+ --nthreads 1"
    r"|xacro FILE\.xacro > FILE\.urdf)`"
)
"""Commands to type. Text of other origin between backticks never passes as ours: no other program,
no shell character and no address, to which `--on` would send the work."""


def runs(text: str) -> Iterator[tuple[str, bool]]:
    """Pieces of the text, each with whether it is a command to be typed."""
    for place, piece in enumerate(_TYPED.split(text)):
        if piece:
            yield piece, bool(place % 2)


def typed(name: str) -> str:
    """Name as an argument of a command, quoted if the shell requires it."""
    return shlex.quote(name)


def quoted(text: str) -> str:
    """Text for a terminal: commands are in single quotes, unless they contain some."""
    return "".join(
        f"'{piece}'" if code and "'" not in piece else piece for piece, code in runs(text)
    )


def lines(text: str) -> str:
    """Several lines of our own, which may contain a foreign name."""
    return "\n".join(printable(line) for line in text.split("\n"))


def in_json(content: object, indent: int | None = None) -> str:
    r"""Dump as JSON, with unprintable characters and surrogates as \uXXXX; never NaN."""
    dumped = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    return _IN_STRINGS.sub(lambda found: json.dumps(found[0])[1:-1], dumped)


def in_toml(text: str) -> str:
    """A basic string of TOML, which does not allow surrogates."""
    written = json.dumps(_HALF.sub("\ufffd", text), ensure_ascii=False)
    return _IN_STRINGS.sub(lambda found: f"\\U{ord(found[0]):08x}", written)


def say(line: str, screen: TextIO | None = None) -> None:
    """Write one line to stdout or `screen`; errors, as of a full disk, are ignored."""
    screen = screen or sys.stdout
    with contextlib.suppress(OSError):
        screen.write(f"{lines(line)}\n")
        screen.flush()


def too_large(size: int, most: int) -> str:
    """Description of a file with too many bytes."""
    unit, one = ("GB", 1e9) if most >= 1e9 else ("MiB", 2**20)
    return f"has {size / one:.1f} {unit}, more than the {most / one:g} {unit} that are read"
