"""How soft the robot is over the plane of its arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from pipeline.base.arrays import Array
from pipeline.base.quantities import with_std
from pipeline.report.figures.marks import Tips, each_row
from pipeline.report.summaries import Result, Tables, has
from pipeline.report.svg import GRID, INK, RED, SHADES


def draw_workspace(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """The map of the answer's values."""
    return _map(canvas, tables["workspace"], levels_of(tables))


def draw_workspace_joint_springs(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """The map with joint springs alone, data as given."""
    return _map(canvas, tables["workspace_joint_springs"], levels_of(tables))


def levels_of(tables: Tables) -> Array:
    """The steps of both maps, so that equal shades mean equal deflection [µm/N]."""
    names = [name for name in ("workspace", "workspace_joint_springs") if has(tables, name)]
    size = np.concatenate([1e6 * tables[n]["worst_m_per_n"].to_numpy(float) for n in names])
    ticks = MaxNLocator(len(SHADES), steps=[1, 2, 2.5, 5, 10])
    return np.array(ticks.tick_values(size.min(), size.max()))


def _map(canvas: Canvas, soft: pd.DataFrame, levels: Array) -> Tips:
    swept, here = soft[soft["row"] >= 0].reset_index(drop=True), soft.iloc[0]
    canvas.set_size_inches(5.6, 3.9)
    axes, beside = canvas.subplots(1, 2, width_ratios=(1, 0.05))
    per_newton = 1e6 * swept["worst_m_per_n"].to_numpy(float)
    shades = [SHADES[i] for i in np.linspace(0, 8, len(levels) - 1).round().astype(int)]
    net = Triangulation(swept["reach_m"], swept["height_m"], _triangles(swept))
    filled = axes.tricontourf(net, per_newton, levels=levels, colors=shades)
    canvas.colorbar(filled, cax=beside, label="Deflection per newton, softest direction [µm/N]")
    axes.scatter(swept["reach_m"], swept["height_m"], s=1.2, color=GRID, linewidths=0, gid="soft")
    axes.scatter(
        here["reach_m"], here["height_m"], s=60, marker="X", color=RED, edgecolors=INK, gid="here"
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("Reach from the shoulder axis [m]")
    axes.set_ylabel("Height [m]")
    return {
        "soft": [_softness(r) for r in each_row(swept)],
        "here": ["test pose: " + _softness(here)],
    }


def _softness(row: Any) -> str:
    per_newton = with_std(1e6 * row.worst_m_per_n, 1e6 * row.std_m_per_n)
    return f"reach {row.reach_m:.2f} m, height {row.height_m:.2f} m: {per_newton} µm/N"


def _triangles(swept: pd.DataFrame) -> Array:
    """Two triangles for every mesh of the joint grid whose four corners are there, (k, 3)."""
    row, column = swept[["row", "column"]].to_numpy(int).T
    at = np.full((row.max() + 2, column.max() + 2), -1)
    at[row, column] = np.arange(len(swept))
    meshes = np.stack([at[:-1, :-1], at[1:, :-1], at[:-1, 1:], at[1:, 1:]], axis=-1)
    whole = meshes[(meshes >= 0).all(axis=-1)]
    return whole[:, [0, 1, 2, 1, 3, 2]].reshape(-1, 3)
