"""A robot program as text with targets in it, and how corrected numbers are written into it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Literal, NamedTuple

from pipeline.base.arrays import Array
from pipeline.base.errors import listed
from pipeline.programs.inverse import Range
from pipeline.programs.notation import Notation

_Kind = Literal["joint", "cartesian"]

NUMBER_PATTERN = r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?"
_PARTS = re.compile(r"([-+]?)(\d*)(?:\.(\d*))?(?:([eE])([-+]?)(\d+))?")
_LARGEST = 1e10
"""Limit for all numbers of a target, whatever their unit; ABB writes 9E9 for an absent axis."""
FINE_M = 1e-6
"""Resolution to which numbers are written [m]; no tracker resolves less. If the last digit is worth
more, decimals are added."""
_WHOLE = 1e-9
"""Rounding error that is ignored in a number of digits [1]."""


class Number(NamedTuple):
    """A number and its place in a text.

    Attributes:
        start: Index of its first character.
        end: Index behind its last character.
        value: As written, in the unit of the program.
    """

    start: int
    end: int
    value: float


def number(start: int, text: str) -> Number | None:
    """A number written from `start` on; None if it is too large for any robot."""
    value = float(text)
    return Number(start, start + len(text), value) if abs(value) < _LARGEST else None


class Uncorrected(NamedTuple):
    """Something that is not corrected, and why.

    Attributes:
        file: Name of its file.
        line: Line in that file, from 1.
        why: Reason in words.
        counts: Whether it moves the tool to where it was taught while corrected points are
            elsewhere.
    """

    file: str
    line: int
    why: str
    counts: bool = True


@dataclass(frozen=True)
class Target:
    """A taught point.

    Attributes:
        name: Name in the program.
        file: Name of its file.
        line: Line in that file, from 1.
        kind: Axis values or a pose.
        numbers: Six axis values, or the numbers of a pose, in the order of the notation.
        external: Values of external axes as written, mm or degrees, those that are given.
        tool: Name of its tool; empty for the one that the options give.
        base: Name of the frame of its coordinates; likewise.
        ranges: Range of each axis of the arm.
        near: Axis values near it, in the unit of the program, if stated.
    """

    name: str
    file: str
    line: int
    kind: _Kind
    numbers: tuple[Number, ...]
    external: tuple[float, ...] = ()
    tool: str = ""
    base: str = ""
    ranges: tuple[Range, ...] = ()
    near: tuple[float, ...] = ()

    @property
    def values(self) -> tuple[float, ...]:
        """Values of its numbers."""
        return tuple(number.value for number in self.numbers)

    @property
    def place(self) -> tuple[str, int]:
        """Identifies it: file, and place of its first number."""
        return self.file, self.numbers[0].start


@dataclass(frozen=True)
class Program:
    """A program.

    Attributes:
        file: Name of the file.
        text: Its characters, one per byte.
        notation: How it writes poses.
        targets: Its points, and those of its companion file, in the order of the motions to them.
        left: What is not corrected in it.
        elsewhere: What is not corrected in its companion file.
        tools: Tool frames that it defines, in the flange frame, by name, each (4, 4).
        bases: Frames that it defines, in the controller's world frame, by name, each (4, 4).
    """

    file: str
    text: str
    notation: Notation
    targets: tuple[Target, ...]
    left: tuple[Uncorrected, ...] = ()
    elsewhere: tuple[Uncorrected, ...] = ()
    tools: Mapping[str, Array] = field(default_factory=dict)
    bases: Mapping[str, Array] = field(default_factory=dict)

    @property
    def own(self) -> tuple[Target, ...]:
        """The targets in this file."""
        return tuple(target for target in self.targets if target.file == self.file)

    def written(self, values: Mapping[tuple[str, int], Sequence[float]]) -> Program:
        """The same program with other numbers, in their number of decimals or more if needed.

        Args:
            values: New numbers of targets, in the unit of the program, by their places.
        """
        changes = [
            (number, _rewritten(self.text[number.start : number.end], float(value), float(worth)))
            for target in self.own
            if target.place in values
            for number, value, worth in zip(
                target.numbers, values[target.place], self._worth(target), strict=True
            )
        ]
        pieces, at = [], 0
        for number, new in sorted(changes):
            pieces += [self.text[at : number.start], new]
            at = number.end
        return replace(self, text="".join([*pieces, self.text[at:]]))

    def rounded(self, target: Target, values: Sequence[float]) -> list[float]:
        """New numbers of a target as they are rounded when written."""
        return [
            float(_rewritten(self.text[number.start : number.end], float(value), float(worth)))
            for number, value, worth in zip(
                target.numbers, values, self._worth(target), strict=True
            )
        ]

    def _worth(self, target: Target) -> list[float]:
        if target.kind == "joint":
            return [self.notation.worth_of_joint] * len(target.numbers)
        return self.notation.worth_of_pose.tolist()


def _rewritten(old: str, value: float, worth: float) -> str:
    """A number in the format of another one.

    Args:
        old: The other one, as written.
        value: The number.
        worth: Displacement of the tool per unit of the number [m].
    """
    found = _PARTS.fullmatch(_decimal(old))
    if found is None:
        raise ValueError(f"{old} is no number")
    sign, whole, fraction, letter, _, digits = found.groups(default="")
    power = Decimal(repr(value)).adjusted() if letter and value else 0
    least = math.ceil(math.log10(worth / FINE_M) - _WHOLE) + power
    decimals = max(len(fraction), least)
    new = format(Decimal(repr(value)), f"z.{decimals}{letter.lower() or 'f'}")
    if Decimal(new) == Decimal(_decimal(old)):
        return old
    if letter:
        new = _with_exponent(new, letter, found[5], len(digits))
    elif not whole:
        new = _without_zero(new, value)
    return f"+{new}" if sign == "+" and not new.startswith("-") else new


def _decimal(text: str) -> str:
    """Decimal digits of a number that KUKA writes in binary or hexadecimal, 'B010' or 'H9C0'."""
    if not text.startswith("'"):
        return text
    word = text.strip("'").strip()
    return str(int(word[1:].strip(), 16 if word[0] in "hH" else 2))


def _without_zero(new: str, value: float) -> str:
    """`.5` for `0.5` and `-.5` for `-0.5`; others unchanged."""
    return new.replace("0.", ".", 1) if abs(value) < 1 else new


def _with_exponent(new: str, letter: str, sign: str, digits: int) -> str:
    """A number with its exponent in the format of another: letter, sign and number of digits."""
    mantissa, _, exponent = new.partition("e")
    own = "-" if exponent.startswith("-") else "+" if sign else ""
    return f"{mantissa}{letter}{own}{exponent.lstrip('+-').zfill(digits)}"


class MotionUse(NamedTuple):
    """A motion to a point, with the tool and frame in force."""

    target: Target
    tool: str
    base: str


def gathered(
    uses: Iterable[MotionUse], changed: Mapping[tuple[str, int], str]
) -> tuple[list[Target], list[Uncorrected]]:
    """Each point once, in the order of the motions to it, with its tool and frame.

    A point that is changed, or used with several tools or frames, is listed as not corrected.

    Args:
        uses: The motions.
        changed: Places of points that may not be as taught when the robot moves to them, and why.
    """
    frames: dict[tuple[str, int], dict[tuple[str, str], Target]] = {}
    for target, tool, base in uses:
        base = "" if target.kind == "joint" else base
        placed = replace(target, tool=tool, base=base)
        frames.setdefault(target.place, {}).setdefault((tool, base), placed)
    targets, left = [], []
    for place, found in frames.items():
        first, *more = found.values()
        if place in changed:
            left.append(Uncorrected(first.file, first.line, f"{first.name} {changed[place]}"))
        elif more:
            places = listed(sorted(" in ".join(filter(None, one)) or "none" for one in found))
            why = f"{first.name} is used with different tools or frames ({places})"
            left.append(Uncorrected(first.file, first.line, why))
        else:
            targets.append(first)
    return targets, left
