"""Residual vectors at the poses, and deviations of base reflectors in order of reading."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator

from pipeline.annex.figures.marks import MARKERS, dots, legend_above, rounded_down, title
from pipeline.annex.summaries import AXES, MOST_MARKS, arrows, registration_by_target, thinned
from pipeline.answer.contract import Answer
from pipeline.base.quantities import MM, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import INK, MUTED, RED, SERIES


def _draw_arrows(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw residual vectors at the poses, from above and from the side."""
    vectors = arrows(tables)
    size = np.linalg.norm(vectors[_RESIDUAL].to_numpy(float), axis=1)
    usual = float(np.quantile(size, 0.8))  # one outlier must not make all others invisible
    vectors, longest = thinned(vectors, size, MOST_MARKS // 5), size.max()
    spread = max(float(np.ptp(vectors[a])) for a in "xyz") or 1.0
    scale = max(usual / 0.08, longest / 0.4, 1e-9) / spread
    views, wide = _views(canvas, vectors, scale)
    drawn = [_arrows(view, vectors, up, scale, wide) for view, up in zip(views, "xz", strict=True)]
    for view, name in zip(views, ("from above", "from the side"), strict=True):
        title(view, name)
    for view in views[1:] if wide else views:
        view.set_xlabel("y [m]")
    _key(canvas, drawn[0], rounded_down(max(usual, 0.2 * longest)))
    texts = [
        f"pose {r.pose}, {r.target}: {plain(r.rx)}, {plain(r.ry)}, {plain(r.rz)} mm"
        for r in each_row(vectors)
    ]
    return dict.fromkeys(("view-x", "view-z"), texts)


_RESIDUAL = ["rx", "ry", "rz"]


def _views(canvas: Canvas, vectors: pd.DataFrame, scale: float) -> tuple[np.ndarray, bool]:
    """Two plots, one above the other along a rail and otherwise side by side.

    Returns:
        The plots, and whether one is above the other.
    """
    at, along = vectors[list("xyz")].to_numpy(float), vectors[_RESIDUAL].to_numpy(float)
    if np.ptp(at[:, 1]) <= 2 * max(np.ptp(at[:, 0]), np.ptp(at[:, 2])):
        canvas.set_size_inches(5.6, 3.2)
        return canvas.subplots(1, 2), False
    spans = 1.1 * np.ptp(np.vstack([at, at + along / scale]), axis=0)
    # heights for an equal scale in all directions
    ratios = np.maximum(spans[[0, 2]] / spans[1], 0.15)
    canvas.set_size_inches(5.6, 1.2 + 4.9 * ratios.sum())
    return canvas.subplots(2, 1, sharex=True, height_ratios=ratios), True


def _arrows(view: Axes, vectors: pd.DataFrame, up: str, scale: float, wide: bool) -> Quiver:
    """Draw the residuals in the plane of y and another axis."""
    at, along = (vectors[columns].to_numpy(float).T for columns in (["y", up], ["ry", f"r{up}"]))
    style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "color": RED}
    quiver = view.quiver(*at, *along, scale=scale, width=0.0032 if wide else 0.006, **style)
    view.scatter(at[0], at[1], s=5, color=INK, linewidths=0)
    view.update_datalim((at + along / scale).T)
    view.autoscale_view()
    view.set_aspect("equal", adjustable="datalim")
    view.set_ylabel(f"{up} [m]")
    quiver.set_gid(f"view-{up}")  # not as an argument, since the key copies all arguments
    return quiver


def _key(canvas: Canvas, arrows: Quiver, length: float) -> None:
    """Add a key with an arrow of this length [mm]."""
    height = canvas.get_size_inches()[1]
    style = {"labelpos": "E", "coordinates": "figure", "color": RED}
    canvas.axes[0].quiverkey(arrows, 0.86, 1 - 0.13 / height, length, f"{length:g} mm", **style)


def _draw_registration(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the deviation of each base reading from nominal, in order of reading."""
    readings = tables["registration"].reset_index(drop=True).assign(at=lambda t: t.index + 1)
    size = np.linalg.norm(readings[AXES].to_numpy(float), axis=1)
    readings = thinned(readings, size, MOST_MARKS // 5)
    views = canvas.subplots(3, 1, sharex=True, sharey=True)
    targets = list(dict.fromkeys(readings["target"]))
    at = readings["at"].to_numpy()
    tips: Tips = {}
    for view, axis in zip(views, "xyz", strict=True):
        mm = MM * readings[f"d{axis}_m"].to_numpy(float)
        view.axhline(0, color=MUTED, linewidth=0.8)
        for index, target in enumerate(targets):
            here = (readings["target"] == target).to_numpy() & np.isfinite(mm)
            pairs = zip(at[here], mm[here], strict=True)
            texts = [f"reading {n}, {target}: d{axis} = {plain(v)} mm" for n, v in pairs]
            style = {"color": SERIES[index % len(SERIES)], "marker": MARKERS[index % len(MARKERS)]}
            style |= {"label": f" {target}"}  # legends omit labels that begin with an underscore
            key = f"base-{axis}-{index}"
            tips |= dots(view, key, at[here], mm[here], texts, s=14, linewidths=0, **style)
        view.margins(y=0.25)
        view.set_ylabel(f"d{axis} [mm]")
    views[-1].set_xlabel("Reading of a base reflector, in order")
    views[-1].xaxis.set_major_locator(MaxNLocator(10, integer=True))
    if len(targets) <= 8:
        legend_above(views[0], min(len(targets), 6))
    return tips


def _write_arrows(answer: Answer, tables: Tables) -> Figure | None:
    vectors = arrows(tables)
    if vectors.empty:
        return None
    size = np.linalg.norm(vectors[_RESIDUAL].to_numpy(float), axis=1)
    worst = vectors.iloc[int(size.argmax())]
    text = (
        f"The longest of {len(vectors)} arrows is {plain(size.max())} mm, at {worst['target']} in "
        f"pose {int(worst['pose'])}."
    )
    return Figure(
        "arrows",
        "Residual at each pose, seen in the base frame",
        f"{text} Each arrow is what is left of one reflector's displacement under the strongest "
        f"pull of its pose. Arrows in all directions are noise; arrows that agree within a pose or "
        f"along the rail are an effect.",
        f"Residual vectors drawn at the poses, from above and from the side. {text}",
    )


def _write_registration(answer: Answer, tables: Tables) -> Figure:
    by_target = registration_by_target(tables["registration"])
    worst = by_target.iloc[int(by_target["largest"].argmax())]
    text = (
        f"The largest deviation is {plain(worst['largest'])} mm at {worst['target']}, in "
        f"{len(tables['registration'])} readings of {len(by_target)} reflectors."
    )
    return Figure(
        "registration",
        "Base reflectors after registration",
        f"{text} A step or a slope from the first to the last reading is a tracker that moved.",
        f"Deviation of each base reading from nominal, in order of the readings. {text}",
    )


ARROWS = Plot("arrows", ("residuals", "displacements", "forces"), _write_arrows, _draw_arrows)
REGISTRATION = Plot("registration", ("registration",), _write_registration, _draw_registration)
