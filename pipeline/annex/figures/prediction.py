"""Measured and predicted displacements, and relative error of predicted deflections."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import cumulative, cumulative_axes, dots, legend_above
from pipeline.annex.summaries import finite, prediction_error, thinned
from pipeline.answer.contract import Answer
from pipeline.base.linear import rms
from pipeline.base.quantities import MM, percent, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import MUTED, SERIES

_KEY = ["pose", "repeat", "target"]


def _rows(tables: Tables) -> pd.DataFrame:
    """Coordinates predicted from the other poses: pose, repeat, target, axis, both values [mm].

    The prediction is the measured value minus the residual of the pose when it is left out of the
    estimate.
    """
    moved = tables["displacements"].melt(
        _KEY, ["dx_m", "dy_m", "dz_m"], var_name="axis", value_name="measured_m"
    )
    moved["axis"] = moved["axis"].str[1]
    rows = tables["residuals"].merge(moved, on=[*_KEY, "axis"])
    rows["measured"] = MM * rows["measured_m"]
    rows["predicted"] = rows["measured"] - MM * rows["left_out_m"]
    return finite(rows, "predicted")


def _draw_measured(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw predicted over measured coordinates, with a colour for each axis of F_b."""
    every = _rows(tables)
    rows = thinned(every, (every["measured"] - every["predicted"]).to_numpy(float))
    axes = canvas.subplots()
    ends = [rows["measured"].min(), rows["measured"].max()]
    axes.plot(ends, ends, color=MUTED, linewidth=0.8, zorder=1)
    tips: Tips = {}
    for axis, colour, marker in zip("xyz", SERIES, "os^", strict=False):
        mine = rows[rows["axis"] == axis]
        texts = [
            f"pose {r.pose}, pull {r.repeat}, {r.target} {axis}: measured "
            f"{plain(r.measured)} mm, predicted {plain(r.predicted)} mm"
            for r in each_row(mine)
        ]
        style = {"s": 12, "color": colour, "marker": marker, "linewidths": 0, "zorder": 2}
        at = mine["measured"], mine["predicted"]
        tips |= dots(axes, f"measured-{axis}", *at, texts, label=axis, **style)
    axes.set(xlabel="Measured displacement [mm]", ylabel="Predicted from the other poses [mm]")
    legend_above(axes, 3)
    return tips


def _write_measured(answer: Answer, tables: Tables) -> Figure | None:
    rows = _rows(tables)
    if rows.empty:
        return None
    miss = np.abs((rows["measured"] - rows["predicted"]).to_numpy(float))
    worst = rows.iloc[int(np.argmax(miss))]
    most = plain(float(rows["measured"].abs().max()))
    text = (
        f"Single coordinates of the displacements reach {most} mm and are predicted to "
        f"{plain(rms(miss))} mm rms; the largest error is {plain(float(miss.max()))} mm, at "
        f"{worst['target']} {worst['axis']} in pose {worst['pose']}."
    )
    return Figure(
        "measured",
        "Measured against predicted displacements",
        f"{text} Each pose is predicted by the model that is estimated from all the others; a "
        "point on the line is predicted exactly.",
        f"Every displacement coordinate, measured and predicted. {text}",
    )


def _draw_prediction(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the share of the validation poses below each relative error."""
    errors = prediction_error(tables["validation"])
    axes = canvas.subplots()
    tips: Tips = {}
    for index, ((where, draw_from), mu) in enumerate(errors.items()):
        if np.quantile(mu, 0.1) <= 0:  # no stiffness had a value; zero is not on a log axis
            continue
        name = f"{_SETS.get(where, where)}, {_DRAWS.get(draw_from, draw_from)}"
        tips |= cumulative(
            axes,
            f"mu-{index}",
            100 * mu,
            name,
            lambda share, at: f"{plain(share)} % of the poses below {percent(at / 100)}",
            linestyle="-" if draw_from == "covariance" else "--",
            color=SERIES[list(_SETS).index(where) if where in _SETS else 2],
        )
    cumulative_axes(axes, "Relative error of the predicted deflection [%]", "Poses below [%]")
    return tips


_SETS = {"test_pose": "around the test pose", "global": "over the workspace"}


_DRAWS = {"covariance": "full covariance", "independent": "independent"}


def _write_prediction(answer: Answer, tables: Tables) -> Figure:
    errors = prediction_error(tables["validation"])
    text = " ".join(
        f"{_SETS.get(where, where).capitalize()} half of the poses are predicted within "
        f"{percent(np.median(mu))} and 95 % within {percent(np.quantile(mu, 0.95))}."
        for (where, draw), mu in errors.items()
        if draw == "covariance"
    )
    return Figure(
        "prediction",
        "Relative error of the predicted deflection",
        f"{text} The further left a curve, the better; dashed curves draw each stiffness "
        f"by itself.",
        f"Cumulative curves of the relative error of the predicted deflection. {text}",
    )


PREDICTION = Plot("prediction", ("validation",), _write_prediction, _draw_prediction)
MEASURED = Plot("measured", ("residuals", "displacements"), _write_measured, _draw_measured)
