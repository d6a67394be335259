"""How far a predicted deflection can be off."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas

from pipeline.answer.contract import Answer
from pipeline.base.quantities import percent, plain
from pipeline.report.figures.marks import Tips, dots, legend_above
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, prediction_error
from pipeline.report.svg import GRID, SERIES


def _draw_prediction(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Share of the validation poses below each relative error."""
    errors = prediction_error(tables["validation"])
    axes = canvas.subplots()
    tips: Tips = {}
    steps = np.linspace(0, 1, 41)
    for index, ((where, draw_from), mu) in enumerate(errors.items()):
        at = 100 * np.quantile(mu, steps)
        if at[4] <= 0:  # no stiffness had a value to draw about, and zero has no logarithm
            continue
        name = f"{_SETS.get(where, where)}, {_DRAWS.get(draw_from, draw_from)}"
        style = "-" if draw_from == "covariance" else "--"
        colour = SERIES[list(_SETS).index(where) if where in _SETS else 2]
        axes.plot(at, 100 * steps, style, color=colour, linewidth=1.6, label=name)
        shown, shares = at[4:-1:4], 100 * steps[4:-1:4]
        said = [
            f"{name}: {plain(share)} % of the poses below {percent(v / 100)}"
            for share, v in zip(shares, shown, strict=True)
        ]
        tips |= dots(axes, f"mu-{index}", shown, shares, said, s=9, color=colour, linewidths=0)
    axes.set_xscale("log")
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("Relative error of the predicted deflection [%]")
    axes.set_ylabel("Poses below [%]")
    axes.grid(color=GRID, linewidth=0.6)
    legend_above(axes, 2)
    return tips


_SETS = {"test_pose": "around the test pose", "global": "over the workspace"}


_DRAWS = {"covariance": "full covariance", "independent": "independent"}


def _write_prediction(answer: Answer, tables: Tables) -> Figure:
    errors = prediction_error(tables["validation"])
    said = " ".join(
        f"{_SETS.get(where, where).capitalize()} half of the poses are predicted within "
        f"{percent(np.median(mu))} and 95 % within {percent(np.quantile(mu, 0.95))}."
        for (where, draw), mu in errors.items()
        if draw == "covariance"
    )
    return Figure(
        "prediction",
        "Relative error of the predicted deflection",
        f"{said} The further left a curve, the better; dashed curves draw each stiffness "
        f"by itself, as the paper does.",
        f"Cumulative curves of the relative prediction error of Eq. (22). {said}",
    )


PREDICTION = Plot("prediction", ("validation",), _write_prediction, _draw_prediction)
