"""The stiffness of every joint beside its nominal value, and over the campaigns of a robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from pipeline.answer.contract import Answer, Stiffness
from pipeline.answer.history import trends
from pipeline.base.arrays import Array
from pipeline.base.quantities import common_prefix, percent, plain, prefixed
from pipeline.report import words
from pipeline.report.figures.marks import Tips
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables
from pipeline.report.svg import BLUE, MUTED, RED

# --- beside the nominal values -------------------------------------------------------------


@dataclass(frozen=True)
class _Share:
    """A stiffness over its nominal value, with its standard uncertainty and 95 % interval.

    Attributes:
        name: Of the stiffness.
        value: 1 where it is as nominal.
        std: In the same unit.
        low: Lower limit of the interval.
        high: Upper limit; infinite where the compliance may be zero.
        beside: What joint springs alone say; NaN where nothing else, or nothing.
    """

    name: str
    value: float
    std: float
    low: float
    high: float
    beside: float

    @property
    def endless(self) -> bool:
        """Whether it has no upper limit."""
        return not np.isfinite(self.high)


def _shares(answer: Answer) -> list[_Share]:
    """The joints that have a value and a nominal one."""
    other = words.beside(answer)
    alone = {joint.name: joint.value for joint in other[1].stiffness} if other else {}
    return [share for joint in answer.stiffness for share in _share(joint, alone.get(joint.name))]


def _share(joint: Stiffness, beside: float | None) -> Iterator[_Share]:
    value, std, nominal = joint.value, joint.std, joint.nominal
    if value is None or std is None or not nominal:
        return
    low, high = joint.ci95
    yield _Share(
        name=joint.name,
        value=value / nominal,
        std=std / nominal,
        low=(value - 1.96 * std if low is None else low) / nominal,
        high=(np.inf if high is None else high) / nominal,
        beside=(beside or np.nan) / nominal,
    )


def _draw_stiffness(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Every joint with its 95 % interval, in percent of nominal."""
    shares = _shares(answer)
    canvas.set_size_inches(5.6, 0.9 + 0.28 * len(shares))
    axes = canvas.subplots()
    at = np.arange(len(shares))
    share, low, high, other = (
        100 * np.array([getattr(one, part) for one in shares])
        for part in ("value", "low", "high", "beside")
    )
    axes.axvline(100, color=MUTED, linewidth=1, linestyle="--")
    endless = ~np.isfinite(high)
    shown = np.concatenate([share[~endless], low, high[~endless], [100.0]])
    right = shown.max() + 0.08 * max(np.ptp(shown), 1.0)
    axes.hlines(at, low, np.where(endless, right, high), BLUE, lw=2.2)
    beyond = share > right  # a value without upper limit may be anywhere
    for which, key in ((endless & ~beyond, None), (beyond, "beyond")):
        where = np.full(which.sum(), right)
        axes.scatter(where, at[which], color=BLUE, marker=">", s=30, gid=key)
    near = np.abs(other - shown.mean()) < np.ptp(shown)  # a wrong unit would squeeze all others
    axes.scatter(other[near], at[near], facecolors="none", edgecolors=MUTED, s=34, zorder=2)
    axes.scatter(share[~beyond], at[~beyond], color=BLUE, s=26, gid="share", zorder=3)
    axes.set_yticks(at, [one.name for one in shares])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Stiffness [% of nominal]")
    said = list(map(_tip, shares))
    return {
        "share": [words for words, far in zip(said, beyond, strict=True) if not far],
        "beyond": [words for words, far in zip(said, beyond, strict=True) if far],
    }


def _tip(one: _Share) -> str:
    low, high = plain(100 * one.low), plain(100 * one.high)
    limits = f"above {low} %" if one.endless else f"{low} % to {high} %"
    return f"{one.name}: {plain(100 * one.value)} % of nominal, {limits}"


def _circles(answer: Answer) -> str:
    """What the open circles of the interval plot are."""
    other = words.beside(answer)
    there = other and any(joint.value for joint in other[1].stiffness)
    return f" Open circles, where they are near: {other[0]}." if other and there else ""


def _write_stiffness(answer: Answer, tables: Tables) -> Figure | None:
    shares = _shares(answer)
    if not shares:
        return None
    endless = [one.name for one in shares if one.endless]
    compared = [one for one in shares if not one.endless] or shares
    softest = min(compared, key=lambda one: one.value)
    stiffest = max(compared, key=lambda one: one.value)
    widest = max(compared, key=lambda one: one.std)
    said = (
        f"{softest.name} is at {percent(softest.value, 3)} and {stiffest.name} at "
        f"{percent(stiffest.value, 3)} of its nominal value; {widest.name} has the widest interval"
        + (f", and {', '.join(endless)} no upper limit." if endless else ".")
    )
    return Figure(
        "stiffness",
        "Stiffness as a share of the nominal value",
        f"{said} Bars are 95 % intervals, an arrow has no upper limit: where one does not reach "
        f"the line at 100 %, the joint differs from nominal by more than the measurement's "
        f"uncertainty.{_circles(answer)}",
        f"Interval plot of {len(shares)} joint stiffnesses relative to nominal. {said}",
    )


STIFFNESS = Plot("stiffness", _write_stiffness, _draw_stiffness)

# --- over the campaigns --------------------------------------------------------------------


@dataclass(frozen=True)
class _Point:
    """A stiffness in one campaign, with its 95 % interval, in the joint's unit.

    Attributes:
        at: Number of the campaign.
        campaign: Its name.
        value: Stiffness.
        low: Lower limit.
        high: Upper limit; infinite without one.
        unit: Of all three.
    """

    at: int
    campaign: str
    value: float
    low: float
    high: float
    unit: str


def draw_history(canvas: Canvas, answers: Sequence[Answer]) -> Tips:
    """One row per joint: its stiffness in each campaign."""
    found = trends(answers)
    canvas.set_size_inches(5.6, 0.7 + 0.85 * len(found))
    views = canvas.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    tips = {}
    for index, (view, joint) in enumerate(zip(views, found, strict=True)):
        key, points = f"history-{index}", list(_points(answers, joint.name))
        colour = RED if joint.sure else BLUE
        tips[key] = _draw_course(view, joint.name, points, colour, key)
    _name_campaigns(views[-1], answers)
    return tips


def _points(answers: Sequence[Answer], name: str) -> Iterator[_Point]:
    """One joint in the campaigns that give it a value."""
    for at, one in enumerate(answers):
        for joint in one.stiffness:
            if joint.name == name and joint.value is not None:
                low, high = joint.ci95
                bottom = joint.value if low is None else low
                top = np.inf if high is None else high
                yield _Point(at, one.campaign, joint.value, bottom, top, joint.unit)


def _draw_course(
    view: Axes, name: str, points: Sequence[_Point], colour: str, key: str
) -> list[str]:
    """One joint over the campaigns, and what its marks say."""
    factor, letter = common_prefix(point.value for point in points)
    at = np.array([point.at for point in points])
    value, low, high = (_scaled(points, part, factor) for part in ("value", "low", "high"))
    endless = ~np.isfinite(high)
    top = np.concatenate([value, high[~endless]]).max(initial=0.0)
    view.vlines(at, low, np.where(endless, top, high), color=colour, linewidth=1.6)
    view.scatter(at[endless], np.full(endless.sum(), top), color=colour, marker="^", s=20)
    view.scatter(at, value, color=colour, s=16, zorder=3, gid=key)
    unit = prefixed(points[0].unit, letter) if points else ""
    view.set_ylabel(f"{name}\n[{unit}]", fontsize=7.5)
    view.yaxis.set_major_locator(MaxNLocator(3))
    return [
        f"{point.campaign}: {name} {plain(v, 4)}, "
        + (f"{plain(a, 4)} to {plain(b, 4)}" if np.isfinite(b) else f"above {plain(a, 4)}")
        for point, v, a, b in zip(points, value, low, high, strict=True)
    ]


def _scaled(points: Sequence[_Point], part: str, factor: float) -> Array:
    return np.array([getattr(point, part) for point in points]) / factor


def _name_campaigns(view: Axes, answers: Sequence[Answer]) -> None:
    """The campaigns along the axis, by day where each has its own; as many as fit."""
    step = max(1, -(-len(answers) // 8))
    days = [(one.measured or "")[:10] for one in answers]
    distinct = len(set(days)) == len(days) and all(days)
    names = days if distinct else [one.campaign[-24:] for one in answers]
    view.set_xticks(range(0, len(answers), step), names[::step], rotation=20, ha="right")
    view.set_xlim(-0.5, len(answers) - 0.5)
