"""Compliance of the robot over the plane of its arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from pipeline.annex.words import springs_alone
from pipeline.answer.contract import Answer
from pipeline.base.arrays import Array
from pipeline.base.quantities import plain, with_std
from pipeline.report import words
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row, has
from pipeline.report.svg import BODY, EDGE, GRID, INK, RED, SHADES


def _levels_of(tables: Tables) -> Array:
    """Levels common to both maps [µm/N], so that equal shades mean equal deflection."""
    names = [name for name in ("workspace", "workspace_joint_springs") if has(tables, name)]
    size = np.concatenate([1e6 * tables[n]["worst_m_per_n"].to_numpy(float) for n in names])
    ticks = MaxNLocator(len(SHADES), steps=[1, 2, 2.5, 5, 10])
    return np.array(ticks.tick_values(size.min(), size.max()))


def _map(canvas: Canvas, soft: pd.DataFrame, levels: Array, arm: pd.DataFrame | None) -> Tips:
    swept, here = _swept(soft), soft.iloc[0]
    canvas.set_size_inches(5.6, 3.9)
    axes, beside = canvas.subplots(1, 2, width_ratios=(1, 0.05))
    per_newton = 1e6 * swept["worst_m_per_n"].to_numpy(float)
    shades = [SHADES[i] for i in np.linspace(0, 8, len(levels) - 1).round().astype(int)]
    net = Triangulation(swept["reach_m"], swept["height_m"], _triangles(swept))
    filled = axes.tricontourf(net, per_newton, levels=levels, colors=shades)
    canvas.colorbar(
        filled, cax=beside, label="Deflection per newton, most compliant direction [µm/N]"
    )
    axes.scatter(swept["reach_m"], swept["height_m"], s=1.2, color=GRID, linewidths=0, gid="soft")
    axes.scatter(
        here["reach_m"], here["height_m"], s=60, marker="X", color=RED, edgecolors=INK, gid="here"
    )
    if arm is not None:
        _draw_arm(axes, arm)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="Reach from the shoulder axis [m]", ylabel="Height [m]")
    return {
        "soft": [_softness(r) for r in each_row(swept)],
        "here": ["test pose: " + _softness(here)],
    }


def _draw_arm(axes: Axes, arm: pd.DataFrame) -> None:
    """Draw the arm at the test pose: a wide line for each part, and a narrower one on it."""
    ends = arm[["from_reach_m", "from_height_m", "to_reach_m", "to_height_m"]].to_numpy(float)
    lines = list(ends.reshape(-1, 2, 2))
    width = 4 + 5 * arm["radius_m"].to_numpy(float) / max(arm["radius_m"].max(), 1e-9)
    round_ends: Any = {"capstyle": "round"}
    axes.add_collection(LineCollection(lines, linewidths=width, colors=EDGE, **round_ends))
    axes.add_collection(LineCollection(lines, linewidths=width - 2, colors=BODY, **round_ends))


def _softness(row: Any) -> str:
    per_newton = with_std(1e6 * row.worst_m_per_n, 1e6 * row.std_m_per_n)
    return f"reach {row.reach_m:.2f} m, height {row.height_m:.2f} m: {per_newton} µm/N"


def _swept(soft: pd.DataFrame) -> pd.DataFrame:
    """The poses of the joint grid, without the test pose."""
    return soft[soft["row"] >= 0].reset_index(drop=True)


def _triangles(swept: pd.DataFrame) -> Array:
    """Two triangles for every cell of the joint grid whose four corners exist, shape (k, 3)."""
    row, column = swept[["row", "column"]].to_numpy(int).T
    at = np.full((row.max() + 2, column.max() + 2), -1)
    at[row, column] = np.arange(len(swept))
    meshes = np.stack([at[:-1, :-1], at[1:, :-1], at[:-1, 1:], at[1:, 1:]], axis=-1)
    whole = meshes[(meshes >= 0).all(axis=-1)]
    return whole[:, [0, 1, 2, 1, 3, 2]].reshape(-1, 3)


def _told(name: str, model: str | None, soft: pd.DataFrame) -> Figure | None:
    if model is None or len(soft) < 20 or not len(_triangles(_swept(soft))):
        return None  # limits may leave poses of the grid that do not adjoin
    here, worst = soft.iloc[0], soft.iloc[int(soft["worst_m_per_n"].to_numpy().argmax())]
    size = 1e6 * soft["worst_m_per_n"]
    axis = "xyz"[int(np.abs(here[[f"direction_{a}" for a in "xyz"]].to_numpy(float)).argmax())]
    text = (
        f"At the test pose (cross) one newton moves the load point by "
        f"{with_std(1e6 * here['worst_m_per_n'], 1e6 * here['std_m_per_n'])} µm in its most "
        f"compliant direction, mostly along {axis}. Over the plane it is {plain(size.min(), 2)} µm "
        f"to {plain(size.max(), 2)} µm, most at a reach of {worst['reach_m']:.1f} m and a height "
        f"of {worst['height_m']:.1f} m."
    )
    if np.isinf(soft["std_m_per_n"]).any():
        text += (
            " Where no ± is given, a stiffness acts that nothing determines, and the map has it "
            "as the robot file does."
        )
    return Figure(
        name,
        f"Deflection per newton over the arm's plane, {model}",
        f"{text} Shoulder and elbow go through their ranges, the other joints stay as in the test "
        f"pose, in which the arm is drawn. Brighter is more compliant.",
        f"Map of the deflection per newton of load over reach and height, {model}. {text}",
    )


def _springs_beside(answer: Answer) -> str | None:
    other = springs_alone(answer)
    return other[0] if other else None


def _plot(name: str, model: Callable[[Answer], str | None]) -> Plot:
    """Map of one model, whose name `model` gives; there is no figure if the name is None."""
    table = name.replace("-", "_")
    return Plot(
        name,
        (table,),
        lambda answer, tables: _told(name, model(answer), tables[table]),
        lambda canvas, _, tables: _map(
            canvas, tables[table], _levels_of(tables), tables.get("arm")
        ),
    )


WORKSPACE = _plot("workspace", words.values_of)
WORKSPACE_JOINT_SPRINGS = _plot("workspace-joint-springs", _springs_beside)
