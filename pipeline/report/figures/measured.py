"""Measured against predicted displacements, each pose predicted from all the others."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.answer.contract import Answer
from pipeline.base.linear import rms
from pipeline.base.quantities import plain
from pipeline.report.figures.marks import Tips, dots, each_row, legend_above
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import MM, Tables, finite, thinned
from pipeline.report.svg import MUTED, SERIES

_KEY = ["pose", "repeat", "target"]


def _rows(tables: Tables) -> pd.DataFrame:
    """Coordinates that the other poses predict: pose, repeat, target, axis, and both values [mm].

    Predicted is measured minus the residual of the pose when it is left out of the estimate.
    """
    moved = tables["displacements"].melt(
        _KEY, ["dx_m", "dy_m", "dz_m"], var_name="axis", value_name="measured_m"
    )
    moved["axis"] = moved["axis"].str[1]
    rows = tables["residuals"].merge(moved, on=[*_KEY, "axis"])
    rows["measured"] = MM * rows["measured_m"]
    rows["predicted"] = rows["measured"] - MM * rows["left_out_m"]
    return finite(rows, "predicted")


def _draw(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """One point per coordinate on the line of equality, axes of F_b apart."""
    every = _rows(tables)
    rows = thinned(every, (every["measured"] - every["predicted"]).to_numpy(float))
    axes = canvas.subplots()
    ends = [rows["measured"].min(), rows["measured"].max()]
    axes.plot(ends, ends, color=MUTED, linewidth=0.8, zorder=1)
    tips: Tips = {}
    for axis, colour, marker in zip("xyz", SERIES, "os^", strict=False):
        mine = rows[rows["axis"] == axis]
        said = [
            f"pose {r.pose}, pull {r.repeat}, {r.target} {axis}: measured "
            f"{plain(r.measured)} mm, predicted {plain(r.predicted)} mm"
            for r in each_row(mine)
        ]
        style = {"s": 12, "color": colour, "marker": marker, "linewidths": 0, "zorder": 2}
        at = mine["measured"], mine["predicted"]
        tips |= dots(axes, f"measured-{axis}", *at, said, label=axis, **style)
    axes.set_xlabel("Measured displacement [mm]")
    axes.set_ylabel("Predicted from the other poses [mm]")
    legend_above(axes, 3)
    return tips


def _write(answer: Answer, tables: Tables) -> Figure | None:
    rows = _rows(tables)
    if rows.empty:
        return None
    miss = np.abs((rows["measured"] - rows["predicted"]).to_numpy(float))
    worst = rows.iloc[int(np.argmax(miss))]
    said = (
        f"Displacements reach {plain(float(rows['measured'].abs().max()))} mm and are predicted to "
        f"{plain(rms(miss))} mm rms; the largest error is {plain(float(miss.max()))} mm, at "
        f"{worst['target']} {worst['axis']} in pose {worst['pose']}."
    )
    return Figure(
        "measured",
        "Measured against predicted displacements",
        f"{said} Each pose is predicted by the model that is estimated from all the others; a "
        "point on the line is predicted exactly.",
        f"Every displacement coordinate, measured and predicted. {said}",
    )


MEASURED = Plot("measured", ("residuals", "displacements"), _write, _draw)
