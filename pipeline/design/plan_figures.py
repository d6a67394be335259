"""Figures of a plan: every pose from the side and from above, the criterion along a quantity."""

from __future__ import annotations

from pipeline.annex.words import Axes as AxisNames
from pipeline.annex.words import from_twins
from pipeline.report.svg import BLUE, GREEN, INK, MUTED, RED, SERIES, Drawing, drawn

# svg.py imports Matplotlib, which must not read the settings of the current folder
# isort: split
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import MARKERS, dots, legend_above, legend_below, title
from pipeline.base.arrays import Array
from pipeline.base.language import Say
from pipeline.base.quantities import plain
from pipeline.design.curves import ByAnchor, BySize
from pipeline.design.discriminate import Detectability
from pipeline.design.measurement import Measurement
from pipeline.design.problem import Problem
from pipeline.machine.robot import configure
from pipeline.report.figures.plot import Tips

_AROUND_M = 1.0
"""Space around robot and anchor in the pictures [m]."""
_EDGE = 30.0
"""Right edge in typical sizes [1], where a cause is drawn that is detected at no size."""


def pose_picture(
    problem: Problem, measurement: Measurement, number: int, say: Say = str
) -> Drawing:
    """One pose from the side and from above, with rail, floor, chain and anchor."""
    robot = problem.robot
    at = configure(robot, measurement.q[number][None])
    tool = at.points(np.vstack([problem.tool.load_point, problem.tool.points]))[0]
    arm = np.vstack([at.origin[0], at.flange_origin])
    across = 1 if robot.prismatic[0] else 0
    views = ((across, 2, "from the side"), (across, 1 - across, "from above"))

    def draw(canvas: Canvas) -> Tips:
        canvas.set_size_inches(5.6, 2.9)
        for axes, (h, v, name) in zip(canvas.subplots(1, 2), views, strict=True):
            _view(axes, problem, arm, tool, measurement.anchor, (h, v))
            title(axes, say(name))
            for one, label in zip(*axes.get_legend_handles_labels(), strict=True):
                one.set_label(say(label))
        legend_below(canvas)
        return {}

    return drawn(f"pose-{number + 1}", draw)


def _view(
    axes: Axes, problem: Problem, arm: Array, tool: Array, anchor: Array, plane: tuple[int, int]
) -> None:
    h, v = plane
    all_points = np.vstack([arm, tool, anchor])
    low, high = all_points.min(axis=0) - _AROUND_M / 2, all_points.max(axis=0) + _AROUND_M / 2
    if problem.robot.prismatic[0]:
        rail = [problem.lower[0], problem.upper[0]]
        axes.plot(rail, [0, 0], color=MUTED, linewidth=4, alpha=0.5, label="rail")
    if v == 2:
        axes.axhline(anchor[2], color=MUTED, linewidth=1.2, label="floor")
        low[2] = min(low[2], anchor[2] - 0.1)
    axes.plot(arm[:, h], arm[:, v], color=INK, linewidth=2.4, marker="o", markersize=3, label="arm")
    effector = np.vstack([arm[-1], tool[0]])
    axes.plot(effector[:, h], effector[:, v], color=INK, linewidth=1.2)
    axes.scatter(tool[1:, h], tool[1:, v], color=BLUE, s=12, zorder=3, label="reflectors")
    chain = np.vstack([tool[0], anchor])
    axes.plot(chain[:, h], chain[:, v], color=RED, linewidth=1.4, linestyle="--", label="chain")
    axes.scatter(anchor[h], anchor[v], color=RED, marker="s", s=22, zorder=3)
    middle, half = (low + high) / 2, float(max(high[h] - low[h], high[v] - low[v])) / 2
    across, up = ((middle[axis] - half, middle[axis] + half) for axis in plane)
    axes.set(xlim=across, ylim=up, aspect="equal")
    axes.set(xlabel=f"{'xyz'[h]} [m]", ylabel=f"{'xyz'[v]} [m]")


def size_curves(curves: BySize, scale: float, label: str, name: str = "size") -> Drawing:
    """The criterion against the number of readings, one curve per number of poses: Fig. 5."""

    def draw(canvas: Canvas) -> Tips:
        axes = canvas.subplots()
        tips: Tips = {}
        for k, m0 in enumerate(curves.poses):
            known = np.isfinite(curves.figure[k])
            x, y = curves.readings[known], scale * curves.figure[k, known]
            colour, marker = SERIES[k % len(SERIES)], MARKERS[k % len(MARKERS)]
            axes.plot(x, y, color=colour, linewidth=1.2)
            texts = [f"{m0} poses, {n} readings: {plain(f, 4)}" for n, f in zip(x, y, strict=True)]
            style = {"color": colour, "marker": marker, "s": 24, "label": f"{m0} poses"}
            tips |= dots(axes, f"poses-{m0}", x, y, texts, **style)
        axes.set(xlabel="Readings n", ylabel=label, ylim=(0, None))
        axes.legend(loc="upper right")
        return tips

    return drawn(name, draw)


def anchor_curve(curve: ByAnchor, scale: float, label: str, name: str = "anchor") -> Drawing:
    """The criterion against the anchor's position, poses chosen anew and poses kept: Fig. 6."""

    def draw(canvas: Canvas) -> Tips:
        axes = canvas.subplots()
        kept = scale * curve.fixed_poses
        axes.plot(curve.at, kept, color=MUTED, linewidth=1.2, label="poses of the plan kept")
        best = scale * curve.figure
        axes.plot(curve.at, best, color=BLUE, linewidth=1.2)
        pairs = zip(curve.at, best, strict=True)
        texts = [f"{x:.2f} m: {plain(y, 4)}" for x, y in pairs if np.isfinite(y)]
        style = {"color": BLUE, "s": 20, "label": "poses chosen anew"}
        tips = dots(axes, "best", curve.at, best, texts, **style)
        axes.set(xlabel=f"{'xyz'[curve.axis]} of the anchor [m]", ylabel=label, ylim=(0, None))
        axes.legend(loc="lower right")
        return tips

    return drawn(name, draw)


def sight_chart(sights: list[Detectability], axes_of: AxisNames, name: str = "sights") -> Drawing:
    """Size from which each cause is detected and named, in multiples of its typical size."""
    shown = sorted(sights, key=lambda sight: -min(sight.named_from, 1e6))
    names = [from_twins(sight.name, axes_of) for sight in shown]

    def draw(canvas: Canvas) -> Tips:
        canvas.set_size_inches(5.6, 0.9 + 0.15 * len(shown))
        axes = canvas.subplots()
        at = np.arange(len(shown))
        sizes = np.array([(s.detected_from, s.named_from) for s in shown]).T
        inside = np.minimum(sizes, _EDGE)
        axes.axvline(1, color=MUTED, linewidth=1, linestyle="--")
        axes.hlines(at, *inside, color=MUTED, linewidth=0.8)
        kinds = zip(("noticed", "named"), sizes, inside, (GREEN, BLUE), "oD", strict=True)
        tips: Tips = {}
        for key, each, x, colour, marker in kinds:
            texts = [f"{n}: {key} from {plain(size)}" for n, size in zip(names, each, strict=True)]
            style = {"color": colour, "marker": marker, "s": 13, "zorder": 3}
            tips |= dots(axes, key, x, at, texts, label=key, **style)
        axes.set_xscale("log")
        axes.set_xlim(0.005, _EDGE * 1.15)
        axes.set_xticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
        axes.set_yticks(at, names, fontsize=6.5)
        axes.set_ylim(-1, len(shown))
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Smallest size [typical sizes]; at the right edge: no size", loc="right")
        legend_above(axes, 2)
        return tips

    return drawn(name, draw)
