"""The force at each target of a program, from its remarks, section by section, or from a table.

A remark with the comment sign of the language (`;` KRL, `!` RAPID and TP, `#` URScript) applies
from its line to the next such remark; before the first, no force acts:

    ; FORCE 0, 0, -800                            N, as --force
    ; CUT kc=1100 depth=2 feed=0.15 axial=0.3     N/mm2, mm, mm per tooth or turn
    ; FORCE OFF                                   entry, exit, ways

A cutting force is F = k_c a f opposite to the motion of the tool, and `axial` times as much pushes
the tool back along its axis; k_c is the specific cutting force (Kienzle), a the depth and f the
feed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError, listed
from pipeline.base.strict import LEAST_FORCE
from pipeline.machine.robot import Robot, configure
from pipeline.programs.aim import Aimed
from pipeline.programs.joint_path import FORCES
from pipeline.programs.languages import language
from pipeline.programs.program import NUMBER_PATTERN, Target
from pipeline.readers import logs

_WORDS = ("kc", "depth", "feed", "axial")
_MEANT = "write FORCE fx, fy, fz in N, FORCE OFF, or CUT kc=.. depth=.. feed=.. axial=.."
_TOWARDS = 1e-6
"""Smallest distance of points that defines a direction of motion [m]."""


@dataclass(frozen=True, eq=False)
class _Section(Locked):
    """Force or cut that applies from a remark on.

    Attributes:
        line: Line of the remark; 0 before the first.
        force: Force on the robot [N], shape (3,); zero for a cut.
        cut: Magnitudes of the force against the motion and of that along the tool's axis [N].
    """

    line: int
    force: Array
    cut: tuple[float, float] | None = None

    def same(self, other: _Section) -> bool:
        """Whether force and cut are the same."""
        return self.cut == other.cut and bool(np.array_equal(self.force, other.force))


@dataclass(frozen=True, eq=False)
class Forces:
    """Force or cut at each target, in the order of the targets."""

    each: tuple[_Section, ...]

    @property
    def cuts(self) -> bool:
        """Whether some forces depend on the direction of motion."""
        return any(one.cut is not None for one in self.each)

    def at(self, robot: Robot, aimed: Aimed) -> Array:
        """Forces on the robot [N], shape (m, 3), as given; those of cuts are in F_b.

        Args:
            robot: The robot.
            aimed: Its joint values at the targets, in the order of the motions.
        """
        out = np.array([one.force for one in self.each])
        if not self.cuts:
            return out
        tips, turned = tips_of(robot, aimed)
        for k, one in enumerate(self.each):
            if one.cut is not None:
                against, back = one.cut
                out[k] = -against * self._ahead(tips, k) - back * turned[k, :, 2]
        return out

    def _ahead(self, tips: Array, k: int) -> Array:
        """Direction of motion: from the previous target to the next one of the same section."""
        here, last = self.each[k], len(tips) - 1
        first = max(k - 1, 0)
        after = k + 1 if k < last and self.each[k + 1].same(here) else k
        way = tips[after] - tips[first]
        far = float(np.linalg.norm(way))
        return way / far if far > _TOWARDS else np.zeros(3)


_NONE = _Section(0, np.zeros(3))


def tips_of(robot: Robot, aimed: Aimed) -> tuple[Array, Array]:
    """Points where the force acts in F_b [m], (m, 3), and orientations of the tools, (m, 3, 3)."""
    at = configure(robot, aimed.q)
    tips = at.flange_origin + np.einsum("mij,mj->mi", at.flange_axes, aimed.tip)
    return tips, at.flange_axes @ aimed.tool[:, :3, :3]


def stated(sources: Mapping[str, str], targets: Sequence[Target]) -> Forces | None:
    """Forces from the remarks of a program; None if no remark states a force.

    Args:
        sources: Text of its files by name.
        targets: Its targets.

    Raises:
        InputError: A remark cannot be read, or a point is used in sections of different forces.
    """
    found = {file: _sections(file, text) for file, text in sources.items()}
    if not any(found.values()):
        return None
    uses = {file: _lines(text) for file, text in sources.items() if found[file]}
    return Forces(tuple(_of(target, found, uses) for target in targets))


def _of(
    target: Target, found: Mapping[str, list[_Section]], uses: Mapping[str, list[str]]
) -> _Section:
    """Force at a target: at the lines that name it, or if there are none, at its own line."""
    word = re.compile(_mention(target.name))
    at = [
        (file, number)
        for file, lines in uses.items()
        for number, line in enumerate(lines, 1)
        if word.search(line) and (file, number) != (target.file, target.line)
    ]
    places = at or [(target.file, target.line)]
    acting = [_acting(found.get(file, []), line) for file, line in places]
    for other, (file, line) in zip(acting, places, strict=True):
        if not other.same(acting[0]):
            raise InputError(
                f"{target.name} is moved to in sections of different forces (lines "
                f"{listed(str(line) for _, line in places)})",
                "teach a point of its own for each section",
                file=file,
                line=line,
            )
    return acting[0]


def _mention(name: str) -> str:
    """Pattern of a point's name where it is used; in TP, of its number."""
    numbered = re.fullmatch(r"P\s*\[\s*(\d+).*\]?", name, re.IGNORECASE)
    if numbered:
        return rf"(?i)\bP\s*\[\s*{numbered[1]}(?!\d)"
    return rf"(?i)(?<![\w$]){re.escape(name)}(?!\w|\s*:?=)"


def _acting(sections: Sequence[_Section], line: int) -> _Section:
    return next((one for one in reversed(sections) if one.line < line), _NONE)


def _lines(text: str) -> list[str]:
    """Lines of a program; those below /POS contain no motion."""
    return re.split(r"(?im)^/POS\b", text)[0].splitlines()


def _sections(file: str, text: str) -> list[_Section]:
    sign = language(file).SIGN
    words = re.compile(rf"{sign}[ \t]*(FORCE|CUT)\b[ \t]*([^\r\n]*)", re.IGNORECASE)
    return [
        _section(file, number, one[1].upper(), one[2].rstrip(" \t;"))
        for number, line in enumerate(text.splitlines(), 1)
        if (one := words.search(line))
    ]


def _cut(words: str) -> tuple[float, float] | None:
    """Tangential and axial force of a cut [N]; None if its words do not define one."""
    pairs = dict(re.findall(rf"(\w+)\s*=\s*({NUMBER_PATTERN})", words.lower()))
    if not {*_WORDS[:3]} <= {*pairs} <= {*_WORDS}:
        return None
    kc, depth, feed = (float(pairs[one]) for one in _WORDS[:3])
    force = kc * depth * feed
    if min(kc, depth, feed) <= 0 or force < LEAST_FORCE:
        return None
    return force, force * float(pairs.get("axial", 0))


def _section(file: str, line: int, word: str, words: str) -> _Section:
    """Read one remark.

    Raises:
        InputError: It is neither a force nor a cut.
    """
    if word == "CUT":
        if (force := _cut(words)) is not None:
            return _Section(line, np.zeros(3), force)
    elif words.strip().upper() == "OFF":
        return _Section(line, np.zeros(3))
    elif len(numbers := re.findall(NUMBER_PATTERN, words)) == 3 and not re.sub(
        NUMBER_PATTERN, "", words
    ).strip(", \t"):
        return _Section(line, np.array([float(one) for one in numbers]))
    raise InputError(f'"{word} {words}" is no force', _MEANT, file=file, line=line)


_LINE, _TARGET = logs.Quantity("line", {}), logs.Quantity("target", {}, "name")


def tabled(name: str, data: bytes, targets: Sequence[Target]) -> Forces:
    """Forces from a table: target (or line), fx_n, fy_n, fz_n; none at targets not listed.

    Args:
        name: Name of the table.
        data: Content of the table.
        targets: Targets of the program.

    Raises:
        InputError: A row cannot be read, or names no target.
    """
    by_line = "line" in logs.columns(name, data)
    key = _LINE if by_line else _TARGET
    log = logs.once(logs.table(name, data, [key, *FORCES]), [key.stem])
    for file, line, reason in log.rejected:
        raise InputError(reason, "correct the row", file=file, line=line)
    if by_line:
        keys, names = map(str, log.number["line"].astype(int)), [str(one.line) for one in targets]
    else:
        keys, names = map(_plain, log.word["target"]), [_plain(one.name) for one in targets]
    rows = np.column_stack([log.number[one.stem] for one in FORCES])
    each = dict(zip(keys, map(_Section, log.line.tolist(), rows), strict=True))
    if strange := [one for one in each if one not in names]:
        thing = f'the program has no target {"in line " * by_line}"{strange[0]}"'
        raise InputError(thing, "correct the row", file=name, line=each[strange[0]].line)
    return Forces(tuple(each.get(one, _NONE) for one in names))


def _plain(name: str) -> str:
    """A name in the form used for comparison: P[3:"a"] is P[3], XP3 is xp3."""
    return re.sub(r"\s|:.*(?=\])", "", name.lower())
