"""campaign.toml as fields: what it states, what it leaves open, and changes line by line.

`init` writes a line `# key = ?   # what goes there` for each open question, and `# key =` for each
optional entry. A field that is filled in replaces its line; all other lines, comments and their
order stay unchanged.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.base.errors import UsageError
from pipeline.base.shown import in_toml

_LENGTHS = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Units of coordinates [m]."""

_KEY = r"""([\w-]+|"[^"\n]*")"""
_TABLE = re.compile(rf"^(#\s*)?\[\s*{_KEY}(?:\s*\.\s*{_KEY})?\s*\]\s*(?:#.*)?$")
_LINE = re.compile(rf"^(#\s*)?{_KEY}\s*=\s*(.*)$")
_WORD = re.compile(r'"([^"\n]+)"')
_MORE = re.compile(r"^#\s{3,}(?:# )?(.*)$")
_PLACES = ("tool", "base_frame", "anchors")
_WORDS = ("name", "robot", "operator", "model", "serial", "certificate", "unit", "file", "path")
"""Keys whose values are strings even if they look like numbers, such as a serial number 0123."""


@dataclass(frozen=True)
class FormEntry:
    """A line of campaign.toml that contains an entry, or may be filled in.

    Attributes:
        line: Line number, from 1.
        table: Table of the entry; empty for the first lines of the file.
        key: Key as written.
        value: TOML behind the key; None if it is not stated.
        needed: Whether the campaign cannot be read without it.
        about: Text of the comment behind it.
        words: Words in quotes in that comment, which are the possible answers.
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
    def decides(self) -> bool:
        """Whether others depend on it: the robot, and questions on how exports are read."""
        return (self.table, self.key) == ("", "robot") or (self.table == "tracker" and self.needed)

    @property
    def confirmable(self) -> bool:
        """Whether it asks for something below to be confirmed, by removing the line."""
        return self.needed and re.search("(then|and) remove this line", self.about) is not None

    @property
    def coordinates(self) -> tuple[float, float, float] | None:
        """The point [m]; None if it is open."""
        known = self.value and self.whole and _is_toml(self.value)
        read = tomllib.loads(f"x = {self.value}")["x"] if known else None
        if not isinstance(read, list) or len(read) != 3:
            return None
        x, y, z = (float(one) if isinstance(one, int | float) else math.nan for one in read)
        return (x, y, z)


def entries(text: str) -> list[FormEntry]:
    """All lines that contain an entry or may be filled in, in their order."""
    lines = text.splitlines()
    found: list[FormEntry] = []
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
    """Name of a table."""
    return ".".join(one.strip('"') for one in head.groups()[1:] if one)


def _with_more(last: FormEntry, more: str) -> FormEntry:
    """An entry whose comment continues in the next line."""
    words = (*last.words, *_WORD.findall(more))
    return replace(last, about=f"{last.about} {more}".strip(), words=words)


def _entry(number: int, table: str, found: re.Match[str]) -> FormEntry | None:
    """An entry, or None for a comment that only resembles one."""
    silent, key, rest = found.groups()
    value, about = _parted(rest)
    needed = bool(silent) and value == "?"
    if silent and value not in ("", "?") and not about and not _is_toml(value):
        return None
    words = tuple(_WORD.findall(about)) if silent else ()
    shown = None if silent else value
    return FormEntry(number, table, key.strip('"'), shown, needed, about, words)


def _follows(last: FormEntry, number: int, lines: Sequence[str]) -> bool:
    """Whether only lines of its comment are between an entry and a line."""
    return all(_MORE.match(one) for one in lines[last.line : number - 1])


def _parted(rest: str) -> tuple[str, str]:
    """A value and the comment behind it; a # within a string does not begin one."""
    bare = re.sub(r'"(?:\\.|[^"\\])*"|\'[^\']*\'', lambda one: "s" * len(one[0]), rest)
    at = bare.find("#")
    if at < 0:
        return rest.strip(), ""
    return rest[:at].strip(), rest[at + 1 :].strip()


def _length(lines: Sequence[str]) -> int:
    """Number of lines of the value that begins in the first line."""
    for count in range(1, len(lines) + 1):
        if _is_toml("\n".join([_LINE.sub(r"x = \3", lines[0]), *lines[1:count]])[4:]):
            return count
    return 1


def _is_toml(value: str) -> bool:
    """Whether it is exactly one value, without a further entry."""
    try:
        return tomllib.loads(f"x = {value}").keys() == {"x"}
    except (ValueError, RecursionError):
        return False


def filled(text: str, line: int, stated: str) -> str:
    """The text with a value filled in at a line, or the line open again if the value is empty.

    Args:
        text: campaign.toml.
        line: Line of an entry.
        stated: TOML of its value; empty to remove it.

    Raises:
        UsageError: The line contains no entry, or the text would no longer be valid TOML.
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
    if stated and not _is_toml(stated):
        raise UsageError(f"what is typed for {one.key} would not be valid TOML: {stated[:80]}")
    if stated:
        lines[line - 1] = f"{key} = {stated}{remark}{end}"
        _uncover(lines, line)
    else:
        needed = " ?" if one.needed or one.place else ""
        lines[line - 1] = f"# {key} ={needed}{remark}{end}"
    return sound("".join(lines))


def confirmed(text: str, line: int) -> str:
    """The text without a question that is answered by removing it, and without its comment.

    Raises:
        UsageError: The line contains no such question.
    """
    one = next((each for each in entries(text) if each.line == line), None)
    if one is None or not one.confirmable:
        raise UsageError(f"line {line} of campaign.toml is no question of that kind")
    lines = text.splitlines(keepends=True)
    end = line
    while end < len(lines) and _MORE.match(lines[end].rstrip("\r\n")):
        end += 1
    return sound("".join([*lines[: line - 1], *lines[end:]]))


def with_columns(text: str, columns: Mapping[str, str | int]) -> str:
    """The text with what each column of a table is, which settles the question about them.

    Args:
        text: campaign.toml.
        columns: Title or number of the column by role.

    Raises:
        UsageError: The text has no [tracker.mapping], or not in one line.
    """
    found = {(one.table, one.key): one for one in entries(text)}
    if (mapping := found.get(("tracker.mapping", "columns"))) is None:
        raise UsageError("campaign.toml has no columns in [tracker.mapping]: edit its text")
    said = ", ".join(
        f"{role} = {one if isinstance(one, int) else in_toml(one)}" for role, one in columns.items()
    )
    text = filled(text, mapping.line, f"{{ {said} }}")
    asked = found.get(("tracker", "columns"))
    return confirmed(text, asked.line) if asked and asked.confirmable else text


def _uncover(lines: list[str], line: int) -> None:
    """Uncomment the heading of the table that contains a line."""
    for k in range(line - 2, -1, -1):
        if head := _TABLE.match(lines[k].rstrip("\r\n")):
            if head[1]:
                lines[k] = lines[k].replace(head[1], "", 1)
            return


def sound(text: str) -> str:
    """The text, if it is valid TOML.

    Raises:
        UsageError: It is not; the message states the line.
    """
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise UsageError(f"campaign.toml would not be valid TOML: {problem}") from problem
    return text


def number(typed: str) -> float:
    """A number as typed, with a decimal point or a decimal comma.

    Raises:
        UsageError: It is not a finite number, or the comma is ambiguous.
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
    """TOML of three coordinates in metres; empty if all are empty.

    Raises:
        UsageError: They are not numbers, or not three.
    """
    if not any(one.strip() for one in typed):
        return ""
    if unit not in _LENGTHS or len(typed) != 3:
        raise UsageError("a place has three coordinates in m, mm or in")
    return str([float(f"{number(one) * _LENGTHS[unit]:.12g}") for one in typed])


def value(typed: str, words: Sequence[str] = (), key: str = "") -> str:
    """TOML of a typed value: valid TOML unchanged, a number, else a string."""
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


def _stated_again(new: str, old: str, mine: FormEntry) -> str:
    """A campaign.toml with an entry of an old one and its remark, if it has it on one line."""
    place = (mine.table, mine.key)
    there = next((one for one in entries(new) if (one.table, one.key) == place), None)
    if there is None or not there.whole:
        return new
    lines = filled(new, there.line, str(mine.value)).splitlines(keepends=True)
    remark = _parted(old.splitlines()[mine.line - 1])[1]
    if remark and remark not in lines[there.line - 1]:
        lines[there.line - 1] = f"{_parted(lines[there.line - 1])[0]}   # {remark}\n"
    return "".join(lines)


def carried_over(old: str, new: str) -> str:
    """A new campaign.toml with all values of an old one that have an entry in it.

    What was filled in takes precedence over what the files suggest; only the names of the files
    come from the new one. Values without an entry are appended as comments, as are comments on
    lines of their own that the new one lacks.
    """
    stated = {(one.table, one.key): one for one in entries(old) if one.value is not None}
    for place, mine in stated.items():
        if mine.whole and place not in _OF_FILES:
            new = _stated_again(new, old, mine)
    now = {(one.table, one.key) for one in entries(new) if one.value is not None}
    lost = [one for place, one in stated.items() if place not in now or not one.whole]
    notes = _notes(old, new)
    return f"{new.rstrip()}\n\n{_set_aside(old, lost, notes)}" if lost or notes else new


def _notes(old: str, new: str) -> list[str]:
    """Comments on lines of their own that a new text lacks, and that no entry asks or explains."""
    asked = {one.line for one in entries(old)}
    return [
        line
        for number, line in enumerate(old.splitlines(), 1)
        if line.startswith("#")
        and number not in asked
        and not (_MORE.match(line) or _TABLE.match(line) or _UNUSED.match(line) or line == _BEFORE)
        and line not in new
    ]


def with_table(text: str, new: str, name: str) -> str:
    """A campaign.toml with one table replaced by that of another: changed, removed, or added.

    An added table is placed behind the table that contains it.
    """
    lines, (first, last), (begin, end) = text.splitlines(), _span(text, name), _span(new, name)
    block = new.splitlines()[begin:end]
    if first == last and block:
        first = last = _span(text, name.rpartition(".")[0])[1] or len(lines)
        block = ["", *block]
    return "\n".join([*lines[:first], *block, *lines[last:], ""])


def _span(text: str, name: str) -> tuple[int, int]:
    """Start and end of a table with its heading, up to its last entry; (0, 0) if absent."""
    lines = text.splitlines()
    heads = [k for k, line in enumerate(lines) if _TABLE.match(line)]
    for k, after in zip(heads, [*heads[1:], len(lines)], strict=True):
        head = _TABLE.match(lines[k])
        if head and _called(head) == name:
            chosen = [i for i in range(k, after) if lines[i].strip() and lines[i][0] != "#"]
            return k, chosen[-1] + 1
    return 0, 0


def _set_aside(old: str, lost: Sequence[FormEntry], notes: Sequence[str]) -> str:
    """Comments of an old text, and lines of it as comments, each below its table."""
    lines, out = old.splitlines(), [_BEFORE, *notes]
    for one in lost:
        end = one.line - 1 + _length(lines[one.line - 1 :])
        out += [f"#   of [{one.table}]"] if one.table else []
        out += [f"#   {line}" for line in lines[one.line - 1 : end]]
    return "\n".join([*out, ""])


_UNUSED = re.compile(r"# .+ (is|are) not used\b")
_BEFORE = "# from the campaign.toml before, which have no place above:"

_OF_FILES = (("", "format"), ("tracker", "files"), ("scale", "file"), ("joints", "file"))
"""Entries about files, for which the new campaign.toml is right."""
