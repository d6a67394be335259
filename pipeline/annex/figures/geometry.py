"""Campaigns of positions: contribution of each part of the model, and laws of the joints."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import cumulative, cumulative_axes, dots, title
from pipeline.annex.summaries import finite
from pipeline.answer.contract import Answer
from pipeline.base.quantities import MM, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row, has
from pipeline.report.svg import GRID, MUTED, SERIES

_BETWEEN = "every tenth pose"
"""Name of the partition into held-out poses that is drawn."""

_OF_STEPS = (MUTED, *SERIES)
"""Colours of the models, that of the nominal table first."""


def _models(tables: Tables) -> list[str]:
    """Names of the models, in the order in which they were estimated."""
    return list(dict.fromkeys(tables["held_out"]["model"]))


def _distances(tables: Tables, model: str) -> Any:
    held = tables["held_out"]
    mine = held[(held["model"] == model) & (held["parting"] == _BETWEEN)]
    return MM * mine["distance_m"].dropna().to_numpy(float)


def _draw_steps(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the share of held-out targets within a distance of their prediction, per model."""
    axes = canvas.subplots()
    tips: Tips = {}
    for k, (model, colour) in enumerate(zip(_models(tables), cycle(_OF_STEPS), strict=False)):
        tips |= cumulative(
            axes,
            f"step-{k}",
            _distances(tables, model),
            model,
            lambda share, mm: f"{plain(share)} % of the targets within {plain(mm, 2)} mm",
            color=colour,
        )
    cumulative_axes(axes, "Distance from the prediction [mm]", "Held-out targets within [%]")
    return tips


def _write_steps(answer: Answer, tables: Tables) -> Figure:
    text = " ".join(
        f"With {one.model}: {plain(one.between_mm, 2)} mm on average."
        for one in answer.position_steps
    )
    return Figure(
        "position_steps",
        "What each part of the model contributes",
        f"{text} Every tenth pose was left out and predicted from the others; the further left a "
        "curve, the better.",
        f"Cumulative curves of the distance of held-out targets from their prediction. {text}",
    )


def _draw_curves(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the transmission error of each joint over its value, with two standard uncertainties."""
    curves = tables["curves"]
    tips: Tips = {}
    joints = list(dict.fromkeys(curves["joint"]))
    for axes, joint in zip(_grid(canvas, len(joints)), joints, strict=True):
        mine = curves[curves["joint"] == joint]
        slides = answer.stiffness[joint - 1].joint_type == "prismatic"
        q = mine["q"].to_numpy(float) if slides else np.rad2deg(mine["q"].to_numpy(float))
        f, u = MM * mine["error"].to_numpy(float), 2 * MM * mine["error_std"].to_numpy(float)
        axes.fill_between(q, f - u, f + u, color=SERIES[0], alpha=0.2, linewidth=0)
        axes.plot(q, f, color=SERIES[0], linewidth=0.9)
        name = answer.axes.get(joint, f"joint {joint}")
        title(axes, f"{name} [{'mm' if slides else 'mrad'}]")
        axes.set_xlabel("place [m]" if slides else "angle [deg]")
        top = 1.3 * float(np.abs(f).max())
        axes.set_ylim(-top, top)
        tips |= _readings(axes, joint, tables, 1.0 if slides else np.rad2deg(1.0))
        axes.grid(color=GRID, linewidth=0.6)
    return tips


def _readings(axes: Axes, joint: int, tables: Tables, shown: float) -> Tips:
    """Draw means over poses with neighbouring joint values, with their standard uncertainties.

    Args:
        axes: The plot.
        joint: Number of the joint.
        tables: Tables of the report.
        shown: Factor from the joint value in SI units to that of the axis.
    """
    if not has(tables, "curve_readings"):
        return {}
    rows = tables["curve_readings"]
    rows = finite(rows[rows["joint"] == joint], "q", "error")
    q, y = shown * rows["q"].to_numpy(float), MM * rows["error"].to_numpy(float)
    u = MM * np.nan_to_num(rows["error_std"].to_numpy(float))
    axes.vlines(q, y - u, y + u, color=SERIES[1], linewidth=0.7, alpha=0.6)
    texts = [
        f"joint {joint}, {r.poses} poses at {plain(at)}: {plain(mm)} ± {plain(std, 2)}"
        for r, at, mm, std in zip(each_row(rows), q, y, u, strict=True)
    ]
    y = np.clip(y, *axes.get_ylim())  # a mark outside the plot would be lost with its hover text
    return dots(axes, f"curve-{joint}", q, y, texts, s=7, color=SERIES[1], linewidths=0, zorder=3)


def _grid(canvas: Canvas, count: int) -> list[Axes]:
    """Plots, two per row."""
    canvas.set_size_inches(5.6, 0.3 + 1.3 * ((count + 1) // 2))
    every = list(canvas.subplots((count + 1) // 2, 2, squeeze=False).flat)
    for spare in every[count:]:
        spare.set_axis_off()
    return every[:count]


def _write_curves(answer: Answer, tables: Tables) -> Figure:
    largest = max(
        (
            one
            for one in answer.diagnosis.causes
            if one.law is not None
            and one.law.variable in ("angle", "position")
            and one.law.source_joint is None
        ),
        key=lambda one: one.parameters[0].value or 0.0,
        default=None,
    )
    text = "" if largest is None or largest.law is None else f"{largest.law.text.capitalize()}. "
    return Figure(
        "curves",
        "Transmission error of each joint",
        f"{text}Each dot is the mean of poses with neighbouring joint values, all else as "
        "identified, with its standard uncertainty. The band has two standard uncertainties; where "
        "no pose was measured it is as wide as the curves are high.",
        f"Transmission error of each joint over its own angle. {text}",
    )


POSITION_STEPS = Plot("position_steps", ("held_out",), _write_steps, _draw_steps)
CURVES = Plot("curves", ("curves",), _write_curves, _draw_curves)
