"""FANUC TP as text (.ls): motions under /MN, points under /POS, each with its frames.

    /MN
       1:L P[1] 500mm/sec FINE ;
    /POS
    P[1]{
       GP1:
        UF : 1, UT : 2, CONFIG : 'N U T, 0, 0, 0',
        X = 1200.000 mm, Y = .000 mm, Z = 800.000 mm,
        W = 180.000 deg, P = .000 deg, R = .000 deg, E1 = 350.000 mm
    };

Frames are given by number; their values are known to the controller only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from pipeline.programs._parser import Lexicon, ParserState, finished
from pipeline.programs._text import Source
from pipeline.programs.inverse import Range
from pipeline.programs.notation import FANUC
from pipeline.programs.program import (
    NUMBER_PATTERN,
    MotionUse,
    Number,
    Program,
    Target,
    Uncorrected,
    number,
)

SUFFIXES, SIGN = (".ls",), "!"
HEADS: dict[str, str] = {}  # remarks stand behind the last line

_SILENT = re.compile(r"^[ \t]*\d+[ \t]*:[ \t]*(?:!|//)[^\r\n]*", re.MULTILINE)
_POSITIONS = re.compile(r"^/POS\b", re.MULTILINE | re.IGNORECASE)
_MOTIONS = re.compile(r"^/MN\b", re.MULTILINE | re.IGNORECASE)
_LABEL = r"P\s*\[\s*(\d{1,6})(?!\d)"
_POINT = re.compile(
    rf'^[ \t]*{_LABEL}\s*(?::\s*"[^"\r\n]*"\s*|[^\]\r\n]*)\]\s*\{{([^{{}}]*)\}}',
    re.MULTILINE | re.IGNORECASE,
)
_GROUP = re.compile(r"\bGP(\d)\s*:", re.IGNORECASE)
_FRAMES = re.compile(r"\b(UF|UT)\s*:\s*(\w+)", re.IGNORECASE)
_VALUE = re.compile(rf"\b([XYZWPR]|[JE]\d)\s*=\s*({NUMBER_PATTERN})\s*(mm|deg)\b", re.IGNORECASE)
_TURNS = re.compile(
    r"CONFIG\s*:\s*'[^',]*,\s*(-?\d{1,3})\s*,\s*(-?\d{1,3})\s*,\s*(-?\d{1,3})\b", re.IGNORECASE
)
_STATEMENT = re.compile(
    r"^[ \t]*\d+[ \t]*:([^;\r\n]*(?:[\r\n]+[ \t]*:[^;\r\n]*)*)"
    r"((?:[\r\n]+(?![ \t]*(?:\d+[ \t]*:|/))[^;\r\n]*)*)",
    re.MULTILINE,
)
"""Matches a statement, and what is behind it on lines that have neither number nor colon."""
_MOTION = re.compile(r"\s*([JLCAS])\s+(?=@?\s*PR?\s*\[)", re.IGNORECASE)
_TO_ONE, _CHAINED = "JL", "AS"
"""Letters of motions to one point, and of arcs and splines through those of several statements."""
_NAMED = re.compile(rf"(?<!\w){_LABEL}", re.IGNORECASE)
_INDIRECT = re.compile(r"(?<!\w)PR?\s*\[(?:[^\[\]]|\[[^\[\]]*\])*\]", re.IGNORECASE)
_READ = re.compile(r"\s*PR\s*\[(?:[^\[\]]|\[[^\[\]]*\])*\]\s*=", re.IGNORECASE)
_COMPUTED = re.compile(
    r"\b(Tool_Offset|Offset|VOFFSET|Touch_?Offset|PTH_OFFSET|RTCP|COORD|TRACK|INC)\b", re.IGNORECASE
)
_SELECTED = re.compile(
    r"(?<!\w)\$?(?:MNU)?(UFRAME|UTOOL|FRAME|TOOL)(_?NUM)?\s*"
    r"(?:\[((?:[^=;\[\]\r\n]|\[[^=;\[\]\r\n]*\])*)\])?(?:\.\s*\$?\w+)?\s*=\s*([^;\r\n]*)",
    re.IGNORECASE,
)
_CURRENT = "f"
"""Frame of a point that was taught in whichever frame is selected."""
_SHIFTS = re.compile(r"\s*(Touch[ _]?Offset|Track)\b(?!\s*End)", re.IGNORECASE)
"""Matches what shifts the points of all following motions."""
_POSE, _AXES = ("x", "y", "z", "w", "p", "r"), tuple(f"j{k}" for k in range(1, 7))
_EXTERNAL = tuple(f"e{k}" for k in range(1, 10))
_LEXICON = Lexicon(
    motion=re.compile(
        r"(?<![\w$])(PR?\s*\[[^\]\r\n]{0,40}\]?)|^[ \t]*\d+[ \t]*:\s*([JLCAS])[ \t]", re.M | re.I
    ),
    literal=re.compile(
        r"(?:^|,)[ \t]*((?:X|J1)[ \t]*=[ \t]*[-+.\d]+)", re.MULTILINE | re.IGNORECASE
    ),
)


@dataclass
class _Tp(ParserState):
    """What has been read so far of a TP program; points are named by their numbers.

    Attributes:
        tools_set: Why tools may not be those of the points, by their numbers; "" stands for all.
        bases_set: Likewise for frames.
        kind: Letter of the last motion.
    """

    tools_set: dict[str, str] = field(default_factory=dict)
    bases_set: dict[str, str] = field(default_factory=dict)
    kind: str = ""


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """Read the points of a program.

    Args:
        file: Name of the file.
        text: Its text.
        other: Not used: a TP program is a single file.
    """
    source = Source(file, text, _SILENT)
    positions = _POSITIONS.search(source.plain)
    end = positions.start() if positions else len(text)
    found = _Tp([source], _LEXICON)
    found.tools["0"] = found.bases["0"] = np.eye(4)
    for one in _POINT.finditer(source.plain, end):
        found.account(source, *one.span())
        found.points.setdefault(_number(one[1]), []).append(_point(source, one))
    _motions(found, end)
    if not (found.uses or found.left or found.following):  # without motions, all points are targets
        found.named |= {*found.points}
        for label, several in found.points.items():
            found.left += filter(None, _note(found, label, source, several[0].line))
    return finished(found, file, text, FANUC)


def _number(label: str) -> str:
    return f"P[{int(label)}]"


def _motions(found: _Tp, end: int) -> None:
    """Record the frames that the program sets, then its motions."""
    source = found.sources[0]
    first = _MOTIONS.search(source.plain)
    start = first.end() if first else 0
    statements = list(_STATEMENT.finditer(source.plain, start, max(start, end)))
    for selected in _SELECTED.finditer(source.plain, start, max(start, end)):
        _select(found, source.line(selected.start()), selected)
    for one in statements:
        if _MOTION.match(one[1]):
            found.account(source, one.start(), one.end(1))
            _move(found, source, one)
        else:
            _other(found, source, one)


def _select(found: _Tp, line: int, selected: re.Match[str]) -> None:
    """Record that a frame is redefined, or that its selection is known at run time only."""
    frames = found.tools_set if "TOOL" in selected[1].upper() else found.bases_set
    index, value = selected[3] or "", selected[4].strip()
    if not selected[2]:
        which = index if index.isdecimal() else ""
        frames.setdefault(which, f"{selected[1].upper()}[{index}] is set on line {line}")
        return
    word = "UTOOL_NUM" if frames is found.tools_set else "UFRAME_NUM"
    frames.setdefault(_CURRENT, f"{word} is set on line {line}, and it is taught in any")
    if not value.isdecimal():
        frames.setdefault("", f"{word} is known at run time only, from line {line} on")


def _other(found: _Tp, source: Source, one: re.Match[str]) -> None:
    """Process a statement that is no motion: an assignment of points or registers, or a shift."""
    sides = one[1].partition("=")
    if shift := _SHIFTS.match(one[1]):
        found.leave(source, one.start(1), f"{shift[1]} moves the points behind it")
    if _READ.match(one[1]):
        found.account(source, one.start(), one.end(1))
        found.read |= {_number(label) for label in _NAMED.findall(sides[2])}
    elif "=" in one[1] and (set_ := _INDIRECT.match(sides[0].lstrip())):
        found.account(source, one.start(), one.end(1))
        named = _NAMED.match(set_[0])
        found.change(_number(named[1]) if named else "P[?]", source, one.start(1))
    elif not _NAMED.search(one[1]) and not re.match(r"\s*[JLCAS]\s", one[1], re.IGNORECASE):
        found.account(source, one.start(), one.end(1))  # registers alone move nothing


def _move(found: _Tp, source: Source, one: re.Match[str]) -> None:
    """Record the points of a motion."""
    named = [_number(label) for label in _NAMED.findall(one[1])]
    found.named |= {*named}
    line, kind = source.line(one.start(1)), one[1].lstrip()[0].upper()
    why = _computed(one[1] + one[2], named, 2 if kind == "C" else 1)
    if why is not None and why.endswith(_DISTANCE):
        found.following.append((Uncorrected(source.file, line, why), found.last))
        for label in named:
            found.changed.setdefault(label, _DISTANCE)
        return
    _chain(found, kind, line)
    goals = [] if why is None else [Uncorrected(source.file, line, why)]
    shared = named if why is None or kind not in _TO_ONE else ()
    found.move(line, chain(goals, *(_note(found, label, source, line) for label in shared)))


def _chain(found: _Tp, kind: str, line: int) -> None:
    """Begin or end a motion of several statements, given the letter of the next motion."""
    if kind not in _CHAINED:
        found.together = None
    elif kind != found.kind:
        found.begin(line)
    found.kind = kind


def _note(found: _Tp, label: str, source: Source, line: int) -> Iterator[Uncorrected | None]:
    """Record a motion to the points of a number; yield why one cannot be corrected, or None."""
    if label not in found.points:
        yield Uncorrected(source.file, line, f"{label} is not in this program")
    for point in found.points.get(label, []):
        if isinstance(point, Uncorrected):
            yield point
            continue
        found.reached.add(point.place)
        if why := _unsteady(found, point):
            yield Uncorrected(source.file, line, f"{point.name}: {why}")
        else:
            found.note(MotionUse(point, point.tool, point.base))
            yield None


def _unsteady(found: _Tp, point: Target) -> str | None:
    """Why the frames of a point may not be those in which it was taught; None if they are."""
    pairs = [(found.tools_set, point.tool)]
    pairs += [(found.bases_set, point.base)] if point.kind == "cartesian" else []
    whys = (frames.get(name, frames.get("")) for frames, name in pairs)
    return next((why for why in whys if why), None)


def _computed(words: str, named: Sequence[str], count: int) -> str | None:
    """Why a motion to `count` points is known at run time only; None if they are taught points."""
    computed = {one.upper(): one for one in _COMPUTED.findall(words)}
    if "INC" in computed:
        return f"{named[0]} {_DISTANCE}" if named else f"its point {_DISTANCE}"
    if computed:
        return f"{next(iter(computed.values()))} moves the point at run time"
    goals = [one[0] for one in _INDIRECT.finditer(words)][:count]
    registers = [word for word in goals if not _NAMED.match(word)]
    if named and not registers:
        return None
    return f"{registers[0] if registers else 'its point'} is known at run time only"


_DISTANCE = "is a distance"


def _point(source: Source, found: re.Match[str]) -> Target | Uncorrected:
    """A point of /POS, or why it cannot be corrected."""
    name, line = _number(found[1]), source.line(found.start(1))
    start, end = _first_group(source.plain, *found.span(2))
    values = _values(source.plain, start, end)
    joint = "j1" in values
    wanted = _AXES if joint else _POSE
    if missing := [word.upper() for word in wanted if word not in values]:
        return Uncorrected(source.file, line, f"{name} has no {', '.join(missing)}")
    return Target(
        name,
        source.file,
        line,
        "joint" if joint else "cartesian",
        tuple(values[word] for word in wanted),
        tuple(values[word].value for word in _EXTERNAL if word in values),
        **_frames(source.plain[start:end]),
    )


def _first_group(plain: str, start: int, end: int) -> tuple[int, int]:
    """Start and end of the arm's part of a point (group 1); other groups are positioners."""
    groups = list(_GROUP.finditer(plain, start, end))
    first = next((k for k, one in enumerate(groups) if one[1] == "1"), None)
    if first is None:
        return (start, start) if groups else (start, end)
    return groups[first].end(), groups[first + 1].start() if groups[first + 1 :] else end


def _values(plain: str, start: int, end: int) -> dict[str, Number]:
    """Axis values and coordinates by their names in lower case."""
    values = {}
    for one in _VALUE.finditer(plain, start, end):
        if read := number(one.start(2), one[2]):
            values[one[1].lower()] = read
    return values


def _frames(words: str) -> Mapping[str, Any]:
    """Tool, frame and axis ranges of a point."""
    entries = {key.upper(): value.lower() for key, value in _FRAMES.findall(words)}
    turns = _TURNS.search(words)
    ranges: tuple[Range, ...] = ()
    if turns:
        first, fourth, sixth = (_turn(int(k)) for k in turns.groups())
        ranges = (first, None, None, fourth, None, sixth)
    return {"tool": entries.get("UT", ""), "base": entries.get("UF", ""), "ranges": ranges}


def _turn(count: int) -> Range:
    """Range of an axis according to its turn number: 0 is up to half a turn either way."""
    return (2 * count - 1) * np.pi, (2 * count + 1) * np.pi
