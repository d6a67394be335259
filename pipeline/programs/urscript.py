"""URScript: poses p[...] in metres and rotation vectors, lists of six joint values in radians.

    wp = p[-0.412, 0.210, 0.350, 0.0, 3.1416, 0.0]
    movel(wp, a=1.2, v=0.25)
    movej([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])

The tool is that of the set_tcp in force.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.programs._flow import HeldState, ProgramStep, StepKind, holding, interrupted
from pipeline.programs._parser import Lexicon, ParserState, finished
from pipeline.programs._text import ListItem, Source, entries, inner, numbers
from pipeline.programs.notation import UR
from pipeline.programs.program import Program, Target, Uncorrected

SUFFIXES, SIGN = (".script", ".urscript"), "#"
HEADS = dict.fromkeys(SUFFIXES, r"^[ \t]*def\b")

_SILENT = re.compile(r'"[^"\r\n]*"|\'[^\'\r\n]*\'|#[^\r\n]*')
_ASSIGNED = re.compile(
    r"^[ \t]*(?:(?:global|local)[ \t]+)?(\w+)[ \t]*+"
    r"((?:\[[^\[\]\r\n]*\][ \t]*+){0,3})([-+*/%]?)=(?!=)[ \t]*",
    re.MULTILINE,
)
_CALL = re.compile(
    r"(?<![\w.])(movej|movel|movep|movec|servoj|servoc|speedl|speedj|set_tcp)\s*(?=\()"
)
_ARGUMENT = re.compile(r"(?:pose|q|pose_via|pose_to|p)\s*=\s*(?!=)")
_INVERSE = re.compile(r"get_inverse_kin\s*(?=\()")
_TCP = re.compile(r"tcp\w*\s*=")
_PLAIN = 3
"""Maximum number of arguments of get_inverse_kin behind the pose that do not name another tool:
joint values near it, and tolerances."""
_NEAR = re.compile(r"(?:qnear\s*=\s*)?")
_NAMED = re.compile(r"(\w+)\s*(?:\[\s*(\w+)\s*\])?$")
_OPENING, _EOL = re.compile(r"p?\s*\["), re.compile(r"[\r\n]|\Z")
_POINTS = {"movec": 2, "servoc": 1}
_SPEEDS = ("speedl", "speedj")
_ROUTINE = re.compile(r"^[ \t]*(def|thread|sec)[ \t]+(\w+)[ \t]*\(([^()]*)", re.MULTILINE)
_BLOCK = re.compile(
    r"(?<![\w.])(if|elif|else|while|for|switch|case|default|def|thread|sec|end)\b(?!\s*=)"
)
_BLOCKS: dict[str, StepKind] = {
    "if": "open", "switch": "open", "elif": "branch", "case": "branch", "else": "else",
    "default": "else", "while": "loop", "for": "loop", "def": "routine", "thread": "routine",
    "sec": "routine", "end": "close",
}  # fmt: skip
_LEXICON = Lexicon(
    motion=re.compile(
        r"(?<![\w.])((?:opti)?move[jlpc]\w*|movej|movel|servo[a-z]\w*|speed[jl]\w*|mc_\w+|force_mode"
        r"|freedrive_mode|teach_mode|path_offset_\w+|track_conveyor_\w+|screw_driving|jog\w*"
        r"|pathmove\w*|direct_torque)\s*\("
    ),
    literal=re.compile(  # of a pose, or of six values
        r"((?<!\w)p\s*\[|(?<!\w)\[(?=[^\[\]]*\d)[^\[\],]*(?:,[^\[\],]*){5}\])"
    ),
    reading=frozenset(
        {"pose_trans", "pose_inv", "pose_add", "pose_sub", "pose_dist", "point_dist",
         "interpolate_pose", "get_inverse_kin", "get_inverse_kin_has_solution", "get_forward_kin",
         "wrench_trans", "textmsg", "popup", "to_str", "str_cat", "norm", "length", "size",
         "is_within_safety_limits", "set_tcp", "rtde_set_watchdog", "set_payload",
         "set_target_payload", "tool_contact", "get_jacobian"}
    ),
    cased=True,
)  # fmt: skip


@dataclass
class _Script(ParserState):
    """What has been read so far of a script."""

    @property
    def source(self) -> Source:
        """The file."""
        return self.sources[0]


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """Read the points of a script.

    Args:
        file: Name of the file.
        text: Its text.
        other: Not used: a script is a single file.
    """
    source = Source(file, text, _SILENT)
    found = _Script([source], _LEXICON)
    found.bases[""] = np.eye(4)
    _define(found)
    calls = list(_CALL.finditer(source.plain))
    steps = sorted(_steps(found, calls), key=lambda one: one.at)
    if any(one[1] == "thread" for one in _ROUTINE.finditer(source.plain)):
        moves = (one for one in calls if one[1] != "set_tcp")
        steps = interrupted(steps, ((one.start(), source.line(one.start())) for one in moves))
    tool = holding(steps, "", "tool")
    for call in calls:
        _follow(found, call, tool)
    return finished(found, file, text, UR)


def _define(found: _Script) -> None:
    """Record the parameters of routines, and the values of variables."""
    source, behind = found.source, 0
    for routine in _ROUTINE.finditer(source.plain):
        found.account(source, *routine.span())
        for word in re.findall(r"\w+", routine[3]):
            line = source.line(routine.start(1))
            why = f"is given by the caller of the routine in line {line}"
            found.changed.setdefault(word, why)
    for assigned in _ASSIGNED.finditer(source.plain):
        found.account(source, *assigned.span())
        if assigned.start() >= behind:
            behind = _assign(found, assigned)


def _assign(found: _Script, assigned: re.Match[str]) -> int:
    """Record the value assigned to a variable; return where it ends."""
    name, source = assigned[1], found.source
    value = _value(source, assigned.end())
    points = [] if assigned[2] or assigned[3] else list(_points(found, name, value))
    if points and all(isinstance(point, Target) for point in points):
        found.points.setdefault(name, []).extend(points)
    else:
        found.change(name, source, assigned.start(1))
        if found.lexicon.literal.match(source.plain, value.start):
            found.account(source, value.start, value.start + 1)
    return value.end


def _value(source: Source, start: int) -> ListItem:
    """Text behind an equals sign: a list over several lines, or the rest of the line."""
    plain = source.plain
    opening = _OPENING.match(plain, start)
    last = source.closing.get(opening.end() - 1) if opening else None
    end = _EOL.search(plain, start if last is None else last)
    text = plain[start : end.start() if end else len(plain)]
    return ListItem(start, start + len(text), text.rstrip())


def _points(
    found: _Script, name: str, value: ListItem, several: bool = True
) -> Iterator[Target | Uncorrected]:
    """The points of a value, several if it is a list of them, or why one cannot be corrected."""
    source, pose = found.source, value.text.startswith("p")
    shift = len(value.text) - len(value.text[1:].lstrip()) if pose else 0
    listed = ListItem(value.start + shift, value.end, value.text[shift:])
    parts = inner(source, listed)
    own = numbers(parts)
    line = source.line(value.start)
    if own is not None and len(own) == 6:
        kind = "cartesian" if pose else "joint"
        found.account(source, value.start, value.start + 1)
        yield Target(name, source.file, line, kind, own)  # type: ignore[arg-type]
    elif several and parts and not pose and parts[0].text.startswith(("p", "[")):
        for k, part in enumerate(parts):
            yield from _points(found, f"{name}[{k}]", part, several=False)
    else:
        yield Uncorrected(source.file, line, f"{name} is computed at run time")


def _steps(found: _Script, calls: Sequence[re.Match[str]]) -> Iterator[ProgramStep]:
    """Steps that set the tool, and those of the control flow."""
    source = found.source
    words = list(_BLOCK.finditer(source.plain))
    count = Counter(_BLOCKS[one[1]] for one in words)
    own = count["close"] > count["open"] + count["loop"] + count["routine"]  # each case has its end
    for one in words:
        kind = "open" if own and one[1] in ("case", "default") else _BLOCKS[one[1]]
        yield ProgramStep(one.start(1), kind, source.line(one.start(1)))
    for call in calls:
        if call[1] == "set_tcp":
            line = source.line(call.start())
            yield ProgramStep(call.start(), "set", line, _tool(found, call, line))
    names = {one[2] for one in _ROUTINE.finditer(source.plain)}
    for called in re.finditer(r"(?<!\w)(?<!def )(?<!thread )(\w++)\s*+\(", source.plain):
        if called[1] in names:
            yield ProgramStep(called.start(), "call", source.line(called.start()))


def _arguments(found: _Script, call: re.Match[str]) -> list[ListItem] | None:
    """Arguments of a call; None if its brackets are not closed."""
    last = found.source.closing.get(call.end())
    return None if last is None else entries(found.source.plain, call.end() + 1, last)


def _follow(found: _Script, call: re.Match[str], tool: Callable[[int], HeldState]) -> None:
    """Process a call in execution order: record the targets of a motion."""
    source, name = found.source, call[1]
    given = _arguments(found, call)
    found.account(source, call.start(), call.end() if given is None else given[-1].end + 1)
    if name in _SPEEDS:
        found.leave(source, call.start(), f"{name} has a speed and no target")
    elif given is None:
        found.leave(source, call.start(), f"{name} has no end")
    elif name != "set_tcp":
        now = tool(given[-1].end)
        goals = (
            found.stays(one.start, _use(found, one, now)) for one in given[: _POINTS.get(name, 1)]
        )
        found.move(source.line(call.start()), goals)


def _tool(found: _Script, call: re.Match[str], line: int) -> str:
    """Name of the tool that is set; the tool is stored if known."""
    name = f"line {line}"
    given = _arguments(found, call) or [ListItem(call.end(), call.end(), "")]
    argument = _without(given[0], _ARGUMENT)
    points = found.points.get(argument.text, []) if argument.text not in found.changed else []
    if not points:
        points = list(_points(found, "tool", argument))
    else:
        found.framed.add(argument.text)
    if len(points) == 1 and isinstance(points[0], Target) and points[0].kind == "cartesian":
        found.tools[name] = UR.frame(points[0].values)
    return name


def _use(found: _Script, entry: ListItem, tool: HeldState) -> str | None:
    """Record a motion to a point; return why it cannot be corrected, or None."""
    entry, near = _inside(found, _without(entry, _ARGUMENT))
    points: Sequence[Target | Uncorrected]
    if entry.text.startswith("[") or re.match(r"p\s*\[", entry.text):
        points = list(_points(found, f"the target in line {found.source.line(entry.start)}", entry))
    elif named := _NAMED.match(entry.text):
        points = found.of_name(named[1], named[2])
    else:
        return f"{entry.text} is computed at run time"
    if not points:
        return f"{entry.text} is computed at run time"
    stated = [one if isinstance(one, Uncorrected) else replace(one, near=near) for one in points]
    return found.use(stated, tool, "")


def _without(entry: ListItem, prefix: re.Pattern[str]) -> ListItem:
    """An argument without its keyword."""
    named = prefix.match(entry.text)
    if named is None:
        return entry
    return ListItem(entry.start + named.end(), entry.end, entry.text[named.end() :])


def _inside(found: _Script, entry: ListItem) -> tuple[ListItem, tuple[float, ...]]:
    """The pose within get_inverse_kin(pose, qnear), and the joint values near it."""
    source, call = found.source, _INVERSE.match(entry.text)
    if call is None:
        return entry, ()
    start = entry.start + call.end()
    last = source.closing.get(start)
    if last is None or last + 1 != entry.start + len(entry.text):
        return entry, ()
    first, *more = entries(source.plain, start + 1, last)
    if any(_TCP.match(one.text) for one in more) or len(more) > _PLAIN:
        return entry, ()
    near: tuple[float, ...] = ()
    for other in more[:1]:
        arguments = _without(other, _NEAR)
        points = found.points.get(arguments.text, []) or list(_points(found, "", arguments))
        found.named.add(arguments.text)
        near = next((p.values for p in points if isinstance(p, Target)), ())
    return _without(first, _ARGUMENT), near
