"""Stiffnesses of one robot over its campaigns, for the page over all of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from pipeline.report.svg import BLUE, RED

# svg.py imports Matplotlib, which must not read the settings of the current folder
# isort: split
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from pipeline.answer.contract import Answer, Stiffness
from pipeline.base.quantities import common_prefix, plain, prefixed
from pipeline.fleet.history import trusted
from pipeline.report.figures.plot import Tips
from pipeline.report.summaries import interval

_Points = Sequence[tuple[int, Answer, Stiffness]]
"""One joint in the campaigns that give it a value, with the number of each campaign."""


def draw_history(canvas: Canvas, answers: Sequence[Answer], changed: Collection[str]) -> Tips:
    """Draw the stiffness in each campaign, one row per joint; those that changed in red.

    Args:
        canvas: An empty figure.
        answers: Answers to the campaigns of one robot, in order.
        changed: Names of the stiffnesses that have changed.
    """
    found = list(dict.fromkeys(joint.name for one in answers for joint in one.stiffness))
    canvas.set_size_inches(5.6, 0.7 + 0.85 * len(found))
    views = canvas.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    tips: Tips = {}
    for index, (view, name) in enumerate(zip(views, found, strict=True)):
        key, points = f"history-{index}", _points(answers, name)
        colour = RED if name in changed else BLUE
        tips[key] = _draw_course(view, _called(answers, name), points, colour, key)
    _name_campaigns(views[-1], answers)
    return tips


def _called(answers: Sequence[Answer], name: str) -> str:
    """Name of a stiffness, `A1 (k_theta2)`, in the last campaign that has the joint."""
    return [joint.called for one in answers for joint in one.stiffness if joint.name == name][-1]


def _points(answers: Sequence[Answer], name: str) -> _Points:
    return [
        (at, one, joint)
        for at, one in enumerate(answers)
        for joint in one.stiffness
        if joint.name == name and joint.value is not None
    ]


def _draw_course(view: Axes, name: str, points: _Points, colour: str, key: str) -> list[str]:
    """Draw one joint over the campaigns, and return the hover texts of its marks."""
    joints = [joint for _, _, joint in points]
    factor, letter = common_prefix(joint.value for joint in joints)
    at = np.array([number for number, _, _ in points])
    value, low, high = interval(joints, factor)
    endless = ~np.isfinite(high)
    top = np.concatenate([value, high[~endless]]).max(initial=0.0)
    view.vlines(at, low, np.where(endless, top, high), color=colour, linewidth=1.6)
    view.scatter(at[endless], np.full(endless.sum(), top), color=colour, marker="^", s=20)
    filled = [colour if trusted(one) else "none" for _, one, _ in points]
    view.scatter(at, value, facecolors=filled, edgecolors=colour, s=16, zorder=3, gid=key)
    unit = prefixed(joints[0].unit, letter) if joints else ""
    view.set_ylabel(f"{name}\n[{unit}]", fontsize=7.5)
    view.yaxis.set_major_locator(MaxNLocator(3))
    return [
        f"{one.campaign}: {name} {plain(v, 4)}, "
        + (f"{plain(a, 4)} to {plain(b, 4)}" if np.isfinite(b) else f"above {plain(a, 4)}")
        for (_, one, _), v, a, b in zip(points, value, low, high, strict=True)
    ]


def _name_campaigns(view: Axes, answers: Sequence[Answer]) -> None:
    """Label as many campaigns along the axis as fit, by day if each has a day of its own."""
    step = max(1, -(-len(answers) // 8))
    days = [(one.measured or "")[:10] for one in answers]
    distinct = len(set(days)) == len(days) and all(days)
    names = days if distinct else [one.campaign[-24:] for one in answers]
    view.set_xticks(range(0, len(answers), step), names[::step], rotation=20, ha="right")
    view.set_xlim(-0.5, len(answers) - 0.5)
