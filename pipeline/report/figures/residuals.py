"""What the fit leaves: by pose, by pull, along what varies, in standard deviations."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from pipeline.base.quantities import plain
from pipeline.report.figures.marks import MARKERS, Tips, each_row, integer_ticks, legend_above
from pipeline.report.summaries import (
    MOST,
    Result,
    Tables,
    courses,
    pose_rms,
    residual_force,
    thinned,
    whitened,
)
from pipeline.report.svg import BLUE, MUTED, RED, SERIES


def draw_pose_rms(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """A bar for each pose, and a diamond for the pose left out."""
    poses = pose_rms(tables["residuals"])
    axes = canvas.subplots()
    at = np.arange(len(poses))
    fitted, left_out = poses["fitted"].to_numpy(), poses["left_out"].to_numpy()
    axes.bar(at, fitted, color=BLUE, alpha=0.8, width=0.7, gid="fitted", label="in the estimate")
    seen = np.isfinite(left_out)
    if seen.any():
        axes.scatter(
            at[seen],
            left_out[seen],
            color=RED,
            marker="D",
            s=18,
            gid="left",
            label="left out",
            zorder=3,
        )
    integer_ticks(axes, at, poses["pose"].astype(int).tolist())
    axes.grid(axis="x", visible=False)
    axes.set_ylim(0)
    axes.set_xlabel("Pose")
    axes.set_ylabel("Rms residual per coordinate [mm]")
    legend_above(axes, 2)
    number = poses["pose"].astype(int)
    tips = {"fitted": [f"pose {p}: {plain(v)} mm" for p, v in zip(number, fitted, strict=True)]}
    if seen.any():
        pairs = zip(number[seen], left_out[seen], strict=True)
        tips["left"] = [f"pose {p}, left out: {plain(v)} mm" for p, v in pairs]
    return tips


def draw_residual_force(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Every residual coordinate over the size of its pull."""
    points = residual_force(tables["residuals"], tables["forces"])
    points = thinned(points, points["mm"].to_numpy(float))
    axes = canvas.subplots()
    axes.axhline(0, color=MUTED, linewidth=0.8)
    tips = {}
    for (axis, part), colour, marker in zip(points.groupby("axis"), SERIES, MARKERS, strict=False):
        key = f"axis-{axis}"
        axes.scatter(
            part["force_n"],
            part["mm"],
            color=colour,
            marker=marker,
            s=11,
            alpha=0.7,
            linewidths=0,
            gid=key,
            label=f"{axis}",
        )
        tips[key] = [
            f"pose {r.pose}, pull {r.repeat}, {r.target} {r.axis}: "
            f"{plain(r.mm)} mm at {plain(r.force_n)} N"
            for r in each_row(part)
        ]
    axes.set_xlabel("Size of the pull [N]")
    axes.set_ylabel("Residual, base frame [mm]")
    legend_above(axes, 3)
    return tips


def draw_residual_course(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Every residual coordinate over rail position, torque and time."""
    rows, told = courses(tables)
    canvas.set_size_inches(5.6, 0.5 + 1.5 * len(told))
    views = canvas.subplots(len(told), 1, sharey=True, squeeze=False)[:, 0]
    kinds = [("mm", "o", BLUE, "joint springs")]
    if not np.allclose(rows["mm"], rows["mm_extended"], equal_nan=True):
        kinds.append(("mm_extended", "D", RED, "with the named causes"))
    tips = {}
    for view, one in zip(views, told, strict=True):
        known = rows[np.isfinite(rows[[one.column, "mm"]].to_numpy(float)).all(axis=1)]
        known = thinned(known, known["mm"].to_numpy(float), MOST // 40)
        view.axhline(0, color=MUTED, linewidth=0.8)
        for column, marker, colour, name in kinds:
            key = f"{one.column}-{column}"
            size = 10 if column == "mm" else 7
            at, mm = known[one.column], known[column]
            view.scatter(
                at, mm, color=colour, marker=marker, s=size, linewidths=0, gid=key, label=name
            )
            tips[key] = [
                f"pose {r.pose}, pull {r.repeat}, {r.target} {r.axis}: {plain(y)} mm at "
                f"{plain(x)} {one.unit}, {name}"
                for r, x, y in zip(each_row(known), at, mm, strict=True)
            ]
        view.set_xlabel(f"{one.name[0].upper()}{one.name[1:]} [{one.unit}]")
        view.set_ylabel("Residual [mm]")
    legend_above(views[0], 2)
    return tips


def draw_whitened(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Histogram of weighted residuals beside the normal curve."""
    values = whitened(tables["residuals"])
    reach = float(np.clip(np.abs(values).max(), 4, 12))
    edges = np.arange(-np.ceil(reach), np.ceil(reach) + 0.25, 0.5)
    count, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    axes = canvas.subplots()
    axes.bar(
        edges[:-1],
        count,
        width=0.5,
        align="edge",
        color=BLUE,
        alpha=0.75,
        gid="count",
        label="readings",
    )
    at = np.linspace(edges[0], edges[-1], 241)
    normal = len(values) * 0.5 * np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi)
    axes.plot(at, normal, color=RED, linewidth=1.6, label="noise as assumed")
    axes.set_xlabel("Residual [standard deviations]")
    axes.set_ylabel("Coordinates")
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.grid(axis="x", visible=False)
    legend_above(axes, 2)
    bars = zip(edges[:-1], count, strict=True)
    return {"count": [f"{a:g} to {a + 0.5:g} σ: {n}" for a, n in bars]}
