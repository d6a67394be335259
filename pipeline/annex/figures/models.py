"""Displacements predicted by three models: nominal, joint springs, recommended."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import dots, title
from pipeline.annex.summaries import MOST_MARKS, thinned
from pipeline.answer.contract import Answer, Which
from pipeline.base.linear import rms
from pipeline.base.quantities import MM, plain
from pipeline.report import words
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import MUTED, SERIES


def _columns(answer: Answer, models: pd.DataFrame) -> dict[str, str]:
    """Models with finite predictions: name in words by column."""
    named = {"nominal_m": "nominal", "joint_springs_m": "joint springs"}
    if answer.recommended.model != Which.JOINT_SPRINGS:
        named["recommended_m"] = words.MODELS[answer.recommended.model]
    return {c: n for c, n in named.items() if np.isfinite(models[c].to_numpy(float)).any()}


def _miss(models: pd.DataFrame, column: str) -> float:
    """Rms of measured minus predicted coordinates [mm]."""
    return MM * rms((models["measured_m"] - models[column]).to_numpy(float))


def _draw(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw measured minus predicted over measured coordinates, one plot per model."""
    models = tables["models"]
    names = _columns(answer, models)
    views = canvas.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    tips: Tips = {}
    for view, (column, name), colour in zip(views, names.items(), SERIES, strict=False):
        off = (models["measured_m"] - models[column]).to_numpy(float)
        rows = thinned(models, off, MOST_MARKS // (4 * len(names)))
        x, y = MM * rows["measured_m"], MM * (rows["measured_m"] - rows[column])
        view.axhline(0, color=MUTED, linewidth=0.8, zorder=1)
        texts = [
            f"{name}: pose {r.pose}, pull {r.repeat}, {r.target} {r.axis}: measured {plain(a)} mm, "
            f"predicted {plain(a - b)} mm"
            for r, a, b in zip(each_row(rows), x, y, strict=True)
        ]
        style = {"s": 7, "color": colour, "linewidths": 0, "zorder": 2}
        tips |= dots(view, f"model-{column}", x, y, texts, **style)
        title(view, f"{name}:\n{plain(_miss(models, column))} mm rms")
    views[0].set_ylabel("Measured minus predicted [mm]")
    views[len(views) // 2].set_xlabel("Measured displacement [mm]")
    return tips


def _write(answer: Answer, tables: Tables) -> Figure | None:
    models = tables["models"]
    names = _columns(answer, models)
    if len(names) < 2:
        return None
    parts = [f"{name} {plain(_miss(models, column))} mm" for column, name in names.items()]
    text = f"Measured minus predicted, rms per coordinate: {', '.join(parts)}."
    of = "Nominal are the stiffnesses of the robot file. " if "nominal_m" in names else ""
    return Figure(
        "models",
        "Before and after identification",
        f"{text} {of}A tilted cloud indicates a wrong stiffness; a level one that is wider than "
        "the noise indicates an effect that the model does not have.",
        f"Measured minus predicted over measured displacements, a plot per model. {text}",
    )


MODELS = Plot("models", ("models",), _write, _draw)
