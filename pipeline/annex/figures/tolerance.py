"""The machining path of [tolerance]: conformity and deflection at each of its points."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import dots, legend_above, title
from pipeline.annex.summaries import thinned
from pipeline.answer.conformity import DECIDED
from pipeline.answer.contract import Answer
from pipeline.base.quantities import MM, plain
from pipeline.prediction.decision import Decision
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import BLUE, GREEN, INK, MUTED, RED

_STYLE = {
    Decision.PASS: (GREEN, "o"),
    Decision.UNDECIDED: (BLUE, "s"),
    Decision.FAIL: (RED, "^"),
}
"""Colour and mark of each decision."""


def _draw(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the path from above and from the side, and the deflection along it."""
    rows = thinned(tables["path"], tables["path"]["deflection_m"].to_numpy(float))
    rows = rows.assign(mm=MM * rows["deflection_m"], u_mm=2 * MM * rows["std_m"])
    canvas.set_size_inches(5.6, 5.0)
    grid = canvas.add_gridspec(2, 2)
    above, side, course = (
        canvas.add_subplot(part) for part in (grid[0, 0], grid[0, 1], grid[1, :])
    )
    tips = _view(above, rows, "x") | _view(side, rows, "z")
    title(above, "from above")
    title(side, "from the side")
    return tips | _course(course, rows, answer)


def _view(axes: Axes, rows: pd.DataFrame, up: str) -> Tips:
    """Draw the path of the load point in the plane of y and another axis of F_b."""
    tips: Tips = {}
    axes.plot(rows["y_m"], rows[f"{up}_m"], color=MUTED, linewidth=0.8, zorder=1)
    for decision, (colour, marker) in _STYLE.items():
        mine = rows[rows["decision"] == decision]
        style = {"s": 14, "color": colour, "marker": marker, "linewidths": 0, "zorder": 2}
        key = f"path-{up}-{decision}"
        tips |= dots(axes, key, mine["y_m"], mine[f"{up}_m"], _said(mine), **style)
    axes.set(xlabel="y [m]", ylabel=f"{up} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    return tips


def _course(axes: Axes, rows: pd.DataFrame, answer: Answer) -> Tips:
    """Draw the deflection of each point with its expanded uncertainty, and the tolerance."""
    at, tips = rows["point"].to_numpy(float), Tips()
    low, high = rows["mm"] - rows["u_mm"], rows["mm"] + rows["u_mm"]
    known = np.isfinite(high.to_numpy(float))
    axes.vlines(at[known], low[known], high[known], color=MUTED, linewidth=0.8, zorder=1)
    if answer.tolerance is not None:
        most = answer.tolerance.deflection_mm
        axes.axhline(most, color=INK, linewidth=1.0, label=f"tolerance {most:g} mm")
    for decision, (colour, marker) in _STYLE.items():
        mine = rows[rows["decision"] == decision]
        if mine.empty:
            continue
        style = {"s": 14, "color": colour, "marker": marker, "linewidths": 0, "zorder": 2}
        key, name = f"course-{decision}", DECIDED[decision]
        tips |= dots(axes, key, mine["point"], mine["mm"], _said(mine), label=name, **style)
    axes.set(xlabel="Point of the path, in order", ylabel="Deflection ± U (k = 2) [mm]")
    axes.set_ylim(bottom=0)
    legend_above(axes, 4)
    return tips


def _said(rows: pd.DataFrame) -> list[str]:
    """Hover texts of the points."""
    return [
        f"pose {r.pose}, {DECIDED[r.decision]}: {plain(r.mm)} mm, U = {plain(r.u_mm, 2)} mm"
        for r in each_row(rows)
    ]


def _write(answer: Answer, tables: Tables) -> Figure | None:
    asked = answer.tolerance and answer.tolerance.path
    if not asked:
        return None
    count = {one: sum(s.points for s in asked.stretches if s.decision is one) for one in Decision}
    parts = ", ".join(f"{n} {DECIDED[one]}" for one, n in count.items() if n)
    worst = asked.largest
    text = (
        f"Of {asked.points} points {parts}; the load point deflects by up to "
        f"{plain(worst.deflection_mm)} mm, at pose {worst.at}."
    )
    return Figure(
        "path",
        f"Deflection along {asked.file}",
        f"{text} Bars are ± U (k = 2). A point is within tolerance where its deflection and 1.65 "
        "standard uncertainties together are, and out of tolerance where not even the deflection "
        "less 1.65 standard uncertainties is.",
        f"The path of the load point from above and from the side, each point marked by what is "
        f"decided of it, and the deflection of each point beside the tolerance. {text}",
    )


PATH = Plot("path", ("path",), _write, _draw)
