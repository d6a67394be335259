"""Result of reading a program in any language, and a check that nothing in it is overlooked.

The reader of a language reports what it understood: motions, points, and the stretches of text it
accounts for. A second pass, which knows words but no grammar, then finds every word that looks like
a motion and every mention of a taught point. Whatever the reader did not account for is listed as
not corrected, with its line.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.base.arrays import Array
from pipeline.programs._flow import HeldState, UnknownState
from pipeline.programs._text import Source
from pipeline.programs.notation import Notation
from pipeline.programs.program import MotionUse, Program, Target, Uncorrected, gathered


@dataclass(frozen=True)
class Lexicon:
    """Words of a language, independent of grammar.

    Attributes:
        motion: Matches every word that looks like a motion.
        literal: Matches the beginning of coordinates written into the text.
        reading: Functions that read a point but neither change it nor move to it.
        end: End of a statement.
        statements: Whether a word without brackets may be a call, with its arguments behind it.
        cased: Whether names are case-sensitive.
    """

    motion: re.Pattern[str]
    literal: re.Pattern[str]
    reading: frozenset[str] = frozenset()
    end: str = "\n"
    statements: bool = False
    cased: bool = False

    def key(self, name: str) -> str:
        """A name in the form used for look-up."""
        return name if self.cased else name.lower()


@dataclass
class JointMotion:
    """A motion to several points: all of them are corrected, or none.

    Attributes:
        line: Its line.
        places: Places of its points.
        halved: Whether one of its points is left.
    """

    line: int
    places: set[tuple[str, int]] = field(default_factory=set)
    halved: bool = False


@dataclass
class ParserState:
    """What has been read so far; names are in the form used for look-up.

    Attributes:
        sources: The files.
        lexicon: Words of the language.
        points: Taught points; a `Uncorrected` for each that cannot be corrected.
        changed: Why points or frames of these names may not be as taught when they are used.
        named: Points named by motions.
        read: Points from which something else is computed.
        uses: The motions.
        last: Place of the target of the last motion.
        left: What is not corrected.
        motions: The motions to several points.
        reached: Places of the points of the motion that is being read.
        together: The motion of several statements that is being read, if any.
        following: Relative motions, and the place of the point before each.
        tools: Tool frames by name, each (4, 4).
        bases: Base frames by name, each (4, 4).
        steady: Names of frames, which need no motion to them.
        framed: Names of points that also serve as a tool or a frame.
    """

    sources: Sequence[Source]
    lexicon: Lexicon
    points: dict[str, list[Target | Uncorrected]] = field(default_factory=dict)
    changed: dict[str, str] = field(default_factory=dict)
    named: set[str] = field(default_factory=set)
    read: set[str] = field(default_factory=set)
    uses: list[MotionUse] = field(default_factory=list)
    last: tuple[str, int] | None = None
    left: list[Uncorrected] = field(default_factory=list)
    motions: list[JointMotion] = field(default_factory=list)
    reached: set[tuple[str, int]] = field(default_factory=set)
    together: JointMotion | None = None
    following: list[tuple[Uncorrected, tuple[str, int] | None]] = field(default_factory=list)
    tools: dict[str, Array] = field(default_factory=dict)
    bases: dict[str, Array] = field(default_factory=dict)
    steady: set[str] = field(default_factory=set)
    framed: set[str] = field(default_factory=set)
    _met: set[tuple[str, int, str, str]] = field(default_factory=set)

    def of_name(
        self, name: str, index: str | None, first: int = 0
    ) -> Sequence[Target | Uncorrected]:
        """The points of a name that a motion has; all of an array that is not as it was taught.

        Args:
            name: The name.
            index: Index into an array, as written; a computed one means any of its points.
            first: Index of the first element.
        """
        points = self.points.get(name, [])
        self.named.add(name)
        once = len({one.name for one in points if isinstance(one, Target)}) == len(points)
        if index and index.isdecimal() and once:
            at = int(index[:9]) - first
            return points[at : at + 1]
        return points

    _known: dict[str, bytearray] = field(default_factory=dict)

    def account(self, source: Source, start: int, end: int) -> None:
        """Record that the reader of the language has understood a stretch of text."""
        mask = self._mask(source)
        mask[start:end] = b"\1" * (min(end, len(mask)) - start)

    def _mask(self, source: Source) -> bytearray:
        if source.file not in self._known:
            self._known[source.file] = bytearray(len(source.text))
        return self._known[source.file]

    def change(self, name: str, source: Source, at: int) -> None:
        """Record that the program itself assigns another value to a point or a frame."""
        self.unsettle(name, f"is changed at run time on line {source.line(at)}")

    def unsettle(self, name: str, why: str) -> None:
        """Record why a name may not mean what was taught; a computed index means the array."""
        self.changed.setdefault(name if constant(name) else array(name), why)

    def unsettled(self, name: str) -> str | None:
        """Why a name, or the array it is an element of, may not have its taught value; or None."""
        return self.changed.get(name) or self.changed.get(array(name))

    def enclose(self, name: str, source: Source, start: int, end: int) -> None:
        """Record coordinates in a value of another kind; who gets it may move to them."""
        if self.lexicon.literal.search(source.plain, start, end):
            self.account(source, start, end)
            why = f"{name} has coordinates in a value that is no point"
            self.points.setdefault(name, []).append(
                Uncorrected(source.file, source.line(start), why)
            )

    def leave(self, source: Source, at: int, why: str) -> None:
        """Record something that is not corrected."""
        self.left.append(Uncorrected(source.file, source.line(at), why))

    def stays(self, at: int, why: str | None) -> Uncorrected | None:
        """A goal that stays as taught; None without a reason. A program of one file."""
        source = self.sources[0]
        return Uncorrected(source.file, source.line(at), why) if why else None

    def move(self, line: int, goals: Iterable[Uncorrected | None]) -> None:
        """Record a motion.

        Args:
            line: Its line.
            goals: Why each of its points is not corrected, or None; it is recorded as this is read.
        """
        self.reached, motion = set(), self.together or JointMotion(line)
        every = [*goals]
        left = [one for one in every if one is not None]
        self.left += left
        motion.places |= self.reached
        motion.halved |= any(one.counts for one in left)
        if len(every) > 1:
            self.motions.append(motion)

    def begin(self, line: int) -> None:
        """Record that the motions from here on are one, until `together` is reset."""
        self.together = JointMotion(line)
        self.motions.append(self.together)

    def use(
        self, points: Sequence[Target | Uncorrected], tool: HeldState, base: HeldState
    ) -> str | None:
        """Record a motion to a point or any of several; return why it cannot be corrected.

        Args:
            points: The points.
            tool: Tool in force, or that it is unknown.
            base: Frame in force, likewise; joint targets need none.
        """
        unfit = next((one.why for one in points if isinstance(one, Uncorrected)), None)
        targets = self._reach(points)
        posed = any(one.kind == "cartesian" for one in targets)
        frames = (tool, base) if posed else (tool,)
        unsure = next((one.why for one in frames if isinstance(one, UnknownState)), None)
        if why := unfit or unsure:
            return why
        for one in targets:
            self.note(MotionUse(one, str(tool), str(base) if posed else ""))
        return None

    def _reach(self, points: Sequence[Target | Uncorrected]) -> list[Target]:
        """Record that the motion being read has these points; return those with coordinates."""
        targets = [one for one in points if isinstance(one, Target)]
        self.reached |= {one.place for one in targets}
        return targets

    def note(self, use: MotionUse) -> None:
        """Record a motion, unless one to this target with its tool and frame was recorded."""
        self.last = use.target.place
        alike = (*use.target.place, use.tool, use.base)
        if alike not in self._met:
            self._met.add(alike)
            self.uses.append(use)


_CONSTANT = re.compile(r"(?:(?:\d+|#\w+)(?:,(?:\d+|#\w+))*\])?")
"""Matches an index that is written out, as opposed to computed."""


def array(name: str) -> str:
    """The array of an element; other names unchanged."""
    return name.partition("[")[0]


def constant(name: str) -> bool:
    """Whether a name is not an element with a computed index."""
    return _CONSTANT.fullmatch(name.partition("[")[2]) is not None


def finished(found: ParserState, file: str, text: str, notation: Notation) -> Program:
    """Return the program; everything that its reader did not account for is listed as left."""
    for source in found.sources:
        _hand_over(found, source)
        _overlooked(found, source)
    changed = {
        one.place: why
        for name, several in found.points.items()
        if (why := found.unsettled(name) or (_FRAMED if name in found.framed else None))
        for one in several
        if isinstance(one, Target)
    }
    targets, left = _whole(found, changed)
    places = {one.place for one in targets}
    follow = [one._replace(counts=place not in places) for one, place in found.following]
    every = sorted({*found.left, *left, *follow, *_spare(found)})
    own, other = ([one for one in every if (one.file == file) is mine] for mine in (True, False))
    return Program(
        file, text, notation, tuple(targets), tuple(own), tuple(other), found.tools, found.bases
    )


def _whole(
    found: ParserState, changed: Mapping[tuple[str, int], str]
) -> tuple[list[Target], list[Uncorrected]]:
    """Targets, and what is left; of a motion to several points all are corrected, or none."""
    uses, by_place = [*_steady(found)], defaultdict(list)
    whole = {one.place for one in gathered(uses, changed)[0]}
    for motion in found.motions:
        for place in motion.places:
            by_place[place].append(motion)
    halves: dict[tuple[str, int], str] = {}
    open_ = [one for one in found.motions if one.halved or not one.places <= whole]
    while open_:
        motion = open_.pop()
        for place in motion.places & whole:
            halves[place] = (
                f"is of the motion in line {motion.line}, another point of which is left"
            )
            open_ += by_place[place]
        whole -= motion.places
    return gathered(uses, {**changed, **halves})


_FRAMED = "is a frame of other points, which would move with it"


def _steady(found: ParserState) -> Iterator[MotionUse]:
    """Yield the motions whose tool and frame are as declared; the others are recorded as left."""
    for use in found.uses:
        frames = (use.tool, use.base)
        moved = next((one for one in frames if found.unsettled(one)), None)
        if moved is None:
            yield use
        else:
            why = f"{use.target.name} stands in {moved}, which {found.unsettled(moved)}"
            found.left.append(Uncorrected(use.target.file, use.target.line, why))


def _overlooked(found: ParserState, source: Source) -> None:
    """Record words that look like motions but that the reader did not understand."""
    known = found._mask(source)
    for word in found.lexicon.motion.finditer(source.plain):
        at = word.start(word.lastindex or 0)
        if not known[at]:
            text = " ".join(word[word.lastindex or 0].split())
            found.leave(source, at, f"{text} is no motion known here")


def _hand_over(found: ParserState, source: Source) -> None:
    """Record points, frames and coordinates passed to routines, which may change or use them."""
    names = {*found.points, *found.tools, *found.bases}
    known, names = found._mask(source), (names | {array(name) for name in names}) - {""}
    for at, name, to in _mentions(source, found.lexicon, names):
        if known[at]:
            continue
        reads = to in found.lexicon.reading
        if not name:
            if not reads:
                _leave_coordinates(found, source, at, to)
        elif to is None or reads:
            found.read.add(name)
        elif to == ":=":
            found.change(name, source, at)
        else:
            why = f"is handed to {to} on line {source.line(at)}, which may change it or move there"
            found.unsettle(name, why)


def _leave_coordinates(found: ParserState, source: Source, at: int, to: str | None) -> None:
    """Record coordinates that are passed to a routine which may move there."""
    receiver = "what is not known here" if to in (None, "", ":=") else to
    found.leave(source, at, f"coordinates are handed to {receiver}, which may move there")


_TOKEN = re.compile(
    r"(?P<switch>\\\s*)?(?<![\w$#.])(?P<name>[A-Za-z_]\w*)|(?P<sign>[()\[\]{};\n]|:=)"
)
_SET = re.compile(r"\s*(?:[\[{][^\[\]{};\r\n]*[\]}]\s*){0,3}(?:\s*\.\s*\w+)*\s*:?=(?!=)")
_STARTS = frozenset({"then", "else", "do", "endif", "endfor", "endwhile", "error"})
_NO_CALL = _STARTS | {"if", "elif", "elseif", "while", "until", "and", "or", "not", "xor", "exor"}
_BEFORE = _NO_CALL | {
    "defdat", "return", "for", "to", "step", "in", "switch", "case", "when", "wait", "decl",
    "const", "global", "local", "b_and", "b_or", "b_exor", "b_not",
}  # fmt: skip
"""Words that may stand directly before a name without doing anything with it but read it."""


def _mentions(
    source: Source, lexicon: Lexicon, names: set[str]
) -> Iterator[tuple[int, str, str | None]]:
    """Yield place, name and receiver of each mention: a routine, `:=`, or None if it is only read.

    Coordinates have an empty name.
    """
    literals = {one.start(1) for one in lexicon.literal.finditer(source.plain)}
    so_far = _Statement(lexicon)
    for token in _TOKEN.finditer(source.plain):
        word = token["name"]
        at = token.start("name" if word else "sign")
        if at in literals:
            yield at, "", so_far.getter(source, token)
        elif word and not token["switch"] and (key := lexicon.key(word)) in names:
            yield at, key, so_far.getter(source, token)
        so_far.follow(token)


@dataclass
class _Statement:
    """The part of a statement before a token.

    Attributes:
        lexicon: Words of its language.
        calls: Routine called at each open bracket, innermost last; empty if there is none.
        head: First word of the statement.
        before: Word just before the token.
        assigned: Whether the statement assigns.
        optional: Whether the name of an optional argument is just before.
        end: End of the token before.
    """

    lexicon: Lexicon
    calls: list[str] = field(default_factory=list)
    head: str = ""
    before: str = ""
    assigned: bool = False
    optional: bool = False
    end: int = 0

    def follow(self, token: re.Match[str]) -> None:
        """Advance past a token."""
        word, sign = token["name"] or "", token["sign"]
        if sign == self.lexicon.end and not (self.calls and self.lexicon.cased):
            self.calls, self.head, self.assigned = [], "", False
        elif sign == ":=":
            self.assigned |= not self.optional
        elif sign:
            self._bracket(sign)
        self.optional = bool(token["switch"])
        self.head = "" if word.lower() in _STARTS else self.head or word
        self.before, self.end = word, token.end()

    def _bracket(self, sign: str) -> None:
        outer = self.calls[-1] if self.calls else ""
        if sign in "([{":
            called = sign == "(" and self.before.lower() not in _NO_CALL
            self.calls.append((self.before if called else "") or outer)
        elif sign in ")]}" and self.calls:
            self.calls.pop()

    def getter(self, source: Source, token: re.Match[str]) -> str | None:
        """Receiver of a name: a routine or an assignment (`:=`); None if it is only read."""
        called = self.calls[-1] if self.calls else ""
        if called:
            return called.lower() if called.lower() in self.lexicon.reading else called
        if _SET.match(source.plain, token.end()):
            return ":="
        if self.lexicon.statements:
            return None if self.assigned else self.head or "a routine"
        return self._in_front(source.plain[self.end : token.start()])

    def _in_front(self, between: str) -> str | None:
        """The word directly before a token, if it is none of the language; None without one."""
        known = between.strip(" \t") or self.before.lower() in _BEFORE
        return None if known else self.before or None


def _spare(found: ParserState) -> Iterator[Uncorrected]:
    """Points that no motion names; they count if the program changes them or computes from them."""
    used = found.named | found.steady | found.framed
    for name, several in found.points.items():
        if name in used:
            continue
        why = found.unsettled(name)
        counts = why is not None or not found.read.isdisjoint((name, array(name)))
        for one in several:
            word = one.name if isinstance(one, Target) else name
            reason = why or "is taught, and no motion here goes to it"
            yield Uncorrected(one.file, one.line, f"{word} {reason}", counts)
