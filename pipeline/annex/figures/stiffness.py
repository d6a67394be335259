"""The stiffness of every joint relative to its nominal value."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from pipeline.annex.words import springs_alone
from pipeline.answer.contract import Answer, Stiffness
from pipeline.base.arrays import Array
from pipeline.base.quantities import percent, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, interval
from pipeline.report.svg import BLUE, MUTED

# --- beside the nominal values -------------------------------------------------------------


def _comparable(answer: Answer) -> list[Stiffness]:
    """The joints with both an estimated and a nominal stiffness."""
    return [joint for joint in answer.stiffness if joint.value is not None and joint.nominal]


def _beside(answer: Answer, joints: Sequence[Stiffness]) -> Array:
    """Stiffnesses from joint springs on the data as given, shape (n,).

    NaN where they have no value, or where these are the answer's own values.
    """
    other = springs_alone(answer)
    values = {joint.name: joint.value for joint in other[1].stiffness} if other else {}
    return np.array([values.get(joint.name) for joint in joints], dtype=float)


_SQUEEZED = 1 / 3
"""Share of the plot's width [1] below which all other intervals together are too short to be
compared beside a wide one."""


def _frame(low: Array, high: Array) -> tuple[float, float]:
    """Left and right end of the plot [% of nominal]; the widest intervals may extend beyond.

    The widest interval is cut off as long as the others take less than a third of the width needed
    with it. An interval without an upper limit counts by its lower limit only.
    """
    top = np.where(np.isfinite(high), high, low)
    kept = np.argsort(high - low, kind="stable").tolist()
    while len(kept) > 1 and np.ptp(_ends(low, top, kept[:-1])) < _SQUEEZED * np.ptp(
        _ends(low, top, kept)
    ):
        kept.pop()
    first, last = _ends(low, top, kept)
    margin = 0.08 * max(last - first, 1.0)
    return first - margin, last + margin


def _ends(low: Array, high: Array, rows: list[int]) -> tuple[float, float]:
    """Left and right end of a selection of intervals together with the nominal value."""
    return min([100.0, *low[rows]]), max([100.0, *high[rows]])


def _limits(low: float, high: float) -> str:
    """`73 % to 109 %`, or `above 73 %`."""
    if np.isfinite(high):
        return f"{plain(low)} % to {plain(high)} %"
    return f"above {plain(low)} %"


def _cut_off(axes: Axes, at: Array, told: Array, ends: tuple[float, float]) -> None:
    """Draw arrows where intervals leave the plot, with numbers unless only an infinite limit does.

    Args:
        axes: The plot.
        at: Vertical place of each joint, shape (n,).
        told: Values, lower and upper 95 % limits [% of nominal], shape (3, n).
        ends: Left and right end of the plot [% of nominal].
    """
    (share, low, high), (left, right) = told, ends
    for end, leaves, marker in ((left, low < left, "<"), (right, high > right, ">")):
        axes.scatter(np.full(leaves.sum(), end), at[leaves], color=BLUE, marker=marker, s=30)
    wide = (low < left) | (np.isfinite(high) & (high > right)) | (share > right)
    for k in np.flatnonzero(wide):
        text = f"{plain(share[k])} % ({_limits(low[k], high[k])})"
        place = ((left + right) / 2, at[k])
        axes.annotate(text, place, (0, 3), textcoords="offset points", ha="center", fontsize=7)


def _inside(other: Array, ends: tuple[float, float], *, whole: bool) -> Array:
    """Which circles are drawn, shape (n,); if an interval is cut, only those inside the plot.

    Otherwise they may widen the plot by half its width to each side.

    Args:
        other: Places of the circles [% of nominal], NaN for none, shape (n,).
        ends: Left and right end of the plot [% of nominal].
        whole: Whether no interval is cut.
    """
    left, right = ends
    beyond = (right - left) / 2 if whole else 0.0
    return np.asarray((other >= left - beyond) & (other <= right + beyond))


def _draw_stiffness(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw every joint with its 95 % interval, in percent of nominal."""
    joints = _comparable(answer)
    canvas.set_size_inches(5.6, 0.9 + 0.28 * len(joints))
    axes = canvas.subplots()
    at = np.arange(len(joints), dtype=float)
    nominal = np.array([joint.nominal for joint in joints], dtype=float)
    share, low, high = interval(joints, nominal / 100)
    other = 100 * _beside(answer, joints) / nominal
    axes.axvline(100, color=MUTED, linewidth=1, linestyle="--")
    left, right = _frame(low, high)
    axes.hlines(at, np.maximum(low, left), np.minimum(high, right), BLUE, lw=2.2)
    _cut_off(axes, at, np.array([share, low, high]), (left, right))
    near = _inside(other, (left, right), whole=bool(np.all((low >= left) & (high <= right))))
    axes.scatter(other[near], at[near], facecolors="none", edgecolors=MUTED, s=34, zorder=2)
    beyond = (share < left) | (share > right)
    edge = np.clip(share[beyond], left, right)
    axes.scatter(edge, at[beyond], color=BLUE, s=1, gid="beyond")  # to hover over
    axes.scatter(share[~beyond], at[~beyond], color=BLUE, s=26, gid="share", zorder=3)
    axes.set_yticks(at, [joint.called for joint in joints])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Stiffness [% of nominal]")
    texts = [
        f"{joint.called}: {plain(s)} % of nominal, {_limits(a, b)}"
        for joint, s, a, b in zip(joints, share, low, high, strict=True)
    ]
    return {
        "share": [words for words, far in zip(texts, beyond, strict=True) if not far],
        "beyond": [words for words, far in zip(texts, beyond, strict=True) if far],
    }


def _circles(answer: Answer) -> str:
    """Sentence on the open circles of the interval plot."""
    other = springs_alone(answer)
    there = other and any(joint.value for joint in other[1].stiffness)
    return f" Open circles, where they lie within the plot: {other[0]}." if other and there else ""


def _of_nominal(value: float | None, joint: Stiffness) -> float:
    return (value or 0.0) / (joint.nominal or 1.0)


def _extremes(joints: Sequence[Stiffness]) -> str:
    """Sentence on the softest, the stiffest and the least certain joint relative to nominal.

    Joints without an upper limit are listed separately.
    """
    off = {joint.called: _of_nominal(joint.value, joint) for joint in joints}
    std = {joint.called: _of_nominal(joint.std, joint) for joint in joints}
    endless = [joint.called for joint in joints if joint.ci95[1] is None]
    compared = [name for name in off if name not in endless] or list(off)
    softest, stiffest = min(compared, key=off.__getitem__), max(compared, key=off.__getitem__)
    widest = max(compared, key=std.__getitem__)
    if len(off) == 1:
        return f"{softest} is at {percent(off[softest], 3)} of its nominal value."
    return (
        f"{softest} is at {percent(off[softest], 3)} and {stiffest} at {percent(off[stiffest], 3)} "
        f"of its nominal value; {widest} has the widest interval"
        + (f", and {', '.join(endless)} no upper limit." if endless else ".")
    )


def _write_stiffness(answer: Answer, tables: Tables) -> Figure | None:
    joints = _comparable(answer)
    if not joints:
        return None
    extremes = _extremes(joints)
    return Figure(
        "stiffness",
        "Stiffness as a share of the nominal value",
        f"{extremes} Bars are 95 % intervals; an arrow marks one that continues beyond the plot, "
        f"with its numbers, or has no upper limit. A joint whose bar does not reach the line at "
        f"100 % differs from nominal by more than the uncertainty of the measurement."
        f"{_circles(answer)}",
        f"Interval plot of {len(joints)} joint stiffnesses relative to nominal. {extremes}",
    )


STIFFNESS = Plot("stiffness", (), _write_stiffness, _draw_stiffness)
