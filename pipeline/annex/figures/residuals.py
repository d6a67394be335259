"""Residuals by pose, over the pull, over rail position, torque and time, and whitened."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from pipeline.annex.figures.marks import MARKERS, dots, integer_ticks, legend_above
from pipeline.annex.summaries import (
    MOST_MARKS,
    courses,
    finite,
    pose_rms,
    residual_force,
    thinned,
    whitened,
)
from pipeline.answer.contract import Answer
from pipeline.answer.words import capital
from pipeline.base.linear import rms
from pipeline.base.quantities import percent, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import BLUE, MUTED, RED, SERIES


def _draw_pose_rms(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw a bar for each pose, and a diamond for its error when it is left out."""
    poses = pose_rms(tables["residuals"])
    axes = canvas.subplots()
    at, number = np.arange(len(poses)), poses["pose"].astype(int).to_numpy()
    fitted, left_out = poses["fitted"].to_numpy(), poses["left_out"].to_numpy()
    axes.bar(at, fitted, color=BLUE, alpha=0.8, width=0.7, gid="fitted", label="in the estimate")
    tips = {"fitted": [f"pose {p}: {plain(v)} mm" for p, v in zip(number, fitted, strict=True)]}
    seen = np.isfinite(left_out)
    if seen.any():
        pairs = zip(number[seen], left_out[seen], strict=True)
        texts = [f"pose {p}, left out: {plain(v)} mm" for p, v in pairs]
        style = {"color": RED, "marker": "D", "s": 18, "zorder": 3}
        tips |= dots(axes, "left", at[seen], left_out[seen], texts, label="left out", **style)
    integer_ticks(axes, at, number.tolist())
    axes.grid(axis="x", visible=False)
    axes.set(xlabel="Pose", ylabel="Rms residual per coordinate [mm]", ylim=(0, None))
    legend_above(axes, 2)
    return tips


def _draw_residual_force(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw every residual coordinate over the force of its pull."""
    points = residual_force(tables)
    points = thinned(points, points["mm"].to_numpy(float))
    axes = canvas.subplots()
    axes.axhline(0, color=MUTED, linewidth=0.8)
    tips: Tips = {}
    styles = zip(cycle(SERIES), cycle(MARKERS), strict=True)  # six axes where poses are read as one
    for (axis, part), (colour, marker) in zip(points.groupby("axis"), styles, strict=False):
        texts = [
            f"{_coordinate(r)}: {plain(r.mm)} mm at {plain(r.force_n)} N" for r in each_row(part)
        ]
        style = {"color": colour, "marker": marker, "s": 11, "alpha": 0.7, "linewidths": 0}
        at = part["force_n"], part["mm"]
        tips |= dots(axes, f"axis-{axis}", *at, texts, label=axis, **style)
    axes.set(xlabel="Size of the pull [N]", ylabel="Residual, base frame [mm]")
    legend_above(axes, 3)
    return tips


def _coordinate(row: Any) -> str:
    """Pose, pull, target and axis of a row."""
    return f"pose {row.pose}, pull {row.repeat}, {row.target} {row.axis}"


def _draw_residual_course(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw every residual coordinate over rail position, torque and time."""
    rows, told = courses(tables, answer.axes)
    canvas.set_size_inches(5.6, 0.5 + 1.5 * len(told))
    views = canvas.subplots(len(told), 1, sharey=True, squeeze=False)[:, 0]
    kinds = [("mm", "o", 10, BLUE, "joint springs")]
    if not np.allclose(rows["mm"], rows["mm_extended"], equal_nan=True):
        kinds.append(("mm_extended", "D", 7, RED, "with the identified causes"))
    tips: Tips = {}
    for view, one in zip(views, told, strict=True):
        known = finite(rows, one.column, "mm")
        known = thinned(known, known["mm"].to_numpy(float), MOST_MARKS // 40)
        view.axhline(0, color=MUTED, linewidth=0.8)
        for column, marker, size, colour, name in kinds:
            at, mm = known[one.column], known[column]
            texts = [
                f"{_coordinate(r)}: {plain(y)} mm at {plain(x)} {one.unit}, {name}"
                for r, x, y in zip(each_row(known), at, mm, strict=True)
            ]
            style = {"color": colour, "marker": marker, "s": size, "linewidths": 0}
            tips |= dots(view, f"{one.column}-{column}", at, mm, texts, label=name, **style)
        view.set(xlabel=f"{capital(one.name)} [{one.unit}]", ylabel="Residual [mm]")
    legend_above(views[0], 2)
    return tips


def _draw_whitened(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw a histogram of the whitened residuals with the normal curve."""
    values = whitened(tables["residuals"])
    reach = float(np.clip(np.abs(values).max(), 4, 12))
    edges = np.arange(-np.ceil(reach), np.ceil(reach) + 0.25, 0.5)
    count, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    axes = canvas.subplots()
    style: dict[str, Any] = {"width": 0.5, "align": "edge", "color": BLUE, "alpha": 0.75}
    axes.bar(edges[:-1], count, gid="count", label="readings", **style)
    at = np.linspace(edges[0], edges[-1], 241)
    normal = len(values) * 0.5 * np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi)
    axes.plot(at, normal, color=RED, linewidth=1.6, label="noise as assumed")
    axes.set(xlabel="Residual [standard deviations]", ylabel="Coordinates")
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.grid(axis="x", visible=False)
    legend_above(axes, 2)
    bars = zip(edges[:-1], count, strict=True)
    return {"count": [f"{a:g} to {a + 0.5:g} σ: {n}" for a, n in bars]}


def _write_pose_rms(answer: Answer, tables: Tables) -> Figure:
    poses = pose_rms(tables["residuals"])
    worst = poses.iloc[int(poses["fitted"].argmax())]
    text = (
        f"Pose {int(worst['pose'])} is the worst with {plain(worst['fitted'])} mm; the median of "
        f"all {len(poses)} poses is {plain(poses['fitted'].median())} mm."
    )
    left_out = poses["left_out"].dropna()
    if len(left_out):
        text += f" In cross-validation the largest error of a pose is {plain(left_out.max())} mm."
    return Figure(
        "pose-rms",
        "Residual of each pose",
        f"{text} A diamond far above its bar marks a pose that the others do not predict.",
        f"Bar chart of the rms residual per pose, with a marker for the pose left out. {text}",
    )


def _write_residual_force(answer: Answer, tables: Tables) -> Figure | None:
    points = residual_force(tables)
    if points.empty:
        return None
    low, high = points["force_n"].min(), points["force_n"].max()
    text = (
        f"Pulls reach from {plain(low)} N to {plain(high)} N and the largest residual of a "
        f"coordinate is {plain(points['mm'].abs().max())} mm."
    )
    return Figure(
        "residual-force",
        "Residual against pull",
        f"{text} An even band is noise; a band that opens or bends with the pull is an effect that "
        f"grows with load, such as a joint that hardens.",
        f"Scatter plot of {len(points)} residual coordinates against the size of the pull. {text}",
    )


def _write_residual_course(answer: Answer, tables: Tables) -> Figure | None:
    if "residual_extended_m" not in tables["examined"]:
        return None
    _, told = courses(tables, answer.axes)
    if not told:
        return None
    text = "Means over six steps of " + ", ".join(
        f"{one.name} explain {percent(one.explained)} of the variance of the residuals of the "
        "joint springs"
        if k == 0
        else f"of {one.name} {percent(one.explained)}"
        for k, one in enumerate(told)
    )
    found = answer.diagnosis.causes
    diamonds = "; diamonds are the residuals with the causes in the model" if found else ""
    text += f"; noise alone would give {percent(told[0].by_chance)} on average."
    return Figure(
        "residual-course",
        "Residual against " + ", ".join(one.name for one in told),
        f"{text} A band that bends, steps or drifts indicates an effect that the joint springs do "
        f"not have{diamonds}.",
        f"{len(told)} scatter plots of residual coordinates. {text}",
    )


def _write_whitened(answer: Answer, tables: Tables) -> Figure | None:
    values = whitened(tables["residuals"])
    if not len(values):
        return None
    spread, beyond = rms(values), int(np.sum(np.abs(values) > 3))
    expected = 0.0027 * len(values)
    text = (
        f"Their spread is {plain(spread)} where 1 is expected; {beyond} of {len(values)} lie "
        f"beyond ±3 where about {plain(expected, 2)} are expected."
    )
    return Figure(
        "whitened",
        "Residuals in standard deviations",
        f"{text} Bars that follow the curve are noise as assumed; wide shoulders are a missing "
        f"effect or noise that is stated too small.",
        f"Histogram of weighted residuals with the normal curve. {text}",
    )


POSE_RMS = Plot("pose-rms", ("residuals",), _write_pose_rms, _draw_pose_rms)
RESIDUAL_FORCE = Plot(
    "residual-force", ("residuals", "forces"), _write_residual_force, _draw_residual_force
)
RESIDUAL_COURSE = Plot(
    "residual-course", ("examined",), _write_residual_course, _draw_residual_course
)
WHITENED = Plot("whitened", ("residuals",), _write_whitened, _draw_whitened)
