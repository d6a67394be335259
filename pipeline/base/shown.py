"""Text of others as we show it and write it: nothing in it may steer a terminal or break a file.

One way each: `printable` for what people read, `in_json`, `in_toml` and `in_xml` for files.
Sentences of ours put what to type between backticks; `runs` and `quoted` show it without them.
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
"""Control and format characters, line ends, halves of characters, and what is none."""
_HALF = re.compile("[\ud800-\udfff]")
_IN_STRINGS = re.compile(f"(?!\n){_ODD.pattern}")
"""All that is odd but line ends, which JSON escapes by itself and is laid out with."""
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def printable(text: str, most: int | None = None) -> str:
    r"""One line that says what stands there: \x1b for an escape, the middle left out if long."""
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
    """Whether it can be shown as it is."""
    return _ODD.search(text) is None


_WORD = r"[ \n](?:(?:--)?\w[\w.,/=%-]*|'[^'`\n]*')"
_TYPED = re.compile(
    rf"`(pipeline(?:{_WORD})*|dask scheduler|dask worker tcp://[\w.:-]+ --nthreads 1"
    r"|xacro FILE\.xacro > FILE\.urdf)`"
)
"""What to type. Whatever stands between somebody else's backticks, nothing else passes for ours:
no other program, no sign of a shell and no address, where `--on` would send the work."""


def runs(text: str) -> Iterator[tuple[str, bool]]:
    """The text in pieces, and of each whether it is to be typed as it stands."""
    for place, piece in enumerate(_TYPED.split(text)):
        if piece:
            yield piece, bool(place % 2)


def typed(name: str) -> str:
    """A name as it is typed behind a command: in quotes where a shell would do more with it."""
    return shlex.quote(name)


def quoted(text: str) -> str:
    """The text for a terminal: what to type stands in single quotes, or has some of its own."""
    return "".join(
        f"'{piece}'" if told and "'" not in piece else piece for piece, told in runs(text)
    )


def lines(text: str) -> str:
    """Several lines of ours, in which a name may be somebody else's."""
    return "\n".join(printable(line) for line in text.split("\n"))


def in_json(content: object, indent: int | None = None) -> str:
    r"""Dumped as JSON, with everything odd as \uXXXX, halves of characters too; never NaN."""
    dumped = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    return _IN_STRINGS.sub(lambda found: json.dumps(found[0])[1:-1], dumped)


def in_toml(text: str) -> str:
    """A basic string of TOML, which knows no halves of characters."""
    written = json.dumps(_HALF.sub("\ufffd", text), ensure_ascii=False)
    return _IN_STRINGS.sub(lambda found: f"\\U{ord(found[0]):08x}", written)


def in_xml(text: str) -> str:
    """Text for an element, an attribute or a comment of XML."""
    return _NOT_XML.sub("\ufffd", text)


def say(line: str, screen: TextIO | None = None) -> None:
    """One line on stdout or `screen`; a log on a full disk misses some, and that stops nothing."""
    screen = screen or sys.stdout
    with contextlib.suppress(OSError):
        screen.write(f"{lines(line)}\n")
        screen.flush()


def too_large(size: int, most: int) -> str:
    """What is wrong with a file of so many bytes."""
    unit, one = ("GB", 1e9) if most >= 1e9 else ("MiB", 2**20)
    return f"has {size / one:.1f} {unit}, more than the {most / one:g} {unit} that are read"
