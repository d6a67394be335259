r"""ABB RAPID: points declared, assigned or written into the motions.

    CONST robtarget p10:=[[1200,0,800],[0,0,1,0],[0,0,-1,0],[350,9E9,9E9,9E9,9E9,9E9]];
    MoveL p10,v100,z10,tGripper\WObj:=wobj1;

Tool and frame are those of the motions to a point.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot.inverse import Range
from pipeline.programs._text import Entry, Source, entries, inner, numbers
from pipeline.programs.notation import ABB
from pipeline.programs.program import Left, Number, Program, Target, Use, changed, gathered

SUFFIXES = (".mod", ".modx", ".prg")

_SILENT = re.compile(r'"(?:[^"\r\n]|"")*"|![^\r\n]*')
_DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(?:\{[^}]*\})?\s*:=\s*", re.IGNORECASE
)
_ASSIGNED = re.compile(r"(?<![\\\w.])(?<!\\\s)(\w+)\s*(\{[^}]*\})?\s*(\.\s*[\w.\s]+)?:=\s*")
_MOTION = re.compile(
    r"(?:^|;|:(?!=)|\b(?:THEN|DO|ELSE)\b)[ \t]*"
    r"((?:Move|Trigg|Search|(?:Arc|Spot|Disp|Paint)[LJC]|PDisp|EOffs|Conf[LJ])\w*)(?!\s*(?:\(|:=)|\w)",
    re.IGNORECASE | re.MULTILINE,
)
_WORD = re.compile(r"\w*")
_POINT = re.compile(r"(\w+)\s*(?:\{\s*(\w+)\s*\})?$")
_SWITCHES = re.compile(r"(?:\s*\\\s*\w+(?:\s*:=\s*[^\\,]+)?)+$")
_WOBJ = re.compile(r"\\\s*WObj\s*:=\s*(\w+)\s*", re.IGNORECASE)
_UNUSED = 1e9
"""An external axis of 9E9 is none."""

_MOTIONS: dict[str, tuple[tuple[int, ...], int]] = {
    "movel": ((0,), 3),
    "movej": ((0,), 3),
    "moveabsj": ((0,), 3),
    "movec": ((0, 1), 4),
    "moveldo": ((0,), 3),
    "movejdo": ((0,), 3),
    "movecdo": ((0, 1), 4),
    "movelsync": ((0,), 3),
    "movejsync": ((0,), 3),
    "movecsync": ((0, 1), 4),
    "triggl": ((0,), 4),
    "triggj": ((0,), 4),
    "triggabsj": ((0,), 4),
    "triggc": ((0, 1), 5),
    "searchl": ((2,), 4),
    "searchc": ((2, 3), 5),
}
"""Which arguments of a motion are points, and which is the tool."""
_NO_MOTION = ("trigg",)
"""How instructions begin that only prepare a motion: TriggIO, TriggEquip."""
_FRAMES = ("tooldata", "wobjdata")
_DISPLACED = ("pdispset", "pdispon", "eoffsset", "eoffson")
_BACK = ("pdispoff", "eoffsoff")
_CHECKED = ("confl", "confj")
"""What says whether the configurations of points hold, in linear motions and in others."""
_BY_AXES = ("movej", "triggj")


@dataclass
class _Reading:
    """What was read so far; names in small letters."""

    source: Source
    points: dict[str, list[Target | str]] = field(default_factory=dict)
    computed: dict[str, int] = field(default_factory=dict)
    uses: list[Use] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    tools: dict[str, Array] = field(default_factory=lambda: {"tool0": np.eye(4)})
    bases: dict[str, Array] = field(default_factory=lambda: {"wobj0": np.eye(4)})
    displaced: bool = False
    unchecked: set[str] = field(default_factory=set)


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """The points of a module.

    Args:
        file: Its name.
        text: Its text.
        other: Nothing: a module stands alone.
    """
    found = _Reading(Source(file, text, _SILENT))
    _define(found)
    for motion in _MOTION.finditer(found.source.plain):
        _follow(found, motion)
    if not (found.uses or found.left):  # a module of data alone
        points = (one for all_ in found.points.values() for one in all_)
        found.uses = [Use(one, "", "") for one in points if isinstance(one, Target)]
    targets, left = gathered(found.uses, changed(found.points, found.computed))
    told = tuple(sorted({*found.left, *left}))
    return Program(file, text, ABB, tuple(targets), told, found.tools, found.bases)


def _define(found: _Reading) -> None:
    """Points and frames, and what the program itself assigns to them."""
    plain, declared = found.source.plain, set()
    for one in _DECLARED.finditer(plain):
        declared.add(one.start(2))
        kind, name = one[1].lower(), one[2].lower()
        value = entries(plain, one.end(), _end(plain, one.end()))
        if kind in ("robtarget", "jointtarget"):
            found.points[name] = [*_points(found, one[2], value)]
        elif kind in _FRAMES and (frame := _frame(plain, kind, value)) is not None:
            (found.tools if kind == "tooldata" else found.bases)[name] = frame
    for one in _ASSIGNED.finditer(plain):
        if one.start(1) not in declared:
            _assign(found, one)


def _end(plain: str, start: int) -> int:
    """Where the statement ends; one without an end says nothing."""
    end = plain.find(";", start)
    return start if end < 0 else end


def _assign(found: _Reading, one: re.Match[str]) -> None:
    """A point, a part of one or a frame that the program sets itself."""
    name, plain = one[1].lower(), found.source.plain
    value = entries(plain, one.end(), _end(plain, one.end()))
    points = list(_points(found, one[1], value))
    whole = one[2] is None and one[3] is None
    if whole and all(isinstance(point, Target) for point in points):
        found.points.setdefault(name, []).extend(points)
    else:
        found.computed[name] = found.source.line(one.start(1))
        for frames in (found.tools, found.bases):
            frames.pop(name, None)


def _points(
    found: _Reading, name: str, value: Sequence[Entry], dimensions: int = 3
) -> Iterator[Target | str]:
    """The points of a value, several in an array; why not, where one cannot be corrected."""
    plain = found.source.plain
    for entry in value:
        parts = inner(plain, entry)
        if parts is None:
            yield f"{name} is computed at run time"
            continue
        deeper = inner(plain, parts[0])
        if dimensions and deeper and inner(plain, deeper[0]) is not None:  # an array
            for k, one in enumerate(parts, 1):
                yield from _points(found, f"{name}{{{k}}}", [one], dimensions - 1)
        else:
            yield _point(found, name, entry, parts)


def _point(found: _Reading, name: str, entry: Entry, parts: Sequence[Entry]) -> Target | str:
    """A robtarget of four lists, or a jointtarget of two."""
    read = [numbers(inner(found.source.plain, part)) or () for part in parts]
    place = name, found.source.file, found.source.line(entry.start)
    external = tuple(n.value for n in read[-1] if abs(n.value) < _UNUSED)
    match [len(one) for one in read]:
        case [6, 6]:
            return Target(*place, "joint", read[0], external)
        case [3, 4, 4, 6]:
            pose = (*read[0], *read[1])
            return Target(*place, "cartesian", pose, external, ranges=_ranges(read[2]))
        case _:
            return f"{name} is computed at run time"


def _ranges(configuration: Sequence[Number]) -> tuple[Range, ...]:
    """Quarter turns of axes 1, 4 and 6, and the sign of axis 5: it is negative where cfx is odd."""
    cf1, cf4, cf6, cfx = (number.value for number in configuration)
    quarter = np.pi / 2
    first, fourth, sixth = ((cf * quarter, (cf + 1) * quarter) for cf in (cf1, cf4, cf6))
    fifth = (-np.inf, 0.0) if cfx % 2 else (0.0, np.inf)
    return (first, None, None, fourth, fifth, sixth)


def _frame(plain: str, kind: str, value: Sequence[Entry]) -> Array | None:
    """The frame of tooldata or wobjdata; None where it moves with something else."""
    parts = inner(plain, value[0]) or [] if value else []
    match kind, [part.text.upper() for part in parts]:
        case "tooldata", ["TRUE", _, _]:
            return _pose(plain, parts[1])
        case "wobjdata", ["FALSE", "TRUE", _, _, _]:
            user, object_ = _pose(plain, parts[3]), _pose(plain, parts[4])
            return None if user is None or object_ is None else user @ object_
        case _:
            return None


def _pose(plain: str, entry: Entry) -> Array | None:
    parts = inner(plain, entry)
    lists = [numbers(inner(plain, part)) for part in parts or ()]
    if [len(one or ()) for one in lists] != [3, 4]:
        return None
    values = [number.value for one in lists for number in one or ()]
    return ABB.frame(values) if any(values[3:]) else None


def _follow(found: _Reading, motion: re.Match[str]) -> None:
    """An instruction as the robot carries it out."""
    plain, name = found.source.plain, motion[1].lower()
    if name in _DISPLACED or name in _BACK:
        found.displaced = name in _DISPLACED
    elif name in _CHECKED:
        said = plain[motion.end() : _end(plain, motion.end())].lower()
        found.unchecked = found.unchecked - {name} | ({name} if "off" in said else set())
    elif name in _MOTIONS:
        given = entries(plain, motion.end(), _end(plain, motion.end()))
        while given and given[0].text.startswith("\\"):
            given = given[1:]
        _move(found, name, given)
    elif not name.startswith(_NO_MOTION):
        line = found.source.line(motion.start(1))
        found.left.append(Left(found.source.file, line, f"{motion[1]} is no motion known here"))


def _move(found: _Reading, name: str, given: Sequence[Entry]) -> None:
    """The points of a motion with its tool and its frame."""
    which, tool_at = _MOTIONS[name]
    if len(given) <= tool_at:
        return
    said = given[tool_at].text
    tool = (_WORD.match(said) or [""])[0].strip().lower()
    wobj = _WOBJ.search(said)
    base = wobj[1].lower() if wobj else "wobj0"
    checked = ("confj" if name.startswith(_BY_AXES) else "confl") not in found.unchecked
    for k in which:
        entry = given[k]
        line = found.source.line(entry.start)
        why: str | None = f"{entry.text} is displaced by the program"
        if not found.displaced:
            why = _use(found, entry, (tool, base), checked)
        if why:
            found.left.append(Left(found.source.file, line, why))


def _use(found: _Reading, entry: Entry, frames: tuple[str, str], checked: bool) -> str | None:
    """Note a motion to a point; why not, where it cannot be corrected.

    Args:
        found: What was read so far.
        entry: The point.
        frames: Tool and work object.
        checked: The configuration that it states holds.
    """
    text = _SWITCHES.sub("", entry.text)
    if text.startswith("["):
        inline = Entry(entry.start, entry.start + len(text), text)
        name = f"the target in line {found.source.line(entry.start)}"
        points: Sequence[Target | str] = list(_points(found, name, [inline]))
    elif named := _POINT.match(text):
        points = _named(found, named[1].lower(), named[2])
    else:
        return f"{text} is computed at run time"
    if not points:
        return f"{text} is not in this program"
    for point in points:
        if isinstance(point, str):
            return point
        found.uses.append(Use(point if checked else replace(point, ranges=()), *frames))
    return None


def _named(found: _Reading, name: str, index: str | None) -> Sequence[Target | str]:
    """The points of a name; all elements of an array where the index is computed."""
    points = found.points.get(name, [])
    if index and index.isdigit():
        return points[int(index) - 1 : int(index)]
    return points
