"""The stiffness of every joint beside its nominal value, and over the campaigns of a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from pipeline.answer.history import trends
from pipeline.base.arrays import Array
from pipeline.base.quantities import common_prefix, known, percent, plain, prefixed
from pipeline.report import words
from pipeline.report.figures.marks import Tips
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Result, Tables
from pipeline.report.svg import BLUE, MUTED, RED


def _draw_stiffness(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Every joint with its 95 % interval, in percent of nominal."""
    joints = _comparable(result)
    canvas.set_size_inches(5.6, 0.9 + 0.28 * len(joints))
    axes = canvas.subplots()
    at = np.arange(len(joints))
    share = np.array([100 * j["value"] / j["nominal"] for j in joints])
    bounds = np.array([_bounds(j) for j in joints]).T
    axes.axvline(100, color=MUTED, linewidth=1, linestyle="--")
    endless = ~np.isfinite(bounds[1])
    shown = np.concatenate([share[~endless], bounds[np.isfinite(bounds)], [100.0]])
    right = shown.max() + 0.08 * max(np.ptp(shown), 1.0)
    axes.hlines(at, bounds[0], np.where(endless, right, bounds[1]), BLUE, lw=2.2)
    beyond = share > right  # a value without upper limit may be anywhere
    for which, key in ((endless & ~beyond, None), (beyond, "beyond")):
        where = np.full(which.sum(), right)
        axes.scatter(where, at[which], color=BLUE, marker=">", s=30, gid=key)
    other = _beside(result, joints)
    near = np.abs(other - shown.mean()) < np.ptp(shown)  # a wrong unit would squeeze all others
    axes.scatter(other[near], at[near], facecolors="none", edgecolors=MUTED, s=34, zorder=2)
    axes.scatter(share[~beyond], at[~beyond], color=BLUE, s=26, gid="share", zorder=3)
    axes.set_yticks(at, [str(j["name"]) for j in joints])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Stiffness [% of nominal]")
    said = [
        f"{j['name']}: {plain(s)} % of nominal, "
        + (f"{plain(low)} % to {plain(high)} %" if np.isfinite(high) else f"above {plain(low)} %")
        for j, s, low, high in zip(joints, share, *bounds, strict=True)
    ]
    return {
        "share": [words for words, far in zip(said, beyond, strict=True) if not far],
        "beyond": [words for words, far in zip(said, beyond, strict=True) if far],
    }


def _beside(result: Result, joints: Sequence[Mapping[str, Any]]) -> Array:
    """What joint springs alone say of these joints [% of nominal], NaN where nothing else."""
    other = words.beside(result)
    values = {j["name"]: j["value"] for j in other[1]["stiffness"]} if other else {}
    return np.array([100 * (values.get(j["name"]) or np.nan) / j["nominal"] for j in joints])


def _bounds(joint: Mapping[str, Any]) -> tuple[float, float]:
    """The 95 % interval [% of nominal]; a compliance that may be zero has no upper limit."""
    given = [*(joint.get("ci95") or []), None, None][:2]
    low = given[0] if known(given[0]) else joint["value"] - 1.96 * joint["std"]
    high = given[1] if known(given[1]) else np.inf
    return 100 * low / joint["nominal"], 100 * high / joint["nominal"]


def draw_history(canvas: Canvas, results: Sequence[Result]) -> Tips:
    """One row per joint: its stiffness in each campaign."""
    found = trends(results)
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


def _comparable(result: Result) -> list[Mapping[str, Any]]:
    """Stiffnesses that have a value, an uncertainty and a nominal value to be shown beside."""
    return [
        joint
        for joint in result.get("stiffness") or []
        if joint.get("identifiable", True)
        and known(joint.get("nominal"))
        and joint["nominal"]
        and known(joint.get("value"))
        and known(joint.get("std"))
    ]


def _circles(result: Result) -> str:
    """What the open circles of the interval plot are."""
    other = words.beside(result)
    there = other and any(joint["value"] for joint in other[1]["stiffness"])
    return f" Open circles, where they are near: {other[0]}." if other and there else ""


def _write_stiffness(result: Result, tables: Tables) -> Figure | None:
    joints = _comparable(result)
    if not joints:
        return None
    endless = [str(j["name"]) for j in joints if not all(map(known, j.get("ci95") or [None]))]
    off = {str(j["name"]): j["value"] / j["nominal"] for j in joints}
    off = {name: share for name, share in off.items() if name not in endless} or off
    softest, stiffest = min(off, key=off.__getitem__), max(off, key=off.__getitem__)
    widest = max(
        (j for j in joints if str(j["name"]) in off), key=lambda j: j["std"] / j["nominal"]
    )
    said = (
        f"{softest} is at {percent(off[softest], 3)} and {stiffest} at {percent(off[stiffest], 3)} "
        f"of its nominal value; {widest['name']} has the widest interval"
        + (f", and {', '.join(endless)} no upper limit." if endless else ".")
    )
    return Figure(
        "stiffness",
        "Stiffness as a share of the nominal value",
        f"{said} Bars are 95 % intervals, an arrow has no upper limit: where one does not reach "
        f"the line at 100 %, the joint differs from nominal by more than the measurement's "
        f"uncertainty.{_circles(result)}",
        f"Interval plot of {len(joints)} joint stiffnesses relative to nominal. {said}",
    )


STIFFNESS = Plot("stiffness", _write_stiffness, _draw_stiffness)
