"""KUKA KRL: motions in .src, points in the same file or in the .dat of the same name.

DECL E6POS XP1={X 1200.0,Y 0.0,Z 800.0,A 0.0,B 90.0,C 0.0,S 2,T 10,E1 350.0}
PTP XP1
LIN {X 1250.0,Y 0.0,Z 800.0,A 0.0,B 90.0,C 0.0} C_DIS
SLIN XP2 WITH $TOOL=STOOL2(FP2),$BASE=SBASE(FP2.BASE_NO)
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

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
from pipeline.programs._parser import Lexicon, ParserState, array, constant, finished
from pipeline.programs._text import ListItem, Source, entries
from pipeline.programs.inverse import Range
from pipeline.programs.notation import KUKA
from pipeline.programs.program import (
    NUMBER_PATTERN,
    MotionUse,
    Number,
    Program,
    Target,
    Uncorrected,
    number,
)

SUFFIXES, SIGN = (".src", ".dat"), ";"
HEADS = {".src": r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?\b", ".dat": r"^[ \t]*DEFDAT\b"}

_SILENT = re.compile(r'"[^"\r\n]*"|;[^\r\n]*|^&[^\r\n]*', re.MULTILINE)
_POSE, _AXES = ("x", "y", "z", "a", "b", "c"), ("a1", "a2", "a3", "a4", "a5", "a6")
_NAME = r"\$?\w+(?:\s*\[[^\[\]]*\])?"
_ASSIGNED = re.compile(
    rf"\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:(\w+)\s+)?({_NAME})\s*=(?!=)\s*(.*)", re.IGNORECASE
)
_PART = re.compile(rf"\s*({_NAME})\s*\.[\s\w.\[\]]*=(?!=)")
_MOTION = re.compile(
    r"\s*(S?(?:PTP|LIN|CIRC)|SPL)(_REL)?(?![\w=])\s*(?!=)(.*)", re.IGNORECASE | re.DOTALL
)
_POINT = re.compile(r"(\{[^{}]*\}|\w+(?:\s*\[[^\[\]]*\])?)\s*(?:C_\w+.*)?", re.I | re.DOTALL)
_WITH = re.compile(r"(.*?)\bWITH\b(.*)", re.IGNORECASE | re.DOTALL)
_SPLINE = re.compile(r"\s*(?:PTP_)?SPLINE\b", re.IGNORECASE)
_END_SPLINE = re.compile(r"\s*ENDSPLINE\b", re.IGNORECASE)
_COMPONENT = re.compile(
    rf"([A-Za-z]\w*)\s+(?:({NUMBER_PATTERN})|'\s*B\s*([01]{{1,32}})\s*'|'\s*H\s*([0-9A-F]{{1,8}})\s*')",
    re.IGNORECASE,
)
_BAS = re.compile(r"\s*BAS\s*\(\s*#(\w+)\s*(?:,\s*([^)]*))?\)", re.IGNORECASE)
_OF_FORM = ("frames", "ptp_params", "cp_params")
"""Arguments with which BAS takes tool and base from FDAT_ACT."""
_NO_FRAME = re.compile(r"(?:vel|acc)_(?:ptp|cp)|(?:ptp|cp)_dat|out_a?sync|group")
"""Arguments with which BAS does not change tool or base."""
_SETTING = re.compile(
    r"(\$(?:TOOL|BASE|IPO_MODE|ROBROOT|WORLD)|FDAT_ACT)\s*(?:\.[\w\s.]*)?=(?!=)|\b(BAS)\s*\("
    r"|\w\s*+\([^()]*?(\$TOOL|\$BASE|FDAT_ACT)\b",
    re.IGNORECASE,
)
"""Matches what sets a tool or a frame, wherever it stands; a routine that gets one may set it."""
_LENT = re.compile(
    r"(?:\w\s*+\([^()\n]*?\b|\w[ \t]++(?=\w++[ \t]*+\[[^\[\]\r\n]*+\][\w. \t]*=(?!=)))"
    r"((?:TOOL|BASE)_DATA\b(?:[ \t]*+\[[^\[\]\r\n]*+\])?)",
    re.IGNORECASE,
)
"""Matches frames passed to a routine, or set behind other words."""
_DECLARATION = re.compile(
    r"\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:DECL\s+\w+|(?:E[36])?(?:POS|AXIS)|FRAME)\s+\w[^=]*$", re.I
)
_ACT = re.compile(r"\s*FDAT_ACT\s*=(?!=)\s*(.*)", re.IGNORECASE)
_NUMBERED = re.compile(r"(TOOL|BASE)_DATA\[(\d{1,9})\]", re.IGNORECASE)
_SELECTED = re.compile(
    r"S(?:TOOL2?\((\w+)(?:\.TOOL_NO)?|BASE\((\w+)(?:\.BASE_NO)?|IPO_MODE\((\w+)(?:\.IPO_FRAME)?)\)",
    re.IGNORECASE,
)
_LINE_SAID = re.compile(r"(TOOL_NO|BASE_NO)\s+([^,}]+)", re.IGNORECASE)
_OUTSIDE = re.compile(r"#TCP\b", re.IGNORECASE)
_NULL = ("$nullframe", "$world")
_MODES = {"$tool": "tool", "$base": "base", "$ipo_mode": "mode"}
_THINGS = {"tool": "tool", "base": "frame", "mode": "interpolation"}
_HOME = re.compile(r"xhome\d?")
"""Home positions of $config.dat, away from any workpiece."""
_STANDING = ("$pos_act", "$axis_act")
"""Present position of the robot; a motion to it moves nothing."""
_ASIDE = re.compile(r"^[ \t]*(?:GLOBAL[ \t]+)?(?:INTERRUPT|TRIGGER)\b[^\r\n]*\bDO\b", re.I | re.M)
"""Matches what executes a routine while the robot moves."""
_INTERRUPT = re.compile(r"\s*(?:GLOBAL\s+)?INTERRUPT\b", re.IGNORECASE)
_ROUTINE = re.compile(
    r"\s*(?:GLOBAL\s+)?DEF(?:FCT\s+\w+(?:\s*\[[^\]]*\])?)?\s+(\w+)\s*\(([^)]*)", re.IGNORECASE
)
_BLOCKS: tuple[tuple[StepKind, re.Pattern[str]], ...] = (
    ("open", re.compile(r"\s*(?:IF|SWITCH)\b", re.IGNORECASE)),
    ("loop", re.compile(r"\s*(?:FOR|WHILE|LOOP|REPEAT)\b", re.IGNORECASE)),
    ("scope", _SPLINE),
    ("else", re.compile(r"\s*(?:ELSE|DEFAULT)\b", re.IGNORECASE)),
    ("branch", re.compile(r"\s*CASE\b", re.IGNORECASE)),
    ("routine", _ROUTINE),
    ("label", re.compile(r"\s*\w+\s*:\s*$")),
    (
        "close",
        re.compile(r"\s*(?:END(?:IF|SWITCH|FOR|WHILE|LOOP|SPLINE|FCT)?|UNTIL)\b", re.IGNORECASE),
    ),
)
_LEXICON = Lexicon(
    motion=re.compile(
        r"(?<![\w$#.])(S?(?:PTP|LIN|CIRC)(?:_REL)?|SPL(?:_REL)?|(?:PTP_)?SPLINE|ASYPTP|ASYCONT"
        r"|RSI_MOVECORR|MOVE_?(?:PTP|LIN|CIRC))(?![\w.])(?!\s*=)"
        r"|^[ \t]*([A-Z_]\w*)[ \t]*(?=\{)",
        re.IGNORECASE | re.MULTILINE,
    ),
    literal=re.compile(r"\{\s*(?:\w+\s*:\s*)?((?:X|A1)\s+[-+.\d'])", re.IGNORECASE),
    reading=frozenset({"inverse", "forward", "inv_pos", "abs", "sqrt"}),
)


@dataclass(frozen=True)
class _Aggregate:
    """Aggregate in braces, by the names of its components in lower case.

    Attributes:
        source: The file.
        start: Place of its opening brace.
        end: Place behind its closing brace.
        names: Names of its components.
        count: Number of its components, repetitions included.
        numbers: Components that are numbers.
    """

    source: Source
    start: int
    end: int
    names: frozenset[str]
    count: int
    numbers: Mapping[str, Number]

    @property
    def complete(self) -> bool:
        """Whether every component is one number, and all are of one kind."""
        both = not self.names.isdisjoint(_POSE) and not self.names.isdisjoint(_AXES)
        return len(self.numbers) == self.count and not both

    @property
    def taught(self) -> bool:
        """Whether it is a position or part of one, not a load or other data."""
        return not self.names.isdisjoint((*_POSE, *_AXES))

    def target(self, name: str) -> Target | Uncorrected:
        """The point, or why it cannot be corrected."""
        joint = "a1" in self.numbers
        wanted = _AXES if joint else _POSE
        line = self.source.line(self.start)
        if not self.complete:
            return Uncorrected(self.source.file, line, f"{name} is computed at run time")
        if missing := [word.upper() for word in wanted if word not in self.numbers]:
            why = f"{name} has no {', '.join(missing)} of its own"
            return Uncorrected(self.source.file, line, why)
        return Target(
            name,
            self.source.file,
            line,
            "joint" if joint else "cartesian",
            tuple(self.numbers[word] for word in wanted),
            tuple(self.numbers[f"e{k}"].value for k in range(1, 7) if f"e{k}" in self.numbers),
            ranges=self._ranges(),
        )

    def _ranges(self) -> tuple[Range, ...]:
        """Ranges of the axes according to T: bit k is set where axis k + 1 is negative."""
        if "t" not in self.numbers:
            return ()
        turn = int(self.numbers["t"].value)
        return tuple((-np.inf, 0.0) if turn >> k & 1 else (0.0, np.inf) for k in range(6))

    @property
    def frame(self) -> Array | None:
        """The frame with these components; None if it is not a complete pose."""
        known = self.complete and all(word in self.numbers for word in _POSE)
        return KUKA.frame([self.numbers[word].value for word in _POSE]) if known else None


@dataclass
class _Krl(ParserState):
    """What has been read so far of a KRL program.

    Attributes:
        lines: Data of inline forms: tool, base, and interpolation mode.
        frames: Values of frames, by their names in lower case.
        parts: Names of array elements, by the name of the array.
        moved: Whether a motion to a point has occurred in the current routine.
    """

    lines: dict[str, dict[str, str]] = field(default_factory=dict)
    frames: dict[str, list[_Aggregate]] = field(default_factory=dict)
    parts: dict[str, list[str]] = field(default_factory=dict)
    moved: bool = False


_Frames = Mapping[str, Callable[[int], HeldState]]


def read(file: str, text: str, other: tuple[str, str] | None = None) -> Program:
    """Read the points of a program.

    Without its companion file, all points of a .dat are taken as targets.

    Args:
        file: Name of the file to be corrected.
        text: Its text.
        other: Name and text of its .src or .dat, if there is one.
    """
    both = [(file, text), *([other] if other else [])]
    both.sort(key=lambda one: not one[0].lower().endswith(".dat"))
    sources = [Source(name, one, _SILENT) for name, one in both]
    found = _Krl(sources, _LEXICON)
    found.tools["0"] = found.bases["0"] = np.eye(4)
    for source in sources:
        _define(found, source)
    for source in sources:
        _carry_out(found, source)
    if all(source.file.lower().endswith(".dat") for source in sources):
        _all(found)
    return finished(found, file, text, KUKA)


def _carry_out(found: _Krl, source: Source) -> None:
    """Record the motions of a file, each with the state in force there."""
    steps = _steps(found, source)
    if _ASIDE.search(source.plain):
        motions = [(at, source.line(at)) for at, line in source.lines if _MOTION.match(line)]
        steps = {one: interrupted(several, motions) for one, several in steps.items()}
    states = {one: holding(steps[one], "", thing) for one, thing in _THINGS.items()}
    for start, line in source.lines:
        _follow(found, source, start, line, states)


def _all(found: _Krl) -> None:
    """Take every point except frames as a target."""
    for name, points in found.points.items():
        if name not in found.steady:
            found.named.add(name)
            found.uses += [MotionUse(one, "", "") for one in points if isinstance(one, Target)]
            found.left += [one for one in points if isinstance(one, Uncorrected)]


# --- declarations ---------------------------------------------------------------------------------


def _define(found: _Krl, source: Source) -> None:
    """Record points, frames and data of inline forms, wherever they are declared."""
    depth = 0
    for lent in _LENT.finditer(source.plain):
        found.change(_key(lent[1]), source, lent.start(1))
    for start, line in source.lines:
        kind = _block(line)
        depth += (kind in ("open", "loop")) - (kind == "close")
        if routine := _ROUTINE.match(line):
            depth = 0
            found.account(source, start, start + len(line))
            for word in filter(str.strip, routine[2].split(",")):
                why = f"is given by the caller of the routine in line {source.line(start)}"
                found.unsettle(array(_key(word.partition(":")[0])), why)
        elif _DECLARATION.match(line):
            found.account(source, start, start + len(line))
        elif part := _PART.match(line):
            found.account(source, start, start + part.end())
            found.change(_key(part[1]), source, start)
        elif (assigned := _ASSIGNED.match(line)) and not _MOTION.match(line):
            found.account(source, start, start + assigned.end(2))
            if assigned[2].startswith("$"):
                _account_value(found, source, start + assigned.start(3), assigned[3])
            else:
                _declare(found, source, start, assigned, depth > 0)


def _enclose(found: _Krl, source: Source, kind: str, key: str, aggregate: _Aggregate) -> None:
    """Record coordinates that are not a point; load data are ignored, as they move nothing."""
    if kind != "load" and not key.startswith("load_data"):
        found.enclose(key, source, aggregate.start, aggregate.end)


def _declare(
    found: _Krl, source: Source, start: int, assigned: re.Match[str], decided: bool
) -> None:
    """Record an assignment to a variable that is not a system variable.

    Args:
        found: What has been read so far.
        source: The file.
        start: Place of the line.
        assigned: Match of the assignment.
        decided: Whether it is inside a branch or a loop.
    """
    kind, key, value = (assigned[1] or "").lower(), _key(assigned[2]), assigned[3]
    aggregate = _aggregate(source, start + assigned.start(3), value)
    if aggregate is not None:
        found.account(source, aggregate.start, aggregate.end)
    if kind == "fdat" or key in found.lines:
        if key in found.lines:
            found.change(key, source, start)
        found.lines[key] = _parts_of(value)
    elif aggregate is None:
        found.change(key, source, start)
    elif not aggregate.taught:
        _enclose(found, source, kind, key, aggregate)
    elif _OF_DATA.match(key):
        _declare_data(found, start, key, aggregate, decided)
    else:
        _declare_point(found, start, kind, key, aggregate)


_PLAIN_NAME = re.compile(r"\w+(?:\[[^\[\]]*\])?")
_OF_DATA = re.compile(r"(?:tool|base)_data\[")


def _declare_data(found: _Krl, start: int, key: str, aggregate: _Aggregate, decided: bool) -> None:
    """Record an element of TOOL_DATA or BASE_DATA; a computed index may mean any element."""
    known = _NUMBERED.fullmatch(key)
    if decided or key in found.frames or not known:
        found.change(key, aggregate.source, start)
    found.frames.setdefault(key, []).append(aggregate)
    _keep(found, key.partition("_")[0], _number(key), aggregate)


def _declare_point(found: _Krl, start: int, kind: str, key: str, aggregate: _Aggregate) -> None:
    """Record a point, or a frame, which is not a target."""
    if kind == "frame":
        found.steady.add(key)
    elif key in found.steady:
        found.change(key, aggregate.source, start)
    found.frames.setdefault(key, []).append(aggregate)
    found.points.setdefault(key, []).append(aggregate.target(key.upper()))
    if "[" in key:
        if not constant(key):
            found.change(key, aggregate.source, start)
        found.parts.setdefault(array(key), []).append(key)


def _account_value(found: _Krl, source: Source, start: int, value: str) -> None:
    """Account for a frame in braces that is assigned to a system variable."""
    if (aggregate := _aggregate(source, start, value)) is not None:
        found.account(source, start, aggregate.end)


def _number(key: str) -> str:
    return key.partition("[")[2].rstrip("]")


def _parts_of(value: str) -> dict[str, str]:
    """Tool, base and interpolation mode according to the data of an inline form."""
    stated = {k.lower().removesuffix("_no"): n.strip() for k, n in _LINE_SAID.findall(value)}
    return stated | ({"mode": "outside"} if _OUTSIDE.search(value) else {"mode": ""})


def _keep(found: _Krl, which: str, name: str, aggregate: _Aggregate) -> None:
    frames = found.tools if which == "tool" else found.bases
    if (frame := aggregate.frame) is not None:
        frames[name] = frame


def _key(name: str) -> str:
    """A name in lower case, without blanks and leading zeros of its indices."""
    return re.sub(r"\s|(?<=[\[,])0+(?=\d)", "", name).lower()


def _aggregate(source: Source, start: int, value: str) -> _Aggregate | None:
    """The aggregate at `start` that is all of `value`; None if there is none."""
    if not value.startswith("{"):
        return None
    last = source.closing.get(start, -1)
    if not start < last < start + len(value) or value[last + 1 - start :].strip():
        return None
    first = start + 1
    if named := re.compile(r"\s*\w+\s*:").match(source.plain, first, last):
        first = named.end()
    given = entries(source.plain, first, last)
    names = frozenset((entry.text.split(maxsplit=1) or [""])[0].lower() for entry in given)
    known = [part for part in map(_component, given) if part is not None]
    return _Aggregate(source, start, last + 1, names, len(given), dict(known))


def _component(entry: ListItem) -> tuple[str, Number] | None:
    """A component with its name in lower case; None if its value is not a number."""
    part = _COMPONENT.fullmatch(entry.text)
    if part is None:
        return None
    name, decimal, binary, hexadecimal = part.groups()
    if decimal:
        read = number(entry.start + part.start(2), decimal)
    else:
        bits = int(binary, 2) if binary else int(hexadecimal, 16)
        quote = entry.start + entry.text.index("'")
        read = Number(quote, entry.start + len(entry.text), float(bits))
    return None if read is None else (name.lower(), read)


# --- state in force -------------------------------------------------------------------------------


def _block(line: str) -> StepKind | None:
    """Role of a line in the control flow; None if it has none."""
    return next((kind for kind, pattern in _BLOCKS if pattern.match(line)), None)


def _steps(found: _Krl, source: Source) -> dict[str, list[ProgramStep]]:
    """Steps that set tool, base and interpolation mode, each with those of the control flow."""
    routines = {
        one[1].lower() for _, line in source.lines if (one := _ROUTINE.match(line)) is not None
    }
    lines = [(start, source.line(start), line) for start, line in source.lines]
    blocks = [ProgramStep(at, kind, n) for at, n, line in lines for kind in _kinds(line, routines)]
    forms = [
        ProgramStep(at, "set", n, act[1]) for at, n, line in lines if (act := _ACT.match(line))
    ]
    form = holding(sorted([*blocks, *forms], key=lambda one: one.at), "", "inline form")
    out = {one: [*blocks] for one in _THINGS}
    for at, n, line in lines:
        for which, state in _settings(found, source, at, line, form(at)):
            out[which] += _set(ProgramStep(at, "set", n, state), line)
    return {one: sorted(steps, key=lambda step: step.at) for one, steps in out.items()}


def _set(step: ProgramStep, line: str) -> Iterator[ProgramStep]:
    """Steps of what a line sets; of an interrupt, as a routine that may run at any motion."""
    kinds: Sequence[StepKind] = ("routine", "set", "close") if _INTERRUPT.match(line) else ("set",)
    return (step._replace(kind=kind) for kind in kinds)


_CALL = re.compile(r"(?<!\w)(\w++)\s*+\(")


def _kinds(line: str, routines: Set[str]) -> Iterator[StepKind]:
    """Roles of a line in the control flow: a call of a routine of the file, or part of a block."""
    kind = _block(line)
    if kind != "routine" and {one[1].lower() for one in _CALL.finditer(line)} & routines:
        yield "call"
    if kind:
        yield kind


def _settings(
    found: _Krl, source: Source, start: int, line: str, form: HeldState
) -> Iterator[tuple[str, HeldState]]:
    """States that a line sets for those that follow it, given the inline form in force."""
    at = source.line(start)
    assigned = _ASSIGNED.match(line)
    if bas := _BAS.match(line):
        yield from _bas(found, bas[1].lower(), (bas[2] or "").strip(), form, at)
    elif _SPLINE.match(line) and (found_with := _WITH.fullmatch(line)):
        yield from _with(found, source, start + found_with.start(2), found_with[2])
    elif assigned and (which := _MODES.get(assigned[2].lower())):
        yield which, _frame(found, source, start + assigned.start(3), which, assigned[3])
    elif assigned and assigned[2].lower() == "fdat_act":
        yield from _form(found, assigned[3].strip(), at)
    else:
        yield from _set_otherwise(line, at)


def _set_otherwise(line: str, at: int) -> Iterator[tuple[str, HeldState]]:
    """Unknown states due to a line that sets them in no way known here."""
    setting = _SETTING.search(line)
    if setting and not _MOTION.match(line):
        yield from _unsure(setting[setting.lastindex or 1].upper(), at)


def _unsure(word: str, at: int) -> Iterator[tuple[str, HeldState]]:
    """Unknown states due to a setting that cannot be interpreted."""
    only = "base" if word in ("$ROBROOT", "$WORLD") else _MODES.get(word.lower())
    for which in (only,) if only else _THINGS:
        yield which, UnknownState(f"what line {at} sets by {word} is not known")


def _bas(
    found: _Krl, which: str, value: str, form: HeldState, at: int
) -> Iterator[tuple[str, HeldState]]:
    """States set by BAS(#TOOL, n) and similar calls."""
    if which == "initmov":
        yield "tool", ""
        yield "base", ""
    elif which in _THINGS:
        yield (
            which,
            value
            if value.isdecimal()
            else UnknownState(f"{which} {value} of line {at} is not known"),
        )
    elif which in _OF_FORM and isinstance(form, str) and form:
        yield from _form(found, form, at)
    elif not _NO_FRAME.fullmatch(which):
        yield from _unsure("BAS", at)


def _form(found: _Krl, form: str, at: int) -> Iterator[tuple[str, HeldState]]:
    """States set by the data of an inline form."""
    key = _key(form)
    content = _parts_of(form) if form.startswith("{") else found.lines.get(key)
    for which in _THINGS:
        if content is None or key in found.changed:
            yield which, UnknownState(f"{key.upper()} of line {at} is not known")
        elif which != "mode" and not content.get(which, "0").isdecimal():
            yield which, UnknownState(f"{which} {content[which]} of line {at} is not known")
        else:
            yield which, content.get(which, "")


def _with(found: _Krl, source: Source, start: int, words: str) -> Iterator[tuple[str, HeldState]]:
    """States that WITH sets for one motion."""
    for entry in entries(source.plain, start, start + len(words)):
        name, _, value = entry.text.partition("=")
        which = _MODES.get(_key(name))
        where = entry.start + len(entry.text) - len(value.lstrip())
        if not which and _key(name).startswith((*_MODES, "$world", "$robroot")):
            yield from _unsure(name.strip().upper(), source.line(start))
        elif which:
            yield which, _frame(found, source, where, which, value.strip())
        elif _key(name).startswith("$load") and "sload(" not in _key(value):
            yield "tool", UnknownState(f"line {source.line(start)} sets $LOAD")


def _frame(found: _Krl, source: Source, start: int, which: str, value: str) -> HeldState:
    """Name of the frame that is assigned; the frame is stored if known."""
    key, at = _key(value), source.line(start)
    if selected := _SELECTED.fullmatch(key):
        return dict(_form(found, selected[selected.lastindex or 1], at))[which]
    if which == "mode":
        outside = UnknownState(f"{key.upper()} of line {at} is not known")
        return {"#tcp": "outside", "#base": ""}.get(key, outside)
    if key in _NULL:
        return "0"
    if _OF_DATA.match(key):
        return _data(found, key, at)
    aggregate = _aggregate(source, start, value)
    if aggregate is not None:
        _keep(found, which, f"line {at}", aggregate)
        return f"line {at}"
    return _named_frame(found, which, key, at)


def _named_frame(found: _Krl, which: str, key: str, at: int) -> HeldState:
    """Name of a frame given as a variable."""
    known = found.frames.get(key, [])
    if len(known) > 1 or not _PLAIN_NAME.fullmatch(key) or not constant(key):
        return UnknownState(f"{key.upper()} of line {at} is computed or set more than once")
    if known:
        _keep(found, which, key, known[0])
        found.framed.add(key)
    return key


def _data(found: _Krl, key: str, at: int) -> HeldState:
    """Number of an element of TOOL_DATA or BASE_DATA."""
    changed = found.unsettled(key)
    if not _NUMBERED.fullmatch(key):
        return UnknownState(f"{key.upper()} of line {at} is not known")
    return UnknownState(f"{key.upper()} {changed}") if changed else _number(key)


# --- motions --------------------------------------------------------------------------------------


def _follow(found: _Krl, source: Source, start: int, line: str, frames: _Frames) -> None:
    """Process a line in execution order, if it is a motion."""
    if _ROUTINE.match(line):
        found.moved, found.together = False, None
    elif _SPLINE.match(line):
        found.account(source, start, start + len(line))
        found.begin(source.line(start))
    elif _END_SPLINE.match(line):
        found.together = None
    elif motion := _MOTION.match(line):
        found.account(source, start, start + len(line))
        _move(found, source, start + motion.start(3), motion, frames)


def _move(found: _Krl, source: Source, start: int, motion: re.Match[str], frames: _Frames) -> None:
    """Record the targets of a motion."""
    kind, words = motion[1].upper(), motion[3]
    now = {which: at(start) for which, at in frames.items()}
    if found_with := _WITH.fullmatch(words):
        words = found_with[1]
        now |= dict(_with(found, source, start + found_with.start(2), found_with[2]))
    if motion[2]:
        _by_distance(found, source.line(start), source.file, kind + motion[2].upper())
        return
    found.moved = True
    count = 2 if "CIRC" in kind else 1
    given = entries(source.plain, start, start + len(words.rstrip()))
    goals = (_go(found, source, entry, now, "PTP" in kind) for entry in given[:count])
    found.move(source.line(start), goals)
    for entry in given[count:]:
        if count == 1 or not entry.text.upper().startswith("CA"):
            found.leave(source, entry.start, f"{entry.text} is not understood")


def _by_distance(found: _Krl, line: int, file: str, word: str) -> None:
    """Record a relative motion, whose end moves with the point before it."""
    one = Uncorrected(file, line, f"{word} moves by a distance")
    found.following.append((one, found.last if found.moved else None))


def _go(
    found: _Krl, source: Source, entry: ListItem, now: Mapping[str, HeldState], by_axes: bool
) -> Uncorrected | None:
    """Record a motion to a point; return a `Uncorrected` if it cannot be corrected."""
    line, key = source.line(entry.start), _key(entry.text)
    point = _POINT.fullmatch(entry.text)
    mode, why, counts = now["mode"], None, True
    if key in _STANDING:
        why, counts = f"{entry.text} is where the robot stands", False
    elif _HOME.fullmatch(key) and key not in found.points:
        why, counts = f"{entry.text} is a home position of the controller", False
    elif point is None:
        why = f"{entry.text} is computed at run time"
    elif isinstance(mode, UnknownState):
        why = mode.why
    elif mode:
        why = f"{point[1]} moves the workpiece at a fixed tool"
    else:
        why = _use(found, source, entry.start, point[1], now, by_axes)
    return Uncorrected(source.file, line, why, counts) if why else None


def _use(
    found: _Krl, source: Source, start: int, word: str, now: Mapping[str, HeldState], by_axes: bool
) -> str | None:
    """Record a motion to a point; return why it cannot be corrected, or None.

    S and T of a point apply to PTP; other motions keep the arm configuration from which they start.
    """
    points: Sequence[Target | Uncorrected]
    if word.startswith("{"):
        inline = _aggregate(source, start, word)
        name = f"the target in line {source.line(start)}"
        points = [] if inline is None else [inline.target(name)]
    else:
        points = _named(found, _key(word))
    if not points:
        return f"{word} is not in this program"
    stated = [
        one
        if by_axes or not found.uses or isinstance(one, Uncorrected)
        else replace(one, ranges=())
        for one in points
    ]
    return found.use(stated, now["tool"], now["base"])


def _named(found: _Krl, key: str) -> Sequence[Target | Uncorrected]:
    """The points of a name; all elements of an array if the index is computed."""
    if key in found.points or not key.endswith("]"):
        found.named.add(key)
        return found.points.get(key, [])
    names = found.parts.get(key.partition("[")[0], [])
    found.named |= {*names}
    return [one for name in names for one in found.points[name]]
