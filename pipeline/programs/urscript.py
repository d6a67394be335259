"""URScript: poses p[...] in metres and rotation vectors, lists of six joints in radians.

    wp = p[-0.412, 0.210, 0.350, 0.0, 3.1416, 0.0]
    movel(wp, a=1.2, v=0.25)
    movej([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])

The tool is that of the last set_tcp in the text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.base.arrays import Array
from pipeline.programs._text import Entry, Source, closing, entries, inner, numbers
from pipeline.programs.notation import UR
from pipeline.programs.program import Left, Program, Target, Use, changed, gathered

SUFFIXES = (".script", ".urscript")

_SILENT = re.compile(r'"[^"\r\n]*"|\'[^\'\r\n]*\'|#[^\r\n]*')
_ASSIGNED = re.compile(
    r"^[ \t]*(?:(?:global|local)[ \t]+)?(\w+)[ \t]*(\[[^\]]*\])?[ \t]*=(?!=)[ \t]*", re.MULTILINE
)
_CALL = re.compile(
    r"(?<![\w.])(movej|movel|movep|movec|servoj|servoc|speedl|speedj|set_tcp)\s*(?=\()"
)
_ARGUMENT = re.compile(r"(?:pose|q|pose_via|pose_to|p)\s*=\s*(?!=)")
_INVERSE = re.compile(r"get_inverse_kin\s*(?=\()")
_NEAR = re.compile(r"(?:qnear\s*=\s*)?")
_NAMED = re.compile(r"(\w+)\s*(?:\[\s*(\w+)\s*\])?$")
_POINTS = {"movec": 2, "servoc": 1}
_SPEEDS = ("speedl", "speedj")


@dataclass
class _Reading:
    """What was read so far."""

    source: Source
    points: dict[str, list[Target | str]] = field(default_factory=dict)
    computed: dict[str, int] = field(default_factory=dict)
    uses: list[Use] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    tools: dict[str, Array] = field(default_factory=dict)
    tool: str = ""


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """The points of a script.

    Args:
        file: Its name.
        text: Its text.
        other: Nothing: a script stands alone.
    """
    found = _Reading(Source(file, text, _SILENT))
    for assigned in _ASSIGNED.finditer(found.source.plain):
        _define(found, assigned)
    for call in _CALL.finditer(found.source.plain):
        _follow(found, call)
    targets, left = gathered(found.uses, changed(found.points, found.computed))
    told = tuple(sorted({*found.left, *left}))
    return Program(file, text, UR, tuple(targets), told, found.tools, {"": np.eye(4)})


def _define(found: _Reading, assigned: re.Match[str]) -> None:
    """What a variable is set to."""
    name, plain = assigned[1], found.source.plain
    value = _value(plain, assigned.end())
    points = [] if assigned[2] else list(_points(found, name, value))
    if points and all(isinstance(point, Target) for point in points):
        found.points.setdefault(name, []).extend(points)
    else:
        found.computed[name] = found.source.line(assigned.start(1))


def _value(plain: str, start: int) -> Entry:
    """What stands behind an equals sign: a list over several lines, or the rest of one."""
    opening = re.compile(r"p?\s*\[").match(plain, start)
    last = closing(plain, opening.end() - 1) if opening else None
    end = re.compile(r"[\r\n]|\Z").search(plain, start if last is None else last)
    text = plain[start : end.start() if end else len(plain)]
    return Entry(start, start + len(text), text.rstrip())


def _points(
    found: _Reading, name: str, value: Entry, several: bool = True
) -> Iterator[Target | str]:
    """The points of a value, several in a list of them; why not, where one cannot be corrected."""
    plain, pose = found.source.plain, value.text.startswith("p")
    shift = len(value.text) - len(value.text[1:].lstrip()) if pose else 0
    listed = Entry(value.start + shift, value.end, value.text[shift:])
    parts = inner(plain, listed)
    own = numbers(parts)
    if own is not None and len(own) == 6:
        kind = "cartesian" if pose else "joint"
        line = found.source.line(value.start)
        yield Target(name, found.source.file, line, kind, own)  # type: ignore[arg-type]
    elif several and parts and not pose and parts[0].text.startswith(("p", "[")):
        for k, part in enumerate(parts):
            yield from _points(found, f"{name}[{k}]", part, several=False)
    else:
        yield f"{name} is computed at run time"


def _follow(found: _Reading, call: re.Match[str]) -> None:
    """A call as the robot carries it out: a tool, or a motion."""
    plain, name = found.source.plain, call[1]
    last = closing(plain, call.end())
    given = entries(plain, call.end() + 1, len(plain) if last is None else last)
    line = found.source.line(call.start())
    if name == "set_tcp":
        _tool(found, given[0], line)
    elif name in _SPEEDS:
        found.left.append(Left(found.source.file, line, f"{name} has a speed and no target"))
    else:
        for entry in given[: _POINTS.get(name, 1)]:
            if why := _use(found, entry):
                found.left.append(Left(found.source.file, found.source.line(entry.start), why))


def _tool(found: _Reading, entry: Entry, line: int) -> None:
    """The tool that holds from here on."""
    found.tool = f"line {line}"
    points = found.points.get(entry.text, []) if entry.text not in found.computed else []
    if not points:
        points = list(_points(found, "tool", entry))
    if len(points) == 1 and isinstance(points[0], Target) and points[0].kind == "cartesian":
        found.tools[found.tool] = UR.frame(points[0].values)


def _use(found: _Reading, entry: Entry) -> str | None:
    """Note a motion to a point; why not, where it cannot be corrected."""
    entry, near = _inside(found, _without(entry, _ARGUMENT))
    points: Sequence[Target | str]
    if entry.text.startswith("[") or re.match(r"p\s*\[", entry.text):
        points = list(_points(found, f"the target in line {found.source.line(entry.start)}", entry))
    elif named := _NAMED.match(entry.text):
        points = _named(found, named[1], named[2])
    else:
        return f"{entry.text} is computed at run time"
    if not points:
        return f"{entry.text} is computed at run time"
    for point in points:
        if isinstance(point, str):
            return point
        with_start = Target(**{**vars(point), "near": near})
        found.uses.append(Use(with_start, found.tool, ""))
    return None


def _without(entry: Entry, prefix: re.Pattern[str]) -> Entry:
    """An argument without its name."""
    named = prefix.match(entry.text)
    if named is None:
        return entry
    return Entry(entry.start + named.end(), entry.end, entry.text[named.end() :])


def _inside(found: _Reading, entry: Entry) -> tuple[Entry, tuple[float, ...]]:
    """The pose within get_inverse_kin(pose, qnear), and the joints near which it is looked for."""
    plain, call = found.source.plain, _INVERSE.match(entry.text)
    if call is None:
        return entry, ()
    start = entry.start + call.end()
    last = closing(plain, start)
    if last is None or last + 1 != entry.start + len(entry.text):
        return entry, ()
    first, *more = entries(plain, start + 1, last)
    near: tuple[float, ...] = ()
    for other in more[:1]:
        said = _without(other, _NEAR)
        points = found.points.get(said.text, []) or list(_points(found, "", said))
        near = next((p.values for p in points if isinstance(p, Target)), ())
    return first, near


def _named(found: _Reading, name: str, index: str | None) -> Sequence[Target | str]:
    """The points of a name; all elements of a list where the index is computed."""
    points = found.points.get(name, [])
    if index and index.isdigit():
        return points[int(index) : int(index) + 1]
    return points
