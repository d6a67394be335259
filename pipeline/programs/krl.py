"""KUKA KRL: motions in .src, points beside them or in the .dat of the same name.

    DECL E6POS XP1={X 1200.0,Y 0.0,Z 800.0,A 0.0,B 90.0,C 0.0,S 2,T 10,E1 350.0}
    PTP XP1
    LIN {X 1250.0,Y 0.0,Z 800.0,A 0.0,B 90.0,C 0.0} C_DIS

Frames and tools are those in force where a motion stands in the text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot.inverse import Range
from pipeline.programs._text import Entry, Source, closing, entries
from pipeline.programs.notation import KUKA
from pipeline.programs.program import (
    NUMBER,
    Left,
    Number,
    Program,
    Target,
    Use,
    changed,
    gathered,
    number,
)

SUFFIXES = (".src", ".dat")

_SILENT = re.compile(r'"[^"\r\n]*"|;[^\r\n]*|^&[^\r\n]*', re.MULTILINE)
_POSE, _AXES = ("x", "y", "z", "a", "b", "c"), ("a1", "a2", "a3", "a4", "a5", "a6")
_ASSIGNED = re.compile(
    r"\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:(\w+)\s+)?(\$?\w+(?:\s*\[\s*\d+\s*\])?)\s*=(?!=)\s*(.*)",
    re.IGNORECASE,
)
_PART = re.compile(r"\s*(\$?\w+(?:\s*\[\s*\w+\s*\])?)\s*\.\s*\w+\s*=(?!=)")
_MOTION = re.compile(
    r"\s*(S?(?:PTP|LIN|CIRC)|SPL)(_REL)?(?![\w=])\s*(?!=)(.*)", re.IGNORECASE | re.DOTALL
)
_POINT = re.compile(
    r"(\{[^{}]*\}|\w+(?:\s*\[\s*\w+\s*\])?)\s*(?:C_\w+.*|WITH\b.*)?", re.IGNORECASE | re.DOTALL
)
_COMPONENT = re.compile(rf"([A-Za-z]\w*)\s+(?:({NUMBER})|'B([01]+)'|'H([0-9A-F]+)')", re.IGNORECASE)
_BAS = re.compile(r"\s*BAS\s*\(\s*#(BASE|TOOL)\s*,\s*(\d+)\s*\)", re.IGNORECASE)
_NUMBERED = re.compile(r"(?:TOOL|BASE)_DATA\[(\d+)\]")
_LINE_SAID = re.compile(r"(TOOL_NO|BASE_NO)\s+(\d+)", re.IGNORECASE)
_OUTSIDE = re.compile(r"#TCP\b", re.IGNORECASE)
_NULL = ("$nullframe", "$world")


@dataclass(frozen=True)
class _Aggregate:
    """What stands between braces, by the names of its components in small letters.

    Attributes:
        source: The file.
        start: Its opening brace.
        numbers: Its components that are numbers.
        complete: All of them are.
        kind: The word of its declaration, in small letters.
    """

    source: Source
    start: int
    numbers: Mapping[str, Number]
    complete: bool
    kind: str = ""

    def target(self, name: str) -> Target | str:
        """The point that it is, or why it is none that can be corrected."""
        joint = "a1" in self.numbers
        wanted = _AXES if joint else _POSE
        if not self.complete:
            return f"{name} is computed at run time"
        if missing := [word.upper() for word in wanted if word not in self.numbers]:
            return f"{name} has no {', '.join(missing)} of its own"
        return Target(
            name,
            self.source.file,
            self.source.line(self.start),
            "joint" if joint else "cartesian",
            tuple(self.numbers[word] for word in wanted),
            tuple(self.numbers[f"e{k}"].value for k in range(1, 7) if f"e{k}" in self.numbers),
            ranges=self._ranges(),
        )

    def _ranges(self) -> tuple[Range, ...]:
        """What T says of the axes: bit k is set where axis k + 1 is below zero."""
        if "t" not in self.numbers:
            return ()
        turn = int(self.numbers["t"].value)
        return tuple((-np.inf, 0.0) if turn >> k & 1 else (0.0, np.inf) for k in range(6))

    @property
    def frame(self) -> Array | None:
        """The frame that it is."""
        known = self.complete and all(word in self.numbers for word in _POSE)
        return KUKA.frame([self.numbers[word].value for word in _POSE]) if known else None


@dataclass
class _Reading:
    """What was read so far."""

    points: dict[str, list[_Aggregate]] = field(default_factory=dict)
    computed: dict[str, int] = field(default_factory=dict)
    lines: dict[str, dict[str, str]] = field(default_factory=dict)
    uses: list[Use] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    tools: dict[str, Array] = field(default_factory=dict)
    bases: dict[str, Array] = field(default_factory=dict)
    tool: str = ""
    base: str = ""
    outside: bool = False


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """The points of a program.

    Without its other file all points of a .dat are taken for targets.

    Args:
        file: Name of the file to be corrected.
        text: Its text.
        other: Name and text of its .src or .dat, where there is one.
    """
    both = [(file, text), *([other] if other else [])]
    both.sort(key=lambda one: not one[0].lower().endswith(".dat"))
    sources = [Source(name, one, _SILENT) for name, one in both]
    found = _followed(sources)
    points = {
        name: [one.target(name.upper()) for one in several]
        for name, several in found.points.items()
    }
    if all(source.file.lower().endswith(".dat") for source in sources):
        found.uses = [Use(target, "", "") for target in _all(found, points)]
    targets, left = gathered(found.uses, changed(points, found.computed))
    return Program(
        file,
        text,
        KUKA,
        tuple(targets),
        tuple(one for one in sorted({*found.left, *left}) if one.file == file),
        found.tools,
        found.bases,
    )


def _followed(sources: Sequence[Source]) -> _Reading:
    """What is declared anywhere, then what the motions do with it."""
    found = _Reading()
    for source in sources:
        _define(found, source)
    for source in sources:
        for start, line in source.lines:
            _follow(found, source, start, line)
    return found


def _all(found: _Reading, points: Mapping[str, Sequence[Target | str]]) -> Iterator[Target]:
    """Every point but frames."""
    for name, several in found.points.items():
        for point, target in zip(several, points[name], strict=True):
            if isinstance(target, Target) and point.kind != "frame":
                yield target


def _define(found: _Reading, source: Source) -> None:
    """Points, frames and the data of inline forms, wherever they are declared."""
    for start, line in source.lines:
        if part := _PART.match(line):
            found.computed[_key(part[1])] = source.line(start)
        elif (assigned := _ASSIGNED.match(line)) and not assigned[2].startswith("$"):
            _declare(found, source, start, assigned)


def _declare(found: _Reading, source: Source, start: int, assigned: re.Match[str]) -> None:
    """What a name that is no variable of the system is set to."""
    kind, key, value = (assigned[1] or "").lower(), _key(assigned[2]), assigned[3]
    aggregate = _aggregate(source, start + assigned.start(3), value)
    if kind == "fdat":
        found.lines[key] = {k.lower(): n for k, n in _LINE_SAID.findall(value)}
        found.lines[key] |= {"outside": "#"} if _OUTSIDE.search(value) else {}
    elif aggregate is None:
        found.computed[key] = source.line(start)
    elif numbered := _NUMBERED.fullmatch(key.upper()):
        frames = found.tools if key.startswith("tool") else found.bases
        _keep(frames, numbered[1], aggregate)
    else:
        found.points.setdefault(key, []).append(replace(aggregate, kind=kind))


def _keep(frames: dict[str, Array], name: str, aggregate: _Aggregate) -> None:
    if (frame := aggregate.frame) is not None:
        frames[name] = frame


def _key(name: str) -> str:
    return re.sub(r"\s", "", name).lower()


def _aggregate(source: Source, start: int, value: str) -> _Aggregate | None:
    """What stands in braces at `start`; None where nothing does."""
    if not value.startswith("{"):
        return None
    last = closing(source.plain, start)
    if last is None:
        return None
    first = start + 1
    if named := re.compile(r"\s*\w+\s*:").match(source.plain, first, last):
        first = named.end()
    parts = [_component(entry) for entry in entries(source.plain, first, last)]
    known = [part for part in parts if part is not None]
    return _Aggregate(source, start, dict(known), len(known) == len(parts))


def _component(entry: Entry) -> tuple[str, Number] | None:
    """A component by its name in small letters; None where its value is no number."""
    part = _COMPONENT.fullmatch(entry.text)
    if part is None:
        return None
    name, decimal, binary, hexadecimal = part.groups()
    if decimal:
        read = number(entry.start + part.start(2), decimal)
    else:
        bits = int(binary, 2) if binary else int(hexadecimal, 16)
        read = Number(entry.start, entry.end, float(bits))
    return None if read is None else (name.lower(), read)


def _follow(found: _Reading, source: Source, start: int, line: str) -> None:
    """A line as the robot carries it out: another frame or tool, or a motion."""
    if bas := _BAS.match(line):
        _set(found, bas[1].lower(), bas[2])
    elif motion := _MOTION.match(line):
        _move(found, source, start + motion.start(3), motion)
    elif (part := _PART.match(line)) and part[1].lower() in ("$tool", "$base"):
        _set(found, part[1][1:].lower(), f"line {source.line(start)}")
    elif assigned := _ASSIGNED.match(line):
        name, value = assigned[2].lower(), assigned[3]
        if name in ("$tool", "$base"):
            _set(found, name[1:], _frame(found, source, start + assigned.start(3), name, value))
        elif name == "fdat_act":
            said = found.lines.get(_key(value), {})
            found.outside = "outside" in said
            _set(found, "tool", said.get("tool_no", ""))
            _set(found, "base", said.get("base_no", ""))
        elif name == "$ipo_mode":
            found.outside = bool(_OUTSIDE.search(value))


def _set(found: _Reading, which: str, name: str) -> None:
    if name == "0":
        frames = found.tools if which == "tool" else found.bases
        frames["0"] = np.eye(4)
    setattr(found, which, name)


def _frame(found: _Reading, source: Source, start: int, name: str, value: str) -> str:
    """What the frame is called that is assigned to $TOOL or $BASE; it is kept if it is known."""
    key = _key(value)
    if key in _NULL:
        return "0"
    if numbered := _NUMBERED.fullmatch(key.upper()):
        return numbered[1]
    frames = found.tools if name == "$tool" else found.bases
    aggregate = _aggregate(source, start, value)
    if aggregate is not None:
        key = f"line {source.line(start)}"
        _keep(frames, key, aggregate)
    elif len(known := found.points.get(key, [])) == 1 and key not in found.computed:
        _keep(frames, key, known[0])
    return key


def _move(found: _Reading, source: Source, start: int, motion: re.Match[str]) -> None:
    """The points of a motion."""
    line = source.line(start)
    kind = motion[1].upper()
    count = 2 if "CIRC" in kind else 1
    for entry in entries(source.plain, start, start + len(motion[3].rstrip()))[:count]:
        point = _POINT.fullmatch(entry.text)
        why = None
        if motion[2]:
            why = f"{kind}{motion[2].upper()} moves by a distance"
        elif point is None:
            why = f"{entry.text} is computed at run time"
        elif found.outside:
            why = f"{point[1]} moves the workpiece at a fixed tool"
        else:
            why = _use(found, source, entry.start, point[1], "PTP" in kind)
        if why:
            found.left.append(Left(source.file, line, why))


def _use(found: _Reading, source: Source, start: int, word: str, by_axes: bool) -> str | None:
    """Note a motion to a point; why not, where it cannot be corrected.

    S and T of a point hold for PTP; other motions keep the configuration that they come from.
    """
    if word.startswith("{"):
        inline = _aggregate(source, start, word)
        points: Sequence[_Aggregate] = [] if inline is None else [inline]
        name = f"the target in line {source.line(start)}"
    else:
        points, name = _named(found, word), word
    if not points:
        return f"{word} is not in this program"
    for point in points:
        target = point.target(name)
        if isinstance(target, str):
            return target
        stated = target if by_axes or not found.uses else replace(target, ranges=())
        found.uses.append(Use(stated, found.tool, found.base))
    return None


def _named(found: _Reading, word: str) -> Sequence[_Aggregate]:
    """The points of a name; all elements of an array where the index is computed."""
    key = _key(word)
    if key in found.points or not key.endswith("]"):
        return found.points.get(key, [])
    array = key.partition("[")[0] + "["
    return [one for name, all_ in found.points.items() if name.startswith(array) for one in all_]
