"""Figures of the robot at the test pose: joint stiffnesses, places of causes, deflection."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.annex.figures.sheet import FROM, TO, PixelSheet, View, outlines
from pipeline.answer.conformity import DECIDED, compared
from pipeline.answer.contract import Answer, Placed, Stiffness, TestPose, Tip
from pipeline.answer.words import at_axis, listed
from pipeline.base.arrays import Array
from pipeline.base.language import Say
from pipeline.base.quantities import plain, with_uncertainty
from pipeline.prediction.decision import Decision
from pipeline.report import words
from pipeline.report.beside_nominal import (
    ALIKE,
    LOST,
    NEAR,
    ROUGH,
    SOFT,
    STIFF,
    SURE,
    TELLS,
    WIDE_OPEN,
    JointClass,
    drawn_as,
    stand,
)
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables
from pipeline.report.svg import BLUE, BODY, EDGE, GREEN, GRID, INK, MUTED, PAPER, RED

WIDE, _HIGH, _TOP, _FOOT = 560.0, 420.0, 64.0, 66.0
"""Width and height of the sheet, and heights of its labels (above) and its key (below) [px]."""

_AROUND = 0.36
"""Length of the rail drawn to each side of the robot, over the size of the arm [1]."""

REACH = 0.16
"""Length of the largest displacement as drawn, over the size of the arm [1]."""

_APART = 6.0
"""Minimum distance of two marks, so that neither covers the other [px]."""

_ASIDE = np.deg2rad(28.0)
"""Angle of the view from the side of the arm towards its front [rad]."""


@dataclass(frozen=True, eq=False)
class _DrawnArm:
    """The robot as placed on the sheet.

    Attributes:
        rows: Table POSTURE, with the rail cut to the part near the robot.
        view: The projection.
        scale: Pixels per metre.
        origin: The middle of the view on the sheet [px], shape (2,).
        size: Size of the arm [m].
    """

    rows: pd.DataFrame
    view: View
    scale: float
    origin: Array
    size: float

    def __call__(self, points: Array) -> Array:
        """Project points in F_b [m], shape (..., 3), onto the sheet [px], shape (..., 2)."""
        right, up, _ = self.view(points)
        return np.stack([self.origin[0] + self.scale * right, self.origin[1] - self.scale * up], -1)

    def bodies(self, sheet: PixelSheet, rows: pd.DataFrame, **style: Any) -> None:
        """Draw capsules, the nearer ones over those behind them."""
        near, shapes = outlines(self.view, rows, 0.75 * rows["radius_m"].to_numpy(float))
        for k in np.argsort(near, kind="stable"):
            fill = GRID if rows["part"].iloc[k] == "base" else BODY
            at = self.origin + self.scale * np.asarray(shapes[k]) * (1, -1)
            own: dict[str, Any] = {"fill": fill, "stroke": EDGE, "stroke_width": 0.8}
            sheet.shape(at, **(own | style))

    @cached_property
    def solid(self) -> pd.DataFrame:
        """Rows of the bodies, without points (of radius zero)."""
        return self.rows[self.rows["radius_m"] > 0]

    @cached_property
    def ends(self) -> Array:
        """Both ends of each row [m], shape (c, 2, 3)."""
        return self.rows[[*FROM, *TO]].to_numpy(float).reshape(-1, 2, 3)

    @cached_property
    def joints(self) -> dict[int, Array]:
        """Mark of each joint [px], shape (2,), by number.

        A joint with a carriage is marked in its middle; one whose place is taken by another joint,
        in the middle of its own link.
        """
        found: dict[int, Array] = {}
        parts, numbers = self.rows["part"].to_numpy(str), self.rows["joint"].to_numpy()
        at, amid = self(self.ends[:, 0]), self(self.ends.mean(axis=1))
        for k in np.flatnonzero(parts == "joint"):
            own = np.flatnonzero((parts == "arm") & (numbers == numbers[k]))
            body = np.flatnonzero((parts == "carriage") & (numbers == numbers[k]))
            taken = any(np.hypot(*(at[k] - one)) < _APART for one in found.values())
            own = body if len(body) else own[: int(taken)]
            found[int(numbers[k])] = amid[own[0]] if len(own) else at[k]
        return found

    def place(self, cause: Placed, location: str | None) -> Array | None:
        """Place of a cause [px], shape (2,); None if it is not in the robot."""
        joints, rows = self.joints, self.rows
        if isinstance(cause.where, int):
            return joints.get(cause.where)
        if cause.where is not None:
            named = rows[(rows["name"] == cause.where) & (rows["part"] != "joint")]
            return self(named[TO].to_numpy(float))[0] if len(named) else None
        if location in ("rail", "base"):
            body = np.flatnonzero(rows["part"] == "carriage")
            return self(self.ends[body[0]].mean(axis=0)) if len(body) else joints.get(1)
        at = {"tool": TO, "force": TO, "wrist": FROM}.get(location or "")
        return None if at is None else self(self.tip[at].to_numpy(float))[0]

    @property
    def tip(self) -> pd.DataFrame:
        """The row of the rod to the load point."""
        return self.rows[(self.rows["part"] == "tool") & (self.rows["name"] == "load_point")]


def arm_of(tables: Tables, high: float, top: float) -> _DrawnArm:
    """The robot, as large as fits the width of the sheet and between two heights [px].

    Args:
        tables: Tables of the report, of which POSTURE is used.
        high: Lower end of the picture.
        top: Upper end of the picture.
    """
    rows = tables["posture"]
    moving = rows[rows["part"].isin(("carriage", "arm", "tool"))]
    ends = np.concatenate([moving[FROM].to_numpy(float), moving[TO].to_numpy(float)])
    size = float(np.linalg.norm(np.ptp(ends, axis=0)))
    foot = rows[rows["part"] == "joint"][FROM].to_numpy(float)[0]
    rows = _cut(rows, foot, _AROUND * size)
    tip = moving[TO].to_numpy(float)[-1]
    heading = np.arctan2(*(tip - ends[0])[1::-1])
    view = View(ends.mean(axis=0), size, float(heading - np.pi / 2 - _ASIDE))
    solid = rows[rows["radius_m"] > 0]
    _, shapes = outlines(view, solid, 0.75 * solid["radius_m"].to_numpy(float))
    every = np.concatenate(shapes)
    low, up = every.min(axis=0), every.max(axis=0)
    scale = float(min((WIDE - 40) / (up[0] - low[0]), (high - top) / (up[1] - low[1])))
    middle = np.array([WIDE / 2, (top + high) / 2])
    return _DrawnArm(rows, view, scale, middle - scale * (low + up) / 2 * (1, -1), size)


def _cut(rows: pd.DataFrame, foot: Array, reach: float) -> pd.DataFrame:
    """Cut the rail at `reach` [m] to each side of the robot's foot (F_b, [m])."""
    still = (rows["part"] == "base").to_numpy()[:, None]
    a, b = rows[FROM].to_numpy(float), rows[TO].to_numpy(float)
    length = np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-9)
    along = (b - a) / length
    at = np.sum((foot - a) * along, axis=1, keepdims=True)
    ends = [a + np.clip(at + side * reach, 0, length) * along for side in (-1, 1)]
    cut = np.hstack([np.where(still, *both) for both in zip(ends, (a, b), strict=True)])
    return rows.assign(**dict(zip([*FROM, *TO], cut.T, strict=True)))


# --- what is stated of the joints -----------------------------------------------------------------


_COLOURS = {SOFT: RED, ALIKE: MUTED, STIFF: BLUE, SURE: MUTED, ROUGH: RED}
_COLOURS |= {WIDE_OPEN: PAPER, LOST: PAPER}
_CAUSE = "cause"
_RULES = {
    ALIKE: f"as nominal (within {100 * NEAR:.0f} % or U)",
    WIDE_OPEN: f"too uncertain to tell (U above {100 * TELLS:.0f} %)",
}
"""Words of the key that are printed with their condition."""


# --- the picture ----------------------------------------------------------------------------------


def _draw(answer: Answer, tables: Tables, say: Say = str) -> str:
    """Draw the robot with its joints, causes and deflection."""
    sheet = PixelSheet(WIDE, _HIGH, say)
    arm = arm_of(tables, _HIGH - _FOOT, _TOP)
    arm.bodies(sheet, arm.solid)
    _deflection(sheet, arm, answer)
    draw_causes(sheet, arm, answer)
    stands = {joint.joint: (joint, stand(joint)) for joint in answer.stiffness}
    _joints(sheet, arm, stands)
    known = [one for _, one in stands.values()] if _any(stands.values()) else []
    _key(sheet, known, bool(_seated(arm, answer)))
    return sheet.svg


def _joints(
    sheet: PixelSheet, arm: _DrawnArm, stands: dict[int, tuple[Stiffness, JointClass]]
) -> None:
    """Draw a disc at each joint, and in a row above its name and its ratio to nominal or U."""
    at = {k: place for k, place in arm.joints.items() if k in stands}
    step = (WIDE - 20) / max(len(at), 1)
    told = _any(stands.values())
    for slot, number in enumerate(at):
        joint, one = stands[number]
        x, (jx, jy) = 10 + step * (slot + 0.5), at[number]
        sheet.line((x, 38), (jx, jy), MUTED, 0.8, stroke_opacity=0.7)
        style = {"fill": _COLOURS[one.word], "stroke": INK, "stroke_width": 1.2} | _outline(one)
        beside = f"{one.said} of nominal" if joint.nominal else one.said
        tip = f"{joint.axis or joint.name}: {beside}, {one.word}"
        sheet.disc((jx, jy), 6.5, tip, **style)
        middle = {"text_anchor": "middle"}
        sheet.text(x, 16, drawn_as(joint), 14, font_weight="bold", **middle)
        colour = INK if _COLOURS[one.word] in (MUTED, PAPER) else _COLOURS[one.word]
        if told:
            sheet.text(x, 33, one.said, 13, fill=colour, **middle)


def _outline(one: JointClass) -> dict[str, Any]:
    """Dashed outline for a joint without a value."""
    return {"stroke_dasharray": "2.6 2"} if one.word == LOST else {}


def _any(stands: Iterable[tuple[Stiffness, JointClass]]) -> bool:
    """Whether any joint has a value."""
    return any(joint.value is not None for joint, _ in stands)


def _deflection(sheet: PixelSheet, arm: _DrawnArm, answer: Answer) -> None:
    """Draw the deflection of the load point as an arrow of fixed length."""
    pose, tip = answer.test_pose, arm.tip
    if pose is None or pose.deflection_mm is None or tip.empty:
        return
    moved = tip[[f"to_moved_{a}_m" for a in "xyz"]].to_numpy(float)[0]
    if not moved.any():
        return
    start = tip[TO].to_numpy(float)[0]
    end = start + REACH * arm.size * moved / np.linalg.norm(moved)
    a, b = arm(np.stack([start, end]))
    sheet.arrow(a, b, RED, 3)
    text = f"{next(_judged_deflections(answer)).value} mm"
    below = 14 if b[1] >= a[1] else -8
    x = float(np.clip(b[0], 46, WIDE - 46))
    sheet.text(x, b[1] + below, text, 14, text_anchor="middle", font_weight="bold", fill=RED)


def _seated(arm: _DrawnArm, answer: Answer) -> dict[str, Array]:
    """Causes and their first rivals, in words, with their places in the robot [px], shape (2,).

    If the data contain a mistake, only mistakes are listed.
    """
    found = answer.diagnosis.causes
    wrong = [one for one in found if one.evidence] or found
    each = [(own, one.location) for one in wrong for own in (one, *one.rivals[:1])]
    placed = {words.placed(own): arm.place(own, location) for own, location in each}
    return {one: at for one, at in placed.items() if at is not None}


def draw_causes(sheet: PixelSheet, arm: _DrawnArm, answer: Answer) -> None:
    """Draw a numbered ring at the place of each cause."""
    for k, at in enumerate(_seated(arm, answer).values()):
        sheet.disc(at, 17, fill="none", stroke=RED, stroke_width=3)
        style = {"text_anchor": "middle", "font_weight": "bold", "fill": RED}
        right, down = _BESIDE[k % len(_BESIDE)]
        sheet.text(at[0] + right, at[1] + down, str(k + 1), 15, **style)


_BESIDE = ((-24, 5), (0, 33), (24, 5), (0, -21))
"""Offsets of a ring's number from its centre [px], in turn, as several rings may coincide."""


def _key(sheet: PixelSheet, stands: Sequence[JointClass], rings: bool) -> None:
    """Draw the key of the colours, in rows."""
    dark: dict[str, Any] = {"stroke": INK, "stroke_width": 1}
    marks = {
        _RULES.get(one.word, one.word): {"fill": _COLOURS[one.word]} | dark | _outline(one)
        for one in stands
    }
    if rings:
        marks[_CAUSE] = {"fill": "none", "stroke": RED, "stroke_width": 2.4}
    x, y = 14.0, _HIGH - _FOOT + 16
    for word, style in marks.items():
        wide = 22 + 6.6 * len(sheet.say(word))
        if x + wide > WIDE and x > 14:
            x, y = 14.0, y + 18
        sheet.disc((x, y), 5.5, **style)
        sheet.text(x + 11, y + 4, word, 12)
        x += wide + 8


def _write(answer: Answer, tables: Tables) -> Figure:
    stands = {joint: stand(joint) for joint in answer.stiffness}
    text = "; ".join(f"{j.axis or j.name} {one.said}, {one.word}" for j, one in stands.items())
    seated = _seated(arm_of(tables, _HIGH, 0.0), answer)
    named = [f"{k} = {one}" for k, one in enumerate(seated, 1)]
    sits = f" The rings mark {listed(named)}." if named else ""
    title, moves = _stands_at(answer.test_pose)
    nominal = any(joint.nominal for joint in answer.stiffness)
    what = "Share of the nominal stiffness" if nominal else "Relative uncertainty of the stiffness"
    known = _any(stands.items())
    off = f"; coloured where it is off by more than {100 * NEAR:.0f} % and U" if nominal else ""
    return Figure(
        "certificate",
        title,
        f"{what} of each joint{off}.{sits}" if known else f"Each joint by its name.{sits}",
        f"Drawing: {title}. {what}: {text}.{sits}{moves}",
    )


def _stands_at(pose: TestPose | None) -> tuple[str, str]:
    """Title, and a sentence on the arrow of the deflection; the latter is empty without a pose."""
    if pose is None:
        return "The robot", ""
    arrow = f" The arrow is the deflection, {plain(pose.deflection_mm)} mm."
    return "The robot at the test pose", arrow


CERTIFICATE = Plot("certificate", ("posture",), _write, spoken=_draw)

# --- the gauge ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _JudgedDeflection:
    """A deflection with its expanded uncertainty [mm], the decision on it, and how it follows."""

    name: str
    size: float
    u: float | None
    decision: Decision | None
    why: str

    @property
    def end(self) -> float:
        """Upper end of the interval [mm]."""
        return self.size + (self.u or 0.0)

    @property
    def value(self) -> str:
        """The deflection [mm], rounded as its uncertainty allows."""
        return plain(self.size) if self.u is None else with_uncertainty(self.size, self.u)[0]

    @property
    def said(self) -> str:
        """`0.924 ± 0.072 mm`, with ± U."""
        if self.u is None:
            return f"{self.value} mm, U unknown"
        return f"{self.value} ± {with_uncertainty(self.size, self.u)[1]} mm"


def _why(answer: Answer, one: Tip, decision: Decision | None) -> str:
    """How a deflection leads to its decision; empty without one."""
    asked, holds = answer.tolerance, answer.recommended.reason.holds_for_its_readings
    if asked is None or decision is None:
        return ""
    return compared(one, decision, asked.deflection_mm, holds=holds)


def _judged_deflections(answer: Answer) -> Iterator[_JudgedDeflection]:
    """The deflection at the test pose, and the largest on the path."""
    pose, asked = answer.test_pose, answer.tolerance
    why = partial(_why, answer)
    if pose is not None and pose.deflection_mm is not None:
        decision = asked.test_pose if asked else None
        name = "Test pose" if pose.stated else "Strongest pull"
        because = why(pose, decision)
        yield _JudgedDeflection(name, pose.deflection_mm, pose.expanded_mm, decision, because)
    if asked is not None and asked.path is not None:
        worst = asked.path.largest
        name = f"{asked.path.file}, pose {worst.at}"
        if worst.deflection_mm is not None:
            size, u = worst.deflection_mm, worst.expanded_mm
            yield _JudgedDeflection(name, size, u, worst.decision, why(worst, worst.decision))


_GAUGE = {Decision.PASS: GREEN, Decision.UNDECIDED: BLUE, Decision.FAIL: RED, None: BLUE}
_ACROSS, _LEFT, _RIGHT, _ROW = 440.0, 10.0, 430.0, 60.0
"""Width of the gauge's sheet, left and right ends of its bars, height of a bar with its text
[px]."""

_LETTERS = 46
"""Number of letters of full size that fit above a bar."""


def _draw_gauge(answer: Answer, tables: Tables, say: Say = str) -> str:
    """Draw a bar for each deflection, with a line at the tolerance."""
    judged = list(_judged_deflections(answer))
    most = answer.tolerance.deflection_mm if answer.tolerance else None
    full = 1.15 * max([*(one.end for one in judged), most or 0.0])
    sheet = PixelSheet(_ACROSS, _ROW * len(judged) + 18, say)

    def at(mm: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * mm / full

    for k, one in enumerate(judged):
        y, colour = _ROW * k + 40, _GAUGE[one.decision]
        sheet.line((_LEFT, y), (_RIGHT, y), GRID, 16)
        low, high = max(one.size - (one.u or 0.0), 0.0), one.end
        sheet.line((at(low), y), (at(high), y), colour, 16, stroke_opacity=0.4)
        sheet.arrow((_LEFT, y), (at(one.size), y), colour, 4)
        word = "" if one.decision is None else f": {DECIDED[one.decision]}"
        left, right = (say(each) for each in (f"{one.name}{word}", f"predicted {one.said}"))
        size = 14 * min(1.0, _LETTERS / (len(left) + len(right)))
        sheet.text(_LEFT, y - 15, left, size, font_weight="bold")
        sheet.text(_RIGHT, y - 15, right, size, text_anchor="end")
        if most is not None:
            sheet.line((at(most), y - 12), (at(most), y + 12), INK, 3)
    foot = _ROW * len(judged)
    if most is not None:
        text = f"tolerance {most:g} mm"
        sheet.text(min(at(most), _RIGHT - 60), foot + 13, text, 13, text_anchor="middle")
    sheet.text(_LEFT, foot + 13, "0", 13)
    return sheet.svg


def _write_gauge(answer: Answer, tables: Tables) -> Figure | None:
    judged = list(_judged_deflections(answer))
    if not judged:
        return None
    parts = [
        f"{one.name} {one.said}{'' if one.decision is None else f', {DECIDED[one.decision]}'}"
        for one in judged
    ]
    most = answer.tolerance.deflection_mm if answer.tolerance else None
    limit = "" if most is None else f", beside a tolerance of {most:g} mm"
    text = "; ".join(parts)
    worst = answer.tolerance.worst if answer.tolerance else None
    told = [f"By ISO 14253-1: {one.why}." for one in judged if one.why and one.decision == worst]
    return Figure(
        "gauge",
        "Deflection of the load point",
        " ".join((_only(answer), *told)),
        f"Gauge of the deflection of the load point{limit}, with its expanded uncertainty: {text}.",
    )


def _only(answer: Answer) -> str:
    """Joint values and force to which the prediction is limited."""
    pose, asked = answer.test_pose, answer.tolerance
    path = asked is not None and asked.path is not None
    only = "Predicted for this pose and force only"
    if path:
        only = "Predicted for these poses and forces only; the test pose"
    if pose is None:
        return "Predicted for these poses and forces only."
    axes = ", ".join(f"{one.name} {at_axis(one.value, one.unit)}" for one in pose.axes)
    at = ", ".join(filter(None, (axes, f"{plain(float(np.linalg.norm(pose.force_n)), 4)} N")))
    return f"{only}: {at}."


GAUGE = Plot("gauge", (), _write_gauge, spoken=_draw_gauge)
