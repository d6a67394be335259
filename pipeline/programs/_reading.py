"""What is read of a program of any language, and the rule that nothing of it is overlooked.

A language says what it understood: motions, points, and the stretches of text it accounts for. A
second look, which knows words only and no grammar, then finds every word like a motion and every
mention of a taught point. What the language did not account for is left, with its line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from pipeline.base.arrays import Array
from pipeline.programs._flow import Held, Unsure
from pipeline.programs._text import Source
from pipeline.programs.notation import Notation
from pipeline.programs.program import Left, Program, Target, Use, gathered


@dataclass(frozen=True)
class Lexicon:
    """Words of a language, wherever they stand.

    Attributes:
        motion: Every word like a motion.
        literal: How coordinates begin that are written into the text.
        reading: Functions that read a point, and neither change it nor move to it.
        end: What ends a statement.
        statements: A word without brackets may be a call: its arguments stand behind it.
        cased: Small letters are not capital ones.
    """

    motion: re.Pattern[str]
    literal: re.Pattern[str]
    reading: frozenset[str] = frozenset()
    end: str = "\n"
    statements: bool = False
    cased: bool = False

    def key(self, name: str) -> str:
        """A name as it is looked up."""
        return name if self.cased else name.lower()


@dataclass
class Reading:
    """What was read so far; names as they are looked up.

    Attributes:
        sources: The files.
        lexicon: Words of the language.
        points: Taught points; what is left of those that cannot be corrected.
        changed: Why points or frames of these names are not as taught when they are used.
        named: Points that motions name.
        read: Points that something else is computed from.
        uses: The motions.
        last: The place of the point that the last motion went to.
        left: What is not corrected.
        following: Motions by a distance, and the place of the point before them.
        tools: Frames by name, each (4, 4).
        bases: Likewise.
        steady: Names of points that no motion needs: frames.
        framed: Names of points that also serve as a tool or a frame.
    """

    sources: Sequence[Source]
    lexicon: Lexicon
    points: dict[str, list[Target | Left]] = field(default_factory=dict)
    changed: dict[str, str] = field(default_factory=dict)
    named: set[str] = field(default_factory=set)
    read: set[str] = field(default_factory=set)
    uses: list[Use] = field(default_factory=list)
    last: tuple[str, int] | None = None
    left: list[Left] = field(default_factory=list)
    following: list[tuple[Left, tuple[str, int] | None]] = field(default_factory=list)
    tools: dict[str, Array] = field(default_factory=dict)
    bases: dict[str, Array] = field(default_factory=dict)
    steady: set[str] = field(default_factory=set)
    framed: set[str] = field(default_factory=set)
    _met: set[tuple[str, int, str, str]] = field(default_factory=set)
    _known: dict[str, bytearray] = field(default_factory=dict)

    def account(self, source: Source, start: int, end: int) -> None:
        """Say that the language has understood a stretch of text."""
        mask = self._mask(source)
        mask[start:end] = b"\1" * (min(end, len(mask)) - start)

    def _mask(self, source: Source) -> bytearray:
        if source.file not in self._known:
            self._known[source.file] = bytearray(len(source.text))
        return self._known[source.file]

    def change(self, name: str, source: Source, at: int) -> None:
        """Note that the program itself gives a point or a frame another value."""
        self.unsettle(name, f"is changed at run time on line {source.line(at)}")

    def unsettle(self, name: str, why: str) -> None:
        """Note why a name does not mean what is taught; an element that is computed may be any."""
        self.changed.setdefault(name if constant(name) else array(name), why)

    def unsettled(self, name: str) -> str | None:
        """Why a name, or the array that it is an element of, does not mean what is taught."""
        return self.changed.get(name) or self.changed.get(array(name))

    def enclose(self, name: str, source: Source, start: int, end: int) -> None:
        """Note coordinates in a value of another kind: who gets it may move to them."""
        if self.lexicon.literal.search(source.plain, start, end):
            why = f"{name} has coordinates in a value that is no point"
            self.points.setdefault(name, []).append(Left(source.file, source.line(start), why))

    def leave(self, source: Source, at: int, why: str) -> None:
        """Note what is not corrected."""
        self.left.append(Left(source.file, source.line(at), why))

    def use(self, points: Sequence[Target | Left], tool: Held, base: Held) -> str | None:
        """Note a motion to a point, or to any of several; why not, where it cannot be corrected.

        Args:
            points: They.
            tool: What holds, or that nobody knows.
            base: Likewise; axes stand in no frame.
        """
        unfit = next((one.why for one in points if isinstance(one, Left)), None)
        targets = [one for one in points if isinstance(one, Target)]
        posed = any(one.kind == "cartesian" for one in targets)
        held = (tool, base) if posed else (tool,)
        unsure = next((one.why for one in held if isinstance(one, Unsure)), None)
        if why := unfit or unsure:
            return why
        for one in targets:
            self.note(Use(one, str(tool), str(base) if posed else ""))
        return None

    def note(self, use: Use) -> None:
        """Note a motion, of those that are alike the first."""
        self.last = use.target.place
        alike = (*use.target.place, use.tool, use.base)
        if alike not in self._met:
            self._met.add(alike)
            self.uses.append(use)


_CONSTANT = re.compile(r"(?:(?:\d+|#\w+)(?:,(?:\d+|#\w+))*\])?")
"""The index of an element that the text names."""


def array(name: str) -> str:
    """The array of an element; other names as they are."""
    return name.partition("[")[0]


def constant(name: str) -> bool:
    """Whether a name is no element whose index is computed."""
    return _CONSTANT.fullmatch(name.partition("[")[2]) is not None


def finished(found: Reading, file: str, text: str, notation: Notation) -> Program:
    """The program, with all that the language did not account for among what is left."""
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
    targets, left = gathered([*_steady(found)], changed)
    places = {one.place for one in targets}
    follow = [one._replace(counts=place not in places) for one, place in found.following]
    every = sorted({*found.left, *left, *follow, *_spare(found)})
    own, other = ([one for one in every if (one.file == file) is mine] for mine in (True, False))
    return Program(
        file, text, notation, tuple(targets), tuple(own), tuple(other), found.tools, found.bases
    )


_FRAMED = "is a frame of other points, which would move with it"


def _steady(found: Reading) -> Iterator[Use]:
    """Motions whose tool and frame are as declared; the others are left."""
    for use in found.uses:
        frames = (use.tool, use.base)
        moved = next((one for one in frames if found.unsettled(one)), None)
        if moved is None:
            yield use
        else:
            why = f"{use.target.name} stands in {moved}, which {found.unsettled(moved)}"
            found.left.append(Left(use.target.file, use.target.line, why))


def _overlooked(found: Reading, source: Source) -> None:
    """Words like motions that the language has not understood."""
    known = found._mask(source)
    for word in found.lexicon.motion.finditer(source.plain):
        at = word.start(word.lastindex or 0)
        if not known[at]:
            said = " ".join(word[word.lastindex or 0].split())
            found.leave(source, at, f"{said} is no motion known here")


def _hand_over(found: Reading, source: Source) -> None:
    """Points, frames and coordinates that other routines get: they may be changed or moved to."""
    names = {*found.points, *found.tools, *found.bases}
    known, names = found._mask(source), (names | {array(name) for name in names}) - {""}
    for at, name, to in _mentions(source, found.lexicon, names):
        if known[at]:
            continue
        if not name:
            if to is not None:
                to = "what is not known here" if to == ":=" else to
                found.leave(source, at, f"coordinates are handed to {to}, which may move there")
        elif to is None:
            found.read.add(name)
        elif to == ":=":
            found.change(name, source, at)
        else:
            why = f"is handed to {to} on line {source.line(at)}, which may change it or move there"
            found.unsettle(name, why)


_TOKEN = re.compile(
    r"(?P<switch>\\\s*)?(?<![\w$#.])(?P<name>[A-Za-z_]\w*)|(?P<sign>[()\[\]{};\n]|:=)"
)
_SET = re.compile(r"\s*(?:[\[{][^\[\]{};\r\n]*[\]}]\s*){0,3}(?:\s*\.\s*\w+)*\s*:?=(?!=)")
_STARTS = frozenset({"then", "else", "do", "endif", "endfor", "endwhile", "error"})
_NO_CALL = _STARTS | {"if", "elif", "elseif", "while", "until", "and", "or", "not", "xor", "exor"}


def _mentions(
    source: Source, lexicon: Lexicon, names: set[str]
) -> Iterator[tuple[int, str, str | None]]:
    """Where names stand, and what gets them: a routine, an assignment, or what only reads them.

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
    """What stands of a statement before a token.

    Attributes:
        lexicon: Of its language.
        calls: What each open bracket is of, innermost last: a routine, empty where there is none.
        head: Its first word.
        before: The word just before.
        assigned: Whether it assigns.
        optional: Whether the name of an optional argument is just before.
    """

    lexicon: Lexicon
    calls: list[str] = field(default_factory=list)
    head: str = ""
    before: str = ""
    assigned: bool = False
    optional: bool = False

    def follow(self, token: re.Match[str]) -> None:
        """Go on behind a token."""
        word, sign = token["name"] or "", token["sign"]
        if sign == self.lexicon.end and not (self.calls and self.lexicon.cased):
            self.calls, self.head, self.assigned = [], "", False
        elif sign == ":=":
            self.assigned |= not self.optional
        elif sign:
            self._bracket(sign)
        self.optional = bool(token["switch"])
        self.head = "" if word.lower() in _STARTS else self.head or word
        self.before = word

    def _bracket(self, sign: str) -> None:
        outer = self.calls[-1] if self.calls else ""
        if sign in "([{":
            called = sign == "(" and self.before.lower() not in _NO_CALL
            self.calls.append((self.before if called else "") or outer)
        elif sign in ")]}" and self.calls:
            self.calls.pop()

    def getter(self, source: Source, token: re.Match[str]) -> str | None:
        """What gets a name: a routine, an assignment (`:=`); None for what only reads it."""
        called = self.calls[-1] if self.calls else ""
        if called:
            return None if called.lower() in self.lexicon.reading else called
        if _SET.match(source.plain, token.end()):
            return ":="
        return (self.head or "a routine") if self.lexicon.statements and not self.assigned else None


def _spare(found: Reading) -> Iterator[Left]:
    """Points that no motion names: they count where something else does."""
    for name, several in found.points.items():
        if name in found.named | found.steady | found.framed:
            continue
        why = found.unsettled(name)
        counts = why is not None or not found.read.isdisjoint((name, array(name)))
        for one in several:
            word = one.name if isinstance(one, Target) else name
            said = why or "is taught, and no motion here goes to it"
            yield Left(one.file, one.line, f"{word} {said}", counts)
