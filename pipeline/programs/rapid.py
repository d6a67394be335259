r"""ABB RAPID: points declared, assigned or written in the motion instructions.

    CONST robtarget p10:=[[1200,0,800],[0,0,1,0],[0,0,-1,0],[350,9E9,9E9,9E9,9E9,9E9]];
    MoveL p10,v100,z10,tGripper\WObj:=wobj1;

The tool and the frame of a point are those of the motions to it.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import dropwhile

import numpy as np

from pipeline.base.arrays import Array
from pipeline.programs._flow import (
    HeldState,
    ProgramStep,
    StepKind,
    UnknownState,
    holding,
    interrupted,
)
from pipeline.programs._parser import Lexicon, ParserState, finished
from pipeline.programs._text import ListItem, Source, entries, inner, numbers
from pipeline.programs.inverse import Range
from pipeline.programs.notation import ABB
from pipeline.programs.program import MotionUse, Number, Program, Target, Uncorrected

SUFFIXES, SIGN = (".mod", ".modx", ".prg"), "!"
HEADS = dict.fromkeys(SUFFIXES, r"^[ \t]*MODULE\b(?!.*\bENDMODULE\b)")

_SILENT = re.compile(r'"(?:[^"\r\n]|"")*"|![^\r\n]*')
_DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*+(\{[^{};]*\})?\s*+:=\s*", re.IGNORECASE
)
_ASSIGNED = re.compile(
    r"(?<![\\\w.])(?<!\\\s)(\w++)(?:\s*+(\{[^{};]*\}))?((?:\s*+\.\s*+\w++){0,8}+)\s*+:=\s*"
)
_ROUTINE = re.compile(
    r"(?<![\w\\])(?:PROC|TRAP|FUNC\s+\w+)\s+(\w+)(?:\s*\(([^()]*)\))?", re.IGNORECASE
)
_KNOWN = (
    r"(?:(?:EGM)?Move|Trigg|Search|Arc|ArcMove|SpotM?|Disp|Paint|Cap|FCPress\d?|Contact|Nut|Stud|Glue"
    r"|Laser|Cut)(?:AbsJ|ExtJ|PnP|[LJC])(?:Start|End|DO|AO|GO|Sync|IOs|\d)*"
    r"|EGMRun(?:Joint|Pose)|Ind[ACDR]Move|StepBwdPath|PathRecMove(?:Bwd|Fwd)|Conf[LJ]|(?:PDisp|EOffs)(?:On|Set|Off)"
)
_LIKELY = r"(?:Move|EGM|Trigg|Search|(?:Arc|Spot|Disp|Paint|Cap)[LJC]|PDisp|EOffs|FC)\w*+"
_MOTION = re.compile(
    rf"(?<![\w\\.%$])({_KNOWN})(?!\w|\s*(?:\(|:=))"
    rf"|(?:^|;|:(?!=)|\b(?:THEN|DO|ELSE|ENDIF|ENDFOR|ENDWHILE|ENDTEST)\b)[ \t]*({_LIKELY})"
    r"(?!\s*(?:\(|:=))",
    re.IGNORECASE | re.MULTILINE,
)
_LIST = r"\[[^\[\]]*\]\s*"
_SIX = r"\[(?:[^\[\],]*,){5}[^\[\],]*\]\s*"
_LEXICON = Lexicon(
    motion=re.compile(
        rf"{_MOTION.pattern}|,\s*(fine|z(?:0|1|5|1?[05]0|15|[2468]0|[1-3]00|vmax)|v(?:5|[1-8]0|1?[05]0"
        r"|[1-8]00|[1-7][05]00|max))\s*[,;\\]",
        re.IGNORECASE | re.MULTILINE,
    ),
    literal=re.compile(
        rf"(\[\s*{_LIST},\s*{_LIST},\s*{_LIST},\s*{_LIST}\]|\[\s*{_SIX},\s*{_SIX}\])"
    ),
    reading=frozenset(
        {"offs", "reltool", "calcjointt", "distance", "isrobtargetclose", "orientzyx", "eulerzyx",
         "crobt", "cjointt", "defframe", "defdframe", "posemult", "poseinv", "dim", "dotprod"}
    ),
    end=";",
    statements=True,
)  # fmt: skip
_WORD = re.compile(r"(\w+)\s*(?:\\.*)?", re.DOTALL)
_POINT = re.compile(r"(\w+)\s*(?:\{\s*(\w+)\s*\})?$")
_SWITCHES = re.compile(r"(?<!\s)(?:\s*\\\s*\w+(?:\s*:=\s*[^\\,]+)?)+$")
_WOBJ = re.compile(r"\\\s*WObj\s*(?::=)?\s*([^\\,]*)", re.IGNORECASE)
_BY_NAME = re.compile(r"(?<![\w\\.])Set(?:All)?DataVal\b", re.IGNORECASE)
"""Matches what sets data whose name is given as a string."""
_UNUSED = 1e9
"""Value from which an external axis is unused: RAPID writes 9E9."""

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
"""Indices of the arguments of a motion that are points, and of the one that is the tool."""
_NO_MOTION = re.compile(r"trigg(?:checkio|data\w+|equip|int|io|rampao|speed|stopproc)")
"""Matches instructions that only prepare a motion."""
_FRAMES = ("tooldata", "wobjdata")
_MORE = ("do", "sync")
"""Endings of motions that may have two more arguments after the tool."""
_SEARCH = ("searchl", "searchc")
"""Motions that write the position found into their second argument."""
_DISPLACED = {
    "pdispset": "on", "pdispon": "on", "eoffsset": "on", "eoffson": "on",
    "pdispoff": "", "eoffsoff": "",
}  # fmt: skip
_CHECKED = ("confl", "confj")
"""Instructions that switch the checking of configurations, for linear and for other motions."""
_BY_AXES = ("movej", "triggj")
_BLOCKS: dict[str, StepKind] = {
    "if": "open", "test": "open", "for": "loop", "while": "loop", "proc": "routine",
    "func": "routine", "trap": "routine", "elseif": "branch", "case": "branch", "else": "else",
    "default": "else", "endif": "close", "endtest": "close", "endfor": "close",
    "endwhile": "close", "endproc": "close", "endfunc": "close", "endtrap": "close",
    "error": "routine", "undo": "routine", "backward": "routine",
}  # fmt: skip
_HANDLERS = ("error", "undo", "backward")
"""Parts at the end of a routine that run when something happens in it; RETRY goes back."""
_ASIDE = re.compile(r"(?:TRAP|ERROR|UNDO|BACKWARD)\b", re.IGNORECASE)
_ENDS = ("endproc", "endfunc", "endtrap")
_TOKEN = re.compile(r"(?<![\w.\\])(\w++)(\s*+:(?!=))?|;|%%++[^%;]*+%%++|%[^%;]*+%")
_HEAD = "%%"
"""How the head of a file begins and ends."""
_NAME = re.compile(r'%\s*+"((?:[^"\r\n]|"")*)"\s*+(%)?')
"""What the name of a routine begins with that is called by a string; all of it before a `%`."""


@dataclass
class _Rapid(ParserState):
    """A module as far as it was read.

    Attributes:
        routines: Names of its routines.
        ends: Indices of the ends of statements.
        unchecked: Instructions of `_CHECKED` that switched the checking off.
    """

    routines: set[str] = field(default_factory=set)
    ends: list[int] = field(default_factory=list)
    unchecked: set[str] = field(default_factory=set)

    @property
    def source(self) -> Source:
        """The file."""
        return self.sources[0]

    def check(self, word: str, on: bool) -> None:
        """Switch the checking of configurations on or off from here on."""
        self.unchecked.discard(word)
        if not on:
            self.unchecked.add(word)

    def checks(self, word: str) -> bool:
        """Whether configurations are checked."""
        return word not in self.unchecked

    def end(self, start: int) -> int:
        """Index of the end of a statement; `start` if it has no end."""
        k = bisect_left(self.ends, start)
        return self.ends[k] if k < len(self.ends) else start


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """Points of a module.

    Args:
        file: Name of the file.
        text: Text of the file.
        other: Not used: a module has no companion file.
    """
    source = Source(file, text, _SILENT)
    found = _Rapid([source], _LEXICON)
    found.tools["tool0"] = found.bases["wobj0"] = np.eye(4)
    found.ends = [one.start() for one in re.finditer(";", source.plain)]
    _define(found)
    _carry_out(found)
    if not (found.uses or found.left):  # a module of data only
        found.named |= {*found.points}
        points = (one for all_ in found.points.values() for one in all_)
        found.uses = [MotionUse(one, "", "") for one in points if isinstance(one, Target)]
    return finished(found, file, text, ABB)


def _carry_out(found: _Rapid) -> None:
    """Process the motions of the module, each with the displacement in force."""
    source = found.source
    motions = list(_MOTION.finditer(source.plain))
    steps = list(_steps(found))
    if _aside(source.plain, steps):
        places = (one.start(one.lastindex or 0) for one in motions)
        steps = interrupted(steps, ((at, source.line(at)) for at in places))
    displaced = holding(steps, "", "displacement")
    nexts = [*(one.start() for one in motions[1:]), len(source.plain)]
    for motion, following in zip(motions, nexts, strict=False):
        _follow(found, motion, following, displaced)


def _aside(plain: str, steps: Sequence[ProgramStep]) -> bool:
    """Whether a TRAP or a handler may displace points: it runs while any motion is under way."""
    inside = False
    for step in steps:
        if step.kind == "routine":
            inside = _ASIDE.match(plain, step.at) is not None
        elif inside and step.kind in ("set", "call"):
            return True
    return False


def _routines(found: _Rapid) -> None:
    """Record the routines of a program; the values of their parameters are unknown."""
    for routine in _ROUTINE.finditer(found.source.plain):
        found.routines.add(routine[1].lower())
        found.account(found.source, *routine.span())
        line = found.source.line(routine.start())
        why = f"is given by the caller of the routine in line {line}"
        for word in re.findall(r"\w+", routine[2] or ""):
            found.changed.setdefault(word.lower(), why)


def _define(found: _Rapid) -> None:
    """Record points and frames, and the assignments of the program to them."""
    plain, declared, behind = found.source.plain, set(), 0
    _routines(found)
    for one in _DECLARED.finditer(plain):
        declared.add(one.start(2))
        found.account(found.source, *one.span(2))
        if one.start() >= behind:
            behind = _declare(found, one)
    behind = 0
    for one in _ASSIGNED.finditer(plain):
        if one.start(1) not in declared and one.start() >= behind:
            behind = _assign(found, one)
    if by_name := _BY_NAME.search(plain):
        why = f"may be set by {by_name[0]} on line {found.source.line(by_name.start())}"
        for name in found.points:
            found.unsettle(name, why)


def _literal(found: _Rapid, start: int) -> ListItem | None:
    """List that begins at an index, if the statement ends with it; otherwise None."""
    last = found.source.closing.get(start)
    plain = found.source.plain
    if last is None or plain[start] != "[" or plain[last + 1 : found.end(last)].strip():
        return None
    return ListItem(start, last + 1, plain[start : last + 1])


def _declare_frame(
    found: _Rapid, kind: str, name: str, value: ListItem | None, again: bool
) -> None:
    """Record a tool or a work object; one that is declared more than once is unknown."""
    frames = found.tools if kind == "tooldata" else found.bases
    frame, why = _framed(found.source, kind, value)
    if name in frames or again:
        why = "is declared more than once"
    if frame is not None:
        frames[name] = frame
    if why:
        found.changed.setdefault(name, why)


def _declare(found: _Rapid, one: re.Match[str]) -> int:
    """Record a declared point or frame; return the index of the end of its value."""
    kind, name = one[1].lower(), one[2].lower()
    value = _literal(found, one.end())
    end = one.end() if value is None else value.end
    if kind in ("robtarget", "jointtarget"):
        if value is None:
            found.change(name, found.source, one.start(2))
        else:
            found.points.setdefault(name, []).extend(_points(found, one[2], [value]))
    elif kind in _FRAMES:
        _declare_frame(found, kind, name, value, bool(one[3]))
    elif value is not None:
        found.enclose(name, found.source, value.start, value.end)
    return end


def _assign(found: _Rapid, one: re.Match[str]) -> int:
    """Record an assignment to a point, a part of one or a frame; return the index of its end."""
    name = one[1].lower()
    found.account(found.source, *one.span(1))
    value = None if one[2] or one[3] else _literal(found, one.end())
    points = [] if value is None else list(_points(found, one[1], [value]))
    if value is not None and points and all(isinstance(point, Target) for point in points):
        found.points.setdefault(name, []).extend(points)
        return value.end
    found.change(name, found.source, one.start(1))
    return one.end()


def _points(
    found: _Rapid, name: str, value: Sequence[ListItem], dimensions: int = 3
) -> Iterator[Target | Uncorrected]:
    """Yield the points of a value, several for an array, or why one cannot be corrected."""
    for entry in value:
        line = found.source.line(entry.start)
        parts = inner(found.source, entry)
        if parts is None:
            yield Uncorrected(found.source.file, line, f"{name} is computed at run time")
            continue
        deeper = inner(found.source, parts[0])
        if dimensions and deeper and inner(found.source, deeper[0]) is not None:  # an array
            for k, one in enumerate(parts, 1):
                yield from _points(found, f"{name}{{{k}}}", [one], dimensions - 1)
        else:
            found.account(found.source, entry.start, entry.end)
            yield _point(found, name, entry, parts)


def _point(
    found: _Rapid, name: str, entry: ListItem, parts: Sequence[ListItem]
) -> Target | Uncorrected:
    """Point of a robtarget (four lists) or a jointtarget (two lists)."""
    read = [numbers(inner(found.source, part)) or () for part in parts]
    place = name, found.source.file, found.source.line(entry.start)
    external = tuple(n.value for n in read[-1] if abs(n.value) < _UNUSED)
    match [len(one) for one in read]:
        case [6, 6]:
            return Target(*place, "joint", read[0], external)
        case [3, 4, 4, 6]:
            pose = (*read[0], *read[1])
            return Target(*place, "cartesian", pose, external, ranges=_ranges(read[2]))
        case _:
            return Uncorrected(*place[1:], f"{name} is computed at run time")


def _ranges(configuration: Sequence[Number]) -> tuple[Range, ...]:
    """Ranges of the axes [rad]: quarter turns of 1, 4 and 6; axis 5 is negative for odd cfx."""
    cf1, cf4, cf6, cfx = (number.value for number in configuration)
    quarter = np.pi / 2
    first, fourth, sixth = ((cf * quarter, (cf + 1) * quarter) for cf in (cf1, cf4, cf6))
    fifth = (-np.inf, 0.0) if cfx % 2 else (0.0, np.inf)
    return (first, None, None, fourth, fifth, sixth)


_Framed = tuple[Array | None, str | None]
"""Frame, None if it cannot be read, and why it is not fixed, None if it is."""


def _framed(source: Source, kind: str, value: ListItem | None) -> _Framed:
    """Frame of tooldata or wobjdata, and why it is not fixed to the robot or to the cell."""
    parts = (None if value is None else inner(source, value)) or []
    labels = [part.text.upper() for part in parts]
    return (_tool if kind == "tooldata" else _work_object)(source, labels, parts)


def _tool(source: Source, words: Sequence[str], parts: Sequence[ListItem]) -> _Framed:
    match words:
        case ["TRUE", _, _]:
            return _pose(source, parts[1]), None
        case ["FALSE", _, _]:
            return None, "does not move with the robot"
    return None, None


def _work_object(source: Source, words: Sequence[str], parts: Sequence[ListItem]) -> _Framed:
    match words:
        case ["FALSE", "TRUE", _, _, _]:
            user, object_ = (_pose(source, one) for one in parts[3:])
            return None if user is None or object_ is None else user @ object_, None
        case [_, _, _, _, _]:
            return None, "does not stand still"
    return None, None


def _pose(source: Source, entry: ListItem) -> Array | None:
    parts = inner(source, entry)
    lists = [numbers(inner(source, part)) for part in parts or ()]
    if [len(one or ()) for one in lists] != [3, 4]:
        return None
    values = [number.value for one in lists for number in one or ()]
    return ABB.frame(values) if any(values[3:]) else None


def _steps(found: _Rapid) -> Iterator[ProgramStep]:
    """Yield displacement changes and the blocks around them; an IF without THEN is a block."""
    plain, state = found.source.plain, _Open()
    jumps = {*map(str.lower, re.findall(r"\bGOTO\s+(\w+)", plain, re.IGNORECASE))}
    for token in _TOKEN.finditer(plain):
        word, at = (token[1] or "").lower(), token.start()
        kind = _kind(found, word, state.before, bool(token[2]) and word in jumps)
        if state.compact and token[0] == ";":
            kind = "close"
        if state.handler and word in (*_HANDLERS, *_ENDS):
            yield ProgramStep(at, "close", found.source.line(at))
        yield from _step(found, token, word, kind)
        state.follow(token[0].lower(), word)


@dataclass
class _Open:
    """What is open before a token: an IF that may have no block, an error handler.

    Attributes:
        compact: Whether it is the IF.
        handler: Whether it is the handler.
        before: The word before the token.
    """

    compact: bool = False
    handler: bool = False
    before: str = ""

    def follow(self, token: str, word: str) -> None:
        """Advance past a token."""
        self.handler = word in _HANDLERS or (self.handler and word not in _ENDS)
        self.compact = word == "if" or (self.compact and token not in _ENDS_IF)
        self.before = word


def _step(
    found: _Rapid, token: re.Match[str], word: str, kind: StepKind | None
) -> Iterator[ProgramStep]:
    """The step at a token, if it is one."""
    at = token.start()
    if token[0].startswith("%") and not token[0].startswith(_HEAD):
        yield _called_by_name(found, at)
    elif kind:
        yield ProgramStep(at, kind, found.source.line(at), _DISPLACED.get(word, ""))


def _called_by_name(found: _Rapid, at: int) -> ProgramStep:
    """What a routine does whose name is a string; the beginning may be all that is known of it."""
    line, match = found.source.line(at), _NAME.match(found.source.text, at)
    name = match[1].lower() if match else ""
    if match and match[2] and name in _DISPLACED:
        return ProgramStep(at, "set", line, _DISPLACED[name])
    if (match and match[2]) or not any(one.startswith(name) for one in _DISPLACED):
        return ProgramStep(at, "call", line)
    return ProgramStep(
        at, "set", line, UnknownState(f"what line {line} calls by a string may displace points")
    )


_ENDS_IF = (";", "then")
"""What ends an IF that may have no block: its statement does, or THEN, which begins one."""


def _kind(found: _Rapid, word: str, before: str, label: bool) -> StepKind | None:
    """Kind of step that a word makes, or None."""
    if word in _DISPLACED:
        return "set"
    if word in _BLOCKS:
        return _BLOCKS[word]
    if label:
        return "label"
    called = word in (*found.routines, "callbyvar") and before not in ("proc", "trap", "func")
    return "call" if called else None


def _follow(
    found: _Rapid, motion: re.Match[str], following: int, displaced: Callable[[int], HeldState]
) -> None:
    """Process one instruction, in the order of the text."""
    plain, word = found.source.plain, motion[motion.lastindex or 0]
    name, start, after = word.lower(), motion.start(motion.lastindex or 0), motion.end()
    end = found.end(after)
    if name in found.routines:
        found.account(found.source, start, after)
    elif not after <= end <= following:
        found.account(found.source, start, after)
        found.leave(found.source, start, f"{word} has no end")
    elif name in _DISPLACED or _moves_nothing(name):
        found.account(found.source, start, end)
    elif name in _CHECKED:
        found.account(found.source, start, end)
        found.check(name, "off" not in plain[after:end].lower())
    elif name in _MOTIONS:
        found.account(found.source, start, end)
        given = dropwhile(_switch, entries(plain, after, end))
        _move(found, name, start, [*given], displaced(end - 1))
    else:
        found.account(found.source, start, end if re.fullmatch(_KNOWN, name, re.I) else after)
        found.leave(found.source, start, f"{word} is no motion known here")


def _switch(entry: ListItem) -> bool:
    """Whether an argument is optional."""
    return entry.text.startswith("\\")


def _moves_nothing(name: str) -> bool:
    """Whether an instruction named like a motion moves nothing."""
    return _NO_MOTION.fullmatch(name) is not None


def _move(
    found: _Rapid, name: str, start: int, given: Sequence[ListItem], displaced: HeldState
) -> None:
    """Record the points of a motion with its tool and its frame."""
    which, tool_at = _MOTIONS[name]
    plain = sum(not _switch(one) for one in given)
    if not tool_at < plain <= tool_at + (3 if name.endswith(_MORE) else 1):
        found.leave(found.source, start, "the motion has not the arguments of its kind")
        return
    if name in _SEARCH:
        found.change(given[1].text.lower(), found.source, given[1].start)
    wobj = _WOBJ.search(found.source.plain, given[tool_at].start, given[-1].end)
    frames = _named_frame(given[tool_at].text), _named_frame(wobj[1] if wobj else "wobj0")
    checked = found.checks("confj" if name.startswith(_BY_AXES) else "confl")
    goals = (
        found.stays(one.start, _displaced(one, displaced) or _use(found, one, frames, checked))
        for one in (given[k] for k in which)
    )
    found.move(found.source.line(start), goals)


def _displaced(entry: ListItem, displaced: HeldState) -> str | None:
    """Why a point is not where it was taught, if the program displaces points."""
    if isinstance(displaced, UnknownState):
        return displaced.why
    return f"{entry.text} is displaced by the program" if displaced else None


def _named_frame(text: str) -> HeldState:
    """Name of a tool or a work object, in lower case."""
    text = text.strip()
    word = _WORD.fullmatch(text)
    return word[1].lower() if word else UnknownState(f"{text} is computed at run time")


def _use(
    found: _Rapid, entry: ListItem, frames: tuple[HeldState, HeldState], checked: bool
) -> str | None:
    """Record a motion to a point; return why, if it cannot be corrected.

    Args:
        found: Module as far as it was read.
        entry: The point.
        frames: Tool and work object.
        checked: Whether the stated configuration is kept.
    """
    text = _SWITCHES.sub("", entry.text)
    points: Sequence[Target | Uncorrected]
    if text.startswith("["):
        inline = ListItem(entry.start, entry.start + len(text), text)
        name = f"the target in line {found.source.line(entry.start)}"
        points = list(_points(found, name, [inline]))
    elif named := _POINT.match(text):
        points = found.of_name(named[1].lower(), named[2], first=1)
    else:
        return f"{text} is computed at run time"
    if not points:
        return f"{text} is not in this program"
    stated = [
        one if checked or isinstance(one, Uncorrected) else replace(one, ranges=())
        for one in points
    ]
    return found.use(stated, *frames)
