"""campaign.toml as fields: what it says, what it leaves open, and one line changed at a time.

`init` leaves a line `# key = ?   # what goes there` for each open question, and `# key =` for what
may be said. A field that is filled in takes the place of its line; all other lines, comments and
their order stay as they are.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.base.errors import UsageError
from pipeline.base.shown import in_toml

_LENGTHS = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Units of a place, in metres."""

_KEY = r"""([\w-]+|"[^"\n]*")"""
_TABLE = re.compile(rf"^(#\s*)?\[\s*{_KEY}(?:\s*\.\s*{_KEY})?\s*\]\s*(?:#.*)?$")
_LINE = re.compile(rf"^(#\s*)?{_KEY}\s*=\s*(.*)$")
_WORD = re.compile(r'"([^"\n]+)"')
_MORE = re.compile(r"^#\s{3,}(.*)$")
_PLACES = ("tool", "base_frame")
_WORDS = ("name", "robot", "operator", "model", "serial", "certificate", "unit", "file", "path")
"""Entries that are words also where they look like numbers: a serial number 0123 is none."""


@dataclass(frozen=True)
class Entry:
    """A line of campaign.toml that says something, or may.

    Attributes:
        line: From 1.
        table: Of the entry; empty for the first lines of the file.
        key: As written.
        value: TOML behind the key; None where it is not said.
        needed: Whether the campaign cannot be read without.
        about: What the comment beside it says.
        words: Words in quotes in that comment, which are the answers that fit.
        whole: Whether its value ends in this line.
    """

    line: int
    table: str
    key: str
    value: str | None
    needed: bool
    about: str
    words: tuple[str, ...]
    whole: bool = True

    @property
    def place(self) -> bool:
        """Whether it is a point with three coordinates."""
        return self.table in _PLACES and self.key != "file"

    @property
    def confirmable(self) -> bool:
        """Whether it asks for something below to be looked at: taking it away is the answer."""
        return self.needed and "remove this line" in self.about

    @property
    def coordinates(self) -> tuple[float, float, float] | None:
        """The point, in metres; None where it is open."""
        known = self.value and self.whole and _is_toml(self.value)
        read = tomllib.loads(f"x = {self.value}")["x"] if known else None
        if not isinstance(read, list) or len(read) != 3:
            return None
        x, y, z = (float(one) if isinstance(one, int | float) else math.nan for one in read)
        return (x, y, z)


def entries(text: str) -> list[Entry]:
    """Every line that says something or may, in their order."""
    lines = text.splitlines()
    found: list[Entry] = []
    table, skip = "", 0
    for number, line in enumerate(lines, 1):
        if number <= skip:
            continue
        if head := _TABLE.match(line):
            table = _called(head)
        elif entry := _LINE.match(line):
            one = _entry(number, table, entry)
            if one is None:
                continue
            skip = number + (_length(lines[number - 1 :]) - 1 if one.value is not None else 0)
            found.append(replace(one, whole=skip <= number))
        elif found and (more := _MORE.match(line)) and _follows(found[-1], number, lines):
            found[-1] = _with_more(found[-1], more[1])
    return found


def _called(head: re.Match[str]) -> str:
    """The name of a table."""
    return ".".join(one.strip('"') for one in head.groups()[1:] if one)


def _with_more(last: Entry, more: str) -> Entry:
    """An entry whose remark goes on in the next line."""
    words = (*last.words, *_WORD.findall(more))
    return replace(last, about=f"{last.about} {more}".strip(), words=words)


def _entry(number: int, table: str, found: re.Match[str]) -> Entry | None:
    """An entry, or None for a comment that only looks like one."""
    silent, key, rest = found.groups()
    value, about = _parted(rest)
    needed = bool(silent) and value == "?"
    if silent and value not in ("", "?") and not about and not _is_toml(value):
        return None
    words = tuple(_WORD.findall(about)) if silent else ()
    said = None if silent else value
    return Entry(number, table, key.strip('"'), said, needed, about, words)


def _follows(last: Entry, number: int, lines: Sequence[str]) -> bool:
    """Whether only lines of its comment lie between an entry and a line."""
    return all(_MORE.match(one) for one in lines[last.line : number - 1])


def _parted(rest: str) -> tuple[str, str]:
    """A value and the comment behind it; a # within a string is none."""
    bare = re.sub(r'"(?:\\.|[^"\\])*"|\'[^\']*\'', lambda one: "s" * len(one[0]), rest)
    at = bare.find("#")
    if at < 0:
        return rest.strip(), ""
    return rest[:at].strip(), rest[at + 1 :].strip()


def _length(lines: Sequence[str]) -> int:
    """Lines that the value beginning in the first one takes."""
    for count in range(1, len(lines) + 1):
        if _is_toml("\n".join([_LINE.sub(r"x = \3", lines[0]), *lines[1:count]])[4:]):
            return count
    return 1


def _is_toml(value: str) -> bool:
    """Whether it is one value, which does not end its line and begin another."""
    try:
        return tomllib.loads(f"x = {value}").keys() == {"x"}
    except (ValueError, RecursionError):
        return False


def filled(text: str, line: int, said: str) -> str:
    """The text with something said in a line; as it was left open where nothing is.

    Args:
        text: campaign.toml.
        line: Of an entry.
        said: TOML of its value; empty takes it away.

    Raises:
        UsageError: The line holds no entry, or the text would be no TOML any more.
    """
    one = next((each for each in entries(text) if each.line == line), None)
    if one is None or not one.whole:
        raise UsageError(f"line {line} of campaign.toml cannot be filled in here: edit the text")
    lines = text.splitlines(keepends=True)
    old = lines[line - 1]
    end = old[len(old.rstrip("\r\n")) :]
    _, key, rest = _LINE.match(old.rstrip("\r\n")).groups()  # type: ignore[union-attr]
    about = _parted(rest)[1]
    remark = f"   # {about}" if about else ""
    if said and not _is_toml(said):
        raise UsageError(f"what is typed for {one.key} would not be valid TOML: {said[:80]}")
    if said:
        lines[line - 1] = f"{key} = {said}{remark}{end}"
        _uncover(lines, line)
    else:
        needed = " ?" if one.needed or one.place else ""
        lines[line - 1] = f"# {key} ={needed}{remark}{end}"
    return sound("".join(lines))


def confirmed(text: str, line: int) -> str:
    """The text without a question that is answered by taking it away, and what it says below.

    Raises:
        UsageError: The line holds no such question.
    """
    one = next((each for each in entries(text) if each.line == line), None)
    if one is None or not one.confirmable:
        raise UsageError(f"line {line} of campaign.toml is no question of that kind")
    lines = text.splitlines(keepends=True)
    end = line
    while end < len(lines) and _MORE.match(lines[end].rstrip("\r\n")):
        end += 1
    return sound("".join([*lines[: line - 1], *lines[end:]]))


def _uncover(lines: list[str], line: int) -> None:
    """Take the comment mark off the title of the table that a line stands in."""
    for k in range(line - 2, -1, -1):
        if head := _TABLE.match(lines[k].rstrip("\r\n")):
            if head[1]:
                lines[k] = lines[k].replace(head[1], "", 1)
            return


def sound(text: str) -> str:
    """The same text, if it is TOML.

    Raises:
        UsageError: With the line where it is none.
    """
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise UsageError(f"campaign.toml would not be valid TOML: {problem}") from problem
    return text


def number(typed: str) -> float:
    """A number as people type it: a decimal comma is as good as a point.

    Raises:
        UsageError: It is none.
    """
    plain = typed.strip().replace("\u2212", "-")
    if re.fullmatch(r"[-+]?[1-9]\d{0,2},\d{3}", plain):
        raise UsageError(f'"{plain}" may be a thousand or a decimal: write it without the comma')
    if "," in plain and "." not in plain:
        plain = plain.replace(",", ".", 1)
    try:
        value = float(plain)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f'"{typed.strip()}" is no number')
    return value


def point(typed: Sequence[str], unit: str) -> str:
    """TOML of three coordinates in metres; nothing where all are empty.

    Raises:
        UsageError: They are no numbers, or not three.
    """
    if not any(one.strip() for one in typed):
        return ""
    if unit not in _LENGTHS or len(typed) != 3:
        raise UsageError("a place has three coordinates in m, mm or in")
    return str([float(f"{number(one) * _LENGTHS[unit]:.12g}") for one in typed])


def value(typed: str, words: Sequence[str] = (), key: str = "") -> str:
    """TOML of what is typed for an entry: a value of TOML as it is, a number, else a word."""
    plain = typed.strip()
    quoted = plain[:1] in ("'", '"') and _is_toml(plain)
    if not plain or plain in words or (key in _WORDS and not quoted):
        return in_toml(plain) if plain else ""
    if _is_toml(plain):
        return plain
    try:
        return f"{number(plain):.12g}"
    except UsageError:
        return in_toml(plain)


def _said_anew(new: str, place: tuple[str, str], value: str) -> str:
    """A campaign.toml with a value in the place of an entry, where it has one that stands whole."""
    there = next((one for one in entries(new) if (one.table, one.key) == place), None)
    return filled(new, there.line, value) if there is not None and there.whole else new


def carried_over(old: str, new: str) -> str:
    """A new campaign.toml with what an old one says wherever both can say it.

    What somebody filled in is worth more than what the files propose; which files there are is
    said by the new one. What has no place in it stands as comments at its end.
    """
    said = {(one.table, one.key): one for one in entries(old) if one.value is not None}
    for place, mine in said.items():
        if mine.whole and place not in _OF_FILES:
            new = _said_anew(new, place, str(mine.value))
    now = {(one.table, one.key) for one in entries(new) if one.value is not None}
    lost = [one for place, one in said.items() if place not in now or not one.whole]
    return f"{new.rstrip()}\n\n{_set_aside(old, lost)}" if lost else new


def with_table(text: str, new: str, name: str) -> str:
    """A campaign.toml with one of its tables as another one has it: changed, gone, or come.

    One that comes stands behind the table that it is a part of.
    """
    lines, (first, last), (begin, end) = text.splitlines(), _span(text, name), _span(new, name)
    block = new.splitlines()[begin:end]
    if first == last and block:
        first = last = _span(text, name.rpartition(".")[0])[1] or len(lines)
        block = ["", *block]
    return "\n".join([*lines[:first], *block, *lines[last:], ""])


def _span(text: str, name: str) -> tuple[int, int]:
    """Lines of a table with its head, up to what stands before the next one; none: two alike."""
    lines = text.splitlines()
    heads = [k for k, line in enumerate(lines) if _TABLE.match(line)]
    for k, after in zip(heads, [*heads[1:], len(lines)], strict=True):
        head = _TABLE.match(lines[k])
        if head and _called(head) == name:
            said = [i for i in range(k, after) if lines[i].strip() and lines[i][0] != "#"]
            return k, said[-1] + 1
    return 0, 0


def _set_aside(old: str, lost: Sequence[Entry]) -> str:
    """Lines of an old text as comments, each below its table."""
    lines, out = old.splitlines(), ["# from the campaign.toml before, which have no place above:"]
    for one in lost:
        end = one.line - 1 + _length(lines[one.line - 1 :])
        out += [f"#   of [{one.table}]"] if one.table else []
        out += [f"#   {line}" for line in lines[one.line - 1 : end]]
    return "\n".join([*out, ""])


_OF_FILES = (("", "format"), ("tracker", "files"), ("scale", "file"), ("joints", "file"))
"""What the files that lie there now say better than an old campaign.toml."""
