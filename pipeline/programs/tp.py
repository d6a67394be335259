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

The frames are numbers; what they are, only the controller knows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.machine.robot.inverse import Range
from pipeline.programs._text import Source
from pipeline.programs.notation import FANUC
from pipeline.programs.program import NUMBER, Left, Number, Program, Target, number

SUFFIXES = (".ls",)

_SILENT = re.compile(r"^[ \t]*\d+[ \t]*:[ \t]*(?:!|//)[^\r\n]*", re.MULTILINE)
_POSITIONS = re.compile(r"^/POS\b", re.MULTILINE | re.IGNORECASE)
_MOTIONS = re.compile(r"^/MN\b", re.MULTILINE | re.IGNORECASE)
_POINT = re.compile(r"^\s*P\s*\[\s*(\d+)[^\]\r\n]*\]\s*\{(.*?)\}", re.M | re.DOTALL | re.IGNORECASE)
_GROUP = re.compile(r"GP1\s*:(.*?)(?=GP\d+\s*:|\Z)", re.DOTALL | re.IGNORECASE)
_FRAMES = re.compile(r"\b(UF|UT)\s*:\s*(\w+)", re.IGNORECASE)
_VALUE = re.compile(rf"\b([XYZWPR]|[JE]\d)\s*=\s*({NUMBER})\s*(mm|deg)\b", re.IGNORECASE)
_TURNS = re.compile(r"CONFIG\s*:\s*'[^',]*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)", re.IGNORECASE)
_STATEMENT = re.compile(r"^[ \t]*\d+[ \t]*:([^;]*);", re.MULTILINE)
_MOTION = re.compile(r"\s*([JLCA])\s+(?=@?PR?\s*\[)", re.IGNORECASE)
_NAMED = re.compile(r"(?<!\w)P\s*\[\s*(\d+)", re.IGNORECASE)
_INDIRECT = re.compile(r"(?<!\w)PR?\s*\[(?:[^\[\]]|\[[^\]]*\])*\]", re.IGNORECASE)
_COMPUTED = re.compile(r"\b(Tool_Offset|Offset|VOFFSET|PTH_OFFSET|INC)\b", re.IGNORECASE)
_POSE, _AXES = ("x", "y", "z", "w", "p", "r"), tuple(f"j{k}" for k in range(1, 7))
_EXTERNAL = tuple(f"e{k}" for k in range(1, 10))


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """The points of a program.

    Args:
        file: Its name.
        text: Its text.
        other: Nothing: a program stands alone.
    """
    source = Source(file, text, _SILENT)
    positions = _POSITIONS.search(source.plain)
    end = positions.start() if positions else len(text)
    points = {int(found[1]): _point(source, found) for found in _POINT.finditer(source.plain, end)}
    order, left, moved = _motions(source, end)
    order = order or ([] if left else list(points))  # without motions all are meant
    targets = []
    for label in dict.fromkeys(order):
        point = points.get(label)
        if label in moved:
            left.append(moved[label])
        elif isinstance(point, Target):
            targets.append(point)
        elif point is not None:
            left.append(point)
    frames = {"0": np.eye(4)}
    return Program(file, text, FANUC, tuple(targets), tuple(sorted({*left})), frames, frames)


def _motions(source: Source, end: int) -> tuple[list[int], list[Left], dict[int, Left]]:
    """Points in the order of the motions; what is not corrected; points that are no places."""
    first = _MOTIONS.search(source.plain)
    order: list[int] = []
    left: list[Left] = []
    moved: dict[int, Left] = {}
    for found in _STATEMENT.finditer(source.plain, first.end() if first else 0, end):
        if _MOTION.match(found[1]):
            named = [int(number) for number in _NAMED.findall(found[1])]
            why = _computed(found[1], named)
            if why is None:
                order += named
                continue
            left.append(Left(source.file, source.line(found.start(1)), why))
            if why.endswith(_DISTANCE):
                moved |= dict.fromkeys(named, left[-1])
    return order, left, moved


def _computed(words: str, named: Sequence[int]) -> str | None:
    """Why the point of a motion is known at run time only; None where it is taught."""
    computed = _COMPUTED.search(words)
    if computed and computed[1].upper() == "INC":
        return f"P[{named[0]}] {_DISTANCE}" if named else f"its point {_DISTANCE}"
    if computed:
        return f"{computed[1]} moves the point at run time"
    if named:
        return None
    word = _INDIRECT.search(words)
    return f"{word[0] if word else 'its point'} is known at run time only"


_DISTANCE = "is a distance"


def _point(source: Source, found: re.Match[str]) -> Target | Left:
    """A point of /POS; why not, where it cannot be corrected."""
    name, line = f"P[{found[1]}]", source.line(found.start(1))
    start, end = _first_group(source.plain, *found.span(2))
    values = _values(source.plain, start, end)
    joint = "j1" in values
    wanted = _AXES if joint else _POSE
    if missing := [word.upper() for word in wanted if word not in values]:
        return Left(source.file, line, f"{name} has no {', '.join(missing)}")
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
    """Where the arm's part of a point begins and ends; the others are of positioners."""
    group = _GROUP.search(plain, start, end)
    return group.span(1) if group else (start, end)


def _values(plain: str, start: int, end: int) -> dict[str, Number]:
    """Axes and coordinates by their names in small letters."""
    values = {}
    for one in _VALUE.finditer(plain, start, end):
        if read := number(one.start(2), one[2]):
            values[one[1].lower()] = read
    return values


def _frames(words: str) -> Mapping[str, Any]:
    """Tool, frame and turns of a point."""
    said = {key.upper(): value.lower() for key, value in _FRAMES.findall(words)}
    turns = _TURNS.search(words)
    ranges: tuple[Range, ...] = ()
    if turns:
        first, fourth, sixth = (_turn(int(k)) for k in turns.groups())
        ranges = (first, None, None, fourth, None, sixth)
    return {"tool": said.get("UT", ""), "base": said.get("UF", ""), "ranges": ranges}


def _turn(count: int) -> Range:
    """What a turn number says of its axis: 0 is up to half a turn either way."""
    return (2 * count - 1) * np.pi, (2 * count + 1) * np.pi
