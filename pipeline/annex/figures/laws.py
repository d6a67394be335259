"""The law of each identified cause, with the estimate from every single pull or pose."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import dots, legend_below, title
from pipeline.annex.summaries import MOST_MARKS, thinned
from pipeline.annex.words import from_label, label
from pipeline.answer.contract import Answer
from pipeline.answer.words import capital
from pipeline.base.quantities import common_prefix, percent, plain, prefixed
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import BLUE, MUTED, RED

_MOST_LAWS = 4
"""Maximum number of laws in the figure."""

_BESIDE = 26
"""Maximum length of a line of a plot's vertical label [characters]."""

_NAMES = {"torque": "torque about its axis", "force": "force along it", "load": "size of the load"}
_NAMES |= {"time": "time after the first reading", "turn": "turn", "shift": "shift"}
_NAMES |= {"angle": "angle of the joint", "position": "position along the rail"}
_NAMES |= {"compliance": "extra compliance", "temperature": "temperature of the air"}
_NAMES |= {"order": "pose, in the order of measuring"}


def _laws(tables: Tables) -> list[pd.DataFrame]:
    """Estimates from single pulls or poses, one table per law; at most `_MOST_LAWS`."""
    of = tables["laws"].groupby(["cause", "part"], sort=False)
    return [rows.reset_index(drop=True) for _, rows in of][:_MOST_LAWS]


def _explained(rows: pd.DataFrame) -> float:
    """Share of the weighted sum of squares of the single estimates that the law explains [1]."""
    w = rows["y_std"].to_numpy(float) ** -2
    y, law = rows["y"].to_numpy(float), rows["law"].to_numpy(float)
    return max(float(1 - np.sum(w * (y - law) ** 2) / np.sum(w * y**2)), 0.0)


def _draw(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw one plot per law: single estimates with their uncertainties, and the law itself."""
    told = _laws(tables)
    canvas.set_size_inches(5.6, 0.5 + 2.2 * len(told))
    views = canvas.subplots(len(told), 1, squeeze=False)[:, 0]
    tips: Tips = {}
    for k, (view, rows) in enumerate(zip(views, told, strict=True)):
        tips |= _marks(view, f"law-{k}", answer, rows)
        first = rows.iloc[0]
        of = capital(_NAMES[first["of"]])
        view.set(xlabel=of if first["x_unit"] == "1" else f"{of} [{first['x_unit']}]")
        title(view, _called(answer, str(first["cause"]), int(first["part"])))
    legend_below(canvas)
    return tips


def _marks(view: Axes, name: str, answer: Answer, rows: pd.DataFrame) -> Tips:
    """Draw the single estimates of one law, and the law."""
    first = rows.iloc[0]
    factor, letter = common_prefix(rows["y"]) if first["y_unit"] else (1.0, "")
    unit = prefixed(first["y_unit"], letter)
    shown = thinned(rows, (rows["y"] - rows["law"]).to_numpy(float), MOST_MARKS // 4)
    x, y, law, u = (shown[c].to_numpy(float) for c in ("x", "y", "law", "y_std"))
    usual = np.abs([*np.quantile(y, (0.02, 0.98)), *law])
    reach = 1.3 * float(np.max(usual)) / factor or 1.0
    low = -reach if (np.minimum(y, law) < 0).any() else -0.05 * reach
    view.axhline(0, color=MUTED, linewidth=0.8)
    view.vlines(x, (y - u) / factor, (y + u) / factor, color=BLUE, linewidth=0.7, alpha=0.5)
    texts = [
        f"pose {r.pose}{'' if answer.position_steps else f', pull {r.repeat}'}: "
        f"{plain(r.y / factor)} {unit} at {plain(r.x)} {r.x_unit}"
        for r in each_row(shown)
    ]
    style = {"linewidths": 0, "zorder": 3}
    label = f"each {_reading(answer)} ± standard uncertainty"
    tips = dots(
        view,
        f"{name}-pulls",
        x,
        np.clip(y / factor, low, reach),  # a mark outside would be lost with its hover text
        texts,
        s=12,
        color=BLUE,
        label=label,
        **style,
    )
    texts = [
        f"law: {plain(v / factor)} {unit} at {plain(a)} {first['x_unit']}"
        for a, v in zip(x, law, strict=True)
    ]
    tips |= dots(
        view,
        name,
        x,
        law / factor,
        texts,
        s=9,
        color=RED,
        marker="D",
        label="law",
        **style,
    )
    view.set_ylim(low, reach)
    what = capital(_quantity(answer, first))
    label = f"{what} [{unit}]" if unit else what
    view.set_ylabel("\n".join(textwrap.wrap(label, _BESIDE)))
    return tips


def _quantity(answer: Answer, first: pd.Series[Any]) -> str:
    """The dependent variable of a law, in words."""
    name = str(first["is"])
    causes = {label(one).replace(" ", ":"): one for one in answer.diagnosis.causes}
    cause = causes.get(first["cause"])
    called = {one.name: one.meaning for one in cause.parameters} if cause else {}
    return _NAMES.get(name) or called.get(name, name)


def _called(answer: Answer, label: str, part: int) -> str:
    """A cause in words; a law outside the catalogue by its description."""
    name, _, where = label.partition(":")
    items = [
        cause.law.text
        for cause in answer.diagnosis.causes
        if cause.law is not None and (cause.name, str(cause.where or "")) == (name, where)
    ]
    return items[min(part, len(items)) - 1] if items else from_label(label, answer.axes)


def _reading(answer: Answer) -> str:
    """The unit of data from which a law is estimated singly: a pose or a pull."""
    return "pose" if answer.position_steps else "pull"


def _write(answer: Answer, tables: Tables) -> Figure | None:
    chosen = [rows for rows in _laws(tables) if len(rows) > 1]
    if not chosen:
        return None
    every = pd.concat(chosen)
    apart = every["part"] if answer.position_steps else np.ones(len(every))
    parts = [
        f"{_called(answer, str(rows['cause'].iloc[0]), int(rows['part'].iloc[0]))}: "
        f"{percent(_explained(rows))}"
        for _, rows in every.groupby([every["cause"], apart], sort=False)
    ]
    one = _reading(answer)
    text = f"Share of the variation between {one}s that is explained: {'; '.join(parts)}."
    return Figure(
        "laws",
        "Laws of the identified causes",
        f"{text} Each point is the motion, or the parameter, estimated from one {one} alone with "
        "everything else as identified. Points that bend away from the law indicate a cause of "
        "another form.",
        f"Estimates from each {one} of {len(chosen)} laws, over the variable of each law. {text}",
    )


LAWS = Plot("laws", ("laws",), _write, _draw)
