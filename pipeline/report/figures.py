"""The pictures: each draws what its caption in captions.py speaks of, from the same digest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from pipeline.diagnosis.nextpose import APART
from pipeline.report import words
from pipeline.report.captions import DRAWS, SETS, cause_in_words, comparable
from pipeline.report.history import drifts, robots
from pipeline.report.numbers import common_prefix, known, percent, plain, prefixed, with_std
from pipeline.report.summaries import (
    AXES,
    MM,
    MOST,
    Tables,
    arrows,
    courses,
    gain,
    has,
    places,
    pose_rms,
    prediction_error,
    residual_force,
    separability,
    suspects,
    thinned,
    whitened,
)
from pipeline.report.svg import BLUE, GRID, INK, MUTED, RED, SERIES, SHADES, STYLE, Drawing, finish

mpl.use("Agg")

APART_STEPS = (1.0, 2.0, APART, 10.0)
APART_SHADES = SHADES[::2]
"""Dark where two causes are alike."""

Result = Mapping[str, Any]
Tips = dict[str, list[str]]
MARKERS = ("o", "s", "^", "D", "v", "P")


def draw(name: str, result: Result, tables: Tables) -> Drawing:
    """Draw one of the figures of the report."""
    with rc_context(STYLE):
        canvas = Canvas()
        tips = DRAWERS[name](canvas, result, tables)
        return finish(canvas, name, tips)


def _stiffness(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    joints = comparable(result)
    canvas.set_size_inches(5.6, 0.9 + 0.28 * len(joints))
    axes = canvas.subplots()
    at = np.arange(len(joints))
    share = np.array([100 * j["value"] / j["nominal"] for j in joints])
    bounds = np.array([_bounds(j) for j in joints]).T
    axes.axvline(100, color=MUTED, linewidth=1, linestyle="--")
    shown = np.concatenate([share, bounds[np.isfinite(bounds)], [100.0]])
    right = shown.max() + 0.08 * max(np.ptp(shown), 1.0)
    axes.hlines(at, bounds[0], np.where(np.isfinite(bounds[1]), bounds[1], right), BLUE, lw=2.2)
    endless = ~np.isfinite(bounds[1])
    axes.scatter(np.full(endless.sum(), right), at[endless], color=BLUE, marker=">", s=30)
    axes.scatter(share, at, color=BLUE, s=26, gid="share", zorder=3)
    axes.set_yticks(at, [str(j["name"]) for j in joints])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Stiffness [% of nominal]")
    said = [
        f"{j['name']}: {plain(s)} % of nominal, "
        + (f"{plain(low)} % to {plain(high)} %" if np.isfinite(high) else f"above {plain(low)} %")
        for j, s, low, high in zip(joints, share, *bounds, strict=True)
    ]
    return {"share": said}


def _bounds(joint: Mapping[str, Any]) -> tuple[float, float]:
    """The 95 % interval [% of nominal]; a compliance that may be zero has no upper limit."""
    given = [*(joint.get("ci95") or []), None, None][:2]
    low = given[0] if known(given[0]) else joint["value"] - 1.96 * joint["std"]
    high = given[1] if known(given[1]) else np.inf
    return 100 * low / joint["nominal"], 100 * high / joint["nominal"]


def _pose_rms(canvas: Canvas, result: Result, tables: Tables) -> Tips:
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
    _integer_ticks(axes, at, poses["pose"].astype(int).tolist())
    axes.grid(axis="x", visible=False)
    axes.set_ylim(0)
    axes.set_xlabel("Pose")
    axes.set_ylabel("Rms residual per coordinate [mm]")
    _legend_above(axes, 2)
    number = poses["pose"].astype(int)
    tips = {"fitted": [f"pose {p}: {plain(v)} mm" for p, v in zip(number, fitted, strict=True)]}
    if seen.any():
        pairs = zip(number[seen], left_out[seen], strict=True)
        tips["left"] = [f"pose {p}, left out: {plain(v)} mm" for p, v in pairs]
    return tips


def _gain(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    poses = gain(tables["examined"]).dropna()
    axes = canvas.subplots()
    at = np.arange(len(poses))
    before, after = poses["before"].to_numpy(), poses["after"].to_numpy()
    axes.vlines(at, before, after, color=MUTED, linewidth=0.8)
    tips = {}
    kinds = (
        ("before", before, MUTED, "o", "joint springs"),
        ("after", after, RED, "D", "with causes"),
    )
    for key, mm, colour, marker, name in kinds:
        axes.scatter(at, mm, color=colour, marker=marker, s=18, gid=key, label=name, zorder=3)
        pairs = zip(poses["pose"].astype(int), mm, strict=True)
        tips[key] = [f"pose {pose} left out, {name}: {plain(v)} mm" for pose, v in pairs]
    _integer_ticks(axes, at, poses["pose"].astype(int).tolist())
    axes.set_ylim(0)
    axes.grid(axis="x", visible=False)
    axes.set_xlabel("Pose left out")
    axes.set_ylabel("Rms error per coordinate [mm]")
    _legend_above(axes, 2)
    return tips


def _evidence(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    best = suspects(tables["diagnosis"])
    canvas.set_size_inches(5.6, 0.9 + 0.24 * len(best))
    axes = canvas.subplots()
    at = np.arange(len(best))
    named = best["named"].to_numpy(bool)
    size = best["log_evidence"].to_numpy(float)
    axes.barh(at, size, color=np.where(named, RED, BLUE).tolist(), height=0.7, gid="evidence")
    axes.axvline(3, color=MUTED, linewidth=1, linestyle="--")
    said = [cause_in_words(row) for _, row in best.iterrows()]
    axes.set_yticks(at, [f"{s} (named)" if n else s for s, n in zip(said, named, strict=True)])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Evidence, natural log of the odds")
    rows = zip(said, size, named, strict=True)
    return {"evidence": [f"{s}: {plain(v, 2)}{', named' if n else ''}" for s, v, n in rows]}


def _separability(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    apart = separability(tables["separability"])
    names, n = [words.from_label(label) for label in apart.index], len(apart)
    canvas.set_size_inches(5.6, 1.6 + 0.13 * n)
    axes = canvas.subplots()
    rows, columns = np.tril_indices(n, -1)
    sigmas = apart.to_numpy()[rows, columns]
    steps = np.searchsorted(APART_STEPS, sigmas, "right")
    size = min(0.13, 3.4 / n) * 72  # of a square, in points
    for step, shade in enumerate(APART_SHADES):
        here = steps == step
        low, high = [0, *APART_STEPS][step], [*APART_STEPS, None][step]
        said = f"{low:g} to {high:g} σ" if high else f"above {low:g} σ"
        key = f"apart-{step}"
        axes.scatter(
            columns[here],
            rows[here],
            s=(0.9 * size) ** 2,
            marker="s",
            color=shade,
            linewidths=0,
            gid=key,
            label=said,
        )
    axes.set_yticks(range(1, n), names[1:], fontsize=6)
    axes.set_xticks(range(n - 1), names[:-1], fontsize=6, rotation=90)
    axes.set_ylim(n - 0.4, 0.4)
    axes.set_xlim(-0.6, n - 1.4)
    axes.grid(visible=False)
    axes.legend(loc="upper right", title="Apart by")
    tips = {}
    for step in range(len(APART_SHADES)):
        here = np.flatnonzero(steps == step)
        tips[f"apart-{step}"] = [
            f"{names[rows[i]]} or {names[columns[i]]}: {plain(sigmas[i], 2)} σ" for i in here
        ]
    return {key: said for key, said in tips.items() if said}


def _integer_ticks(axes: Axes, at: np.ndarray, names: Sequence[int]) -> None:
    step = max(1, int(np.ceil(len(at) / 22)))
    axes.set_xticks(at[::step], [str(name) for name in names[::step]])


def _legend_above(axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    at = sorted(range(len(labels)), key=lambda i: isinstance(handles[i], PathCollection))
    axes.legend(
        [handles[i] for i in at],
        [labels[i] for i in at],
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=columns,
        borderaxespad=0.2,
        markerscale=1.6,
        handletextpad=0.4,
    )


def _residual_force(canvas: Canvas, result: Result, tables: Tables) -> Tips:
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
            for r in _rows(part)
        ]
    axes.set_xlabel("Size of the pull [N]")
    axes.set_ylabel("Residual, base frame [mm]")
    _legend_above(axes, 3)
    return tips


def _residual_course(canvas: Canvas, result: Result, tables: Tables) -> Tips:
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
                for r, x, y in zip(_rows(known), at, mm, strict=True)
            ]
        view.set_xlabel(f"{one.name[0].upper()}{one.name[1:]} [{one.unit}]")
        view.set_ylabel("Residual [mm]")
    _legend_above(views[0], 2)
    return tips


def _whitened(canvas: Canvas, result: Result, tables: Tables) -> Tips:
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
    _legend_above(axes, 2)
    bars = zip(edges[:-1], count, strict=True)
    return {"count": [f"{a:g} to {a + 0.5:g} σ: {n}" for a, n in bars]}


def _arrows(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    vectors = arrows(tables["residuals"], places(tables), tables["forces"])
    size = np.linalg.norm(vectors[["rx", "ry", "rz"]].to_numpy(float), axis=1)
    vectors, longest = thinned(vectors, size, MOST // 5), size.max()
    wide = np.ptp(vectors["y"]) >= 2 * max(np.ptp(vectors["x"]), np.ptp(vectors["z"]))
    canvas.set_size_inches(5.6, 4.4 if wide else 3.2)
    views = canvas.subplots(2, 1, sharex=True) if wide else canvas.subplots(1, 2)
    spread = max(float(np.ptp(vectors[a])) for a in "xyz") or 1.0
    usual = float(np.quantile(size, 0.8))  # one outlier must not make all others invisible
    scale = max(usual / 0.08, longest / 0.4, 1e-9) / spread
    tips: Tips = {}
    keyed: list[Quiver] = []
    across = "y"
    for view, up, name in zip(views, "xz", ("from above", "from the side"), strict=True):
        key = f"view-{up}"
        quiver = view.quiver(
            vectors[across],
            vectors[up],
            vectors[f"r{across}"],
            vectors[f"r{up}"],
            angles="xy",
            scale_units="xy",
            scale=scale,
            width=0.0032 if wide else 0.006,
            color=RED,
        )
        quiver.set_gid(key)  # not earlier: the key below copies all arguments, this one too
        keyed.append(quiver)
        view.scatter(vectors[across], vectors[up], s=5, color=INK, linewidths=0)
        ends = (
            vectors[[across, up]].to_numpy() + vectors[[f"r{across}", f"r{up}"]].to_numpy() / scale
        )
        view.update_datalim(ends)
        view.autoscale_view()
        view.set_aspect("equal", adjustable="datalim")
        view.set_title(name, fontsize=8.5, loc="left")
        view.set_ylabel(f"{up} [m]")
        if not wide or up == "z":
            view.set_xlabel(f"{across} [m]")
        tips[key] = [
            f"pose {r.pose}, {r.target}: {plain(r.rx)}, {plain(r.ry)}, {plain(r.rz)} mm"
            for r in _rows(vectors)
        ]
    key_length = _round_down(max(usual, 0.2 * longest))
    views[0].quiverkey(
        keyed[0],
        0.88,
        1.07,
        key_length,
        f"{key_length:g} mm",
        labelpos="E",
        coordinates="axes",
        color=RED,
    )
    return tips


def _rows(table: pd.DataFrame) -> Iterator[Any]:
    """Rows with their columns as attributes."""
    return table.itertuples()


def _round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-300)))
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-12)) * power)


def _workspace(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    return _map(canvas, tables["workspace"], levels_of(tables))


def _workspace_extended(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    return _map(canvas, tables["workspace_extended"], levels_of(tables))


def levels_of(tables: Tables) -> np.ndarray:
    """The steps of both maps, so that equal shades mean equal deflection [µm/N]."""
    names = [name for name in ("workspace", "workspace_extended") if has(tables, name)]
    size = np.concatenate([1e6 * tables[n]["worst_m_per_n"].to_numpy(float) for n in names])
    ticks = MaxNLocator(len(SHADES), steps=[1, 2, 2.5, 5, 10])
    return np.asarray(ticks.tick_values(size.min(), size.max()))


def _map(canvas: Canvas, soft: pd.DataFrame, levels: np.ndarray) -> Tips:
    swept, here = soft[soft["row"] >= 0].reset_index(drop=True), soft.iloc[0]
    canvas.set_size_inches(5.6, 3.9)
    axes = canvas.subplots()
    per_newton = 1e6 * swept["worst_m_per_n"].to_numpy(float)
    shades = [SHADES[i] for i in np.linspace(0, 8, len(levels) - 1).round().astype(int)]
    net = Triangulation(swept["reach_m"], swept["height_m"], _triangles(swept))
    filled = axes.tricontourf(net, per_newton, levels=levels, colors=shades)
    canvas.colorbar(filled, ax=axes, label="Deflection per newton, softest direction [µm/N]")
    axes.scatter(swept["reach_m"], swept["height_m"], s=1.2, color=GRID, linewidths=0, gid="soft")
    axes.scatter(
        here["reach_m"], here["height_m"], s=60, marker="X", color=RED, edgecolors=INK, gid="here"
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("Reach from the shoulder axis [m]")
    axes.set_ylabel("Height [m]")
    return {"soft": [_softness(r) for r in _rows(swept)], "here": ["test pose: " + _softness(here)]}


def _softness(row: Any) -> str:
    per_newton = with_std(1e6 * row.worst_m_per_n, 1e6 * row.std_m_per_n)
    return f"reach {row.reach_m:.2f} m, height {row.height_m:.2f} m: {per_newton} µm/N"


def _triangles(swept: pd.DataFrame) -> np.ndarray:
    """Two triangles for every mesh of the joint grid whose four corners are there, (k, 3)."""
    at = {(int(r.row), int(r.column)): i for i, r in enumerate(_rows(swept))}
    corners = ((0, 0), (1, 0), (0, 1), (1, 1))
    meshes = [[at.get((r + a, c + b)) for a, b in corners] for r, c in at]
    whole = [mesh for mesh in meshes if None not in mesh]
    return np.array([[m[i] for i in side] for m in whole for side in ((0, 1, 2), (1, 3, 2))])


def _registration(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    readings = tables["registration"].reset_index(drop=True).assign(at=lambda t: t.index + 1)
    size = np.linalg.norm(readings[AXES].to_numpy(float), axis=1)
    readings = thinned(readings, size, MOST // 5)
    views = canvas.subplots(3, 1, sharex=True, sharey=True)
    targets = list(dict.fromkeys(readings["target"]))
    at = readings["at"].to_numpy()
    tips = {}
    for view, axis in zip(views, "xyz", strict=True):
        mm = MM * readings[f"d{axis}_m"].to_numpy(float)
        view.axhline(0, color=MUTED, linewidth=0.8)
        for index, target in enumerate(targets):
            here = (readings["target"] == target).to_numpy() & np.isfinite(mm)
            key = f"base-{axis}-{index}"
            view.scatter(
                at[here],
                mm[here],
                s=14,
                color=SERIES[index % len(SERIES)],
                marker=MARKERS[index % len(MARKERS)],
                linewidths=0,
                gid=key,
                label=f" {target}",  # legends leave out what begins with an underscore
            )
            tips[key] = [
                f"reading {n}, {target}: d{axis} = {plain(v)} mm"
                for n, v in zip(at[here], mm[here], strict=True)
            ]
        view.margins(y=0.25)
        view.set_ylabel(f"d{axis} [mm]")
    views[-1].set_xlabel("Reading of a base reflector, in order")
    views[-1].xaxis.set_major_locator(MaxNLocator(10, integer=True))
    if len(targets) <= 8:
        _legend_above(views[0], min(len(targets), 6))
    return tips


def _prediction(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    errors = prediction_error(tables["validation"])
    axes = canvas.subplots()
    tips = {}
    steps = np.linspace(0, 1, 41)
    for index, ((where, draw_from), mu) in enumerate(errors.items()):
        at, key = 100 * np.quantile(mu, steps), f"mu-{index}"
        if at[4] <= 0:  # no stiffness had a value to draw about, and zero has no logarithm
            continue
        name = f"{SETS.get(where, where)}, {DRAWS.get(draw_from, draw_from)}"
        style = "-" if draw_from == "covariance" else "--"
        colour = SERIES[list(SETS).index(where) if where in SETS else 2]
        axes.plot(at, 100 * steps, style, color=colour, linewidth=1.6, label=name)
        axes.scatter(at[4:-1:4], 100 * steps[4:-1:4], s=9, color=colour, linewidths=0, gid=key)
        tips[key] = [
            f"{name}: {plain(100 * s)} % of the poses below {percent(v / 100)}"
            for s, v in zip(steps[4:-1:4], at[4:-1:4], strict=True)
        ]
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("Relative error of the predicted deflection [%]")
    axes.set_ylabel("Poses below [%]")
    axes.grid(color=GRID, linewidth=0.6)
    _legend_above(axes, 2)
    return tips


DRAWERS: dict[str, Callable[[Canvas, Result, Tables], Tips]] = {
    "stiffness": _stiffness,
    "prediction": _prediction,
    "gain": _gain,
    "evidence": _evidence,
    "separability": _separability,
    "pose-rms": _pose_rms,
    "residual-force": _residual_force,
    "residual-course": _residual_course,
    "whitened": _whitened,
    "arrows": _arrows,
    "workspace": _workspace,
    "workspace-extended": _workspace_extended,
    "registration": _registration,
}


def draw_history(name: str, results: Sequence[Result]) -> Drawing:
    """Draw the history of one robot: `history-0` is the first of `overview.robots`."""
    own = list(robots(results).values())[int(name.rpartition("-")[2])]
    with rc_context(STYLE):
        canvas = Canvas()
        return finish(canvas, name, _history(canvas, own))


def _history(canvas: Canvas, results: Sequence[Result]) -> Tips:
    found = drifts(results)
    canvas.set_size_inches(5.6, 0.7 + 0.85 * len(found))
    views = canvas.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    tips = {}
    for index, (view, joint) in enumerate(zip(views, found, strict=True)):
        points = _points(results, joint.name)
        factor, letter = common_prefix(value for _, value, _, _ in points)
        colour = RED if joint.sure else BLUE
        at = np.array([p[0] for p in points])
        value, low, high = (np.array([p[k] for p in points]) / factor for k in (1, 2, 3))
        endless = ~np.isfinite(high)
        top = np.concatenate([value, high[~endless]]).max(initial=0.0)
        view.vlines(at, low, np.where(endless, top, high), color=colour, linewidth=1.6)
        view.scatter(at[endless], np.full(endless.sum(), top), color=colour, marker="^", s=20)
        view.scatter(at, value, color=colour, s=16, zorder=3, gid=f"history-{index}")
        view.set_ylabel(f"{joint.name}\n[{_unit(results, joint.name, letter)}]", fontsize=7.5)
        view.yaxis.set_major_locator(MaxNLocator(3))
        tips[f"history-{index}"] = [
            f"{results[i].get('campaign')}: {joint.name} {plain(v, 4)}, "
            + (f"{plain(a, 4)} to {plain(b, 4)}" if np.isfinite(b) else f"above {plain(a, 4)}")
            for i, v, a, b in zip(at, value, low, high, strict=True)
        ]
    step = max(1, -(-len(results) // 8))
    days = [str(r.get("measured") or "")[:10] for r in results]
    distinct = len(set(days)) == len(days) and all(days)
    names = days if distinct else [str(r.get("campaign"))[-24:] for r in results]
    views[-1].set_xticks(range(0, len(results), step), names[::step], rotation=20, ha="right")
    views[-1].set_xlim(-0.5, len(results) - 0.5)
    return tips


def _points(results: Sequence[Result], name: str) -> list[tuple[int, float, float, float]]:
    """Number of the campaign, stiffness and its 95 % interval, where there is a value."""
    out = []
    for at, result in enumerate(results):
        for joint in result.get("stiffness") or []:
            if joint.get("name") == name and known(joint.get("value")) and known(joint.get("std")):
                low, high = [*(joint.get("ci95") or []), None, None][:2]
                out.append(
                    (
                        at,
                        float(joint["value"]),
                        float(low) if known(low) else float(joint["value"]),
                        float(high) if known(high) else float("inf"),
                    )
                )
    return out


def _unit(results: Sequence[Result], name: str, letter: str) -> str:
    units = [
        j.get("unit") for r in results for j in r.get("stiffness") or [] if j.get("name") == name
    ]
    return prefixed(str(units[0] or ""), letter)
