"""Are the poses enough: uncertainty over their number, and correlation of the estimates."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.marks import MARKERS, dots, legend_above
from pipeline.annex.words import parameter
from pipeline.answer.contract import Answer
from pipeline.base.arrays import Array
from pipeline.base.quantities import percent, plain
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables
from pipeline.report.svg import BLUE, MUTED, RED, SERIES

_ALIKE = 0.7
"""Absolute correlation above which pairs of estimates are counted in the caption [1]."""


def _curves(answer: Answer, tables: Tables) -> pd.DataFrame:
    """Relative standard uncertainty [1] by number of poses, of the parameters with a value."""
    wide = tables["enough"].pivot(index="poses", columns="parameter", values="relative_std")
    names = dict.fromkeys(tables["enough"]["parameter"])
    known = [name for name in names if np.isfinite(wide[name].to_numpy(float)).any()]
    return wide[known].rename(columns=lambda name: parameter(answer, str(name)))


def _draw_enough(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw a curve for each stiffness; its last step, dashed, has every pose twice."""
    curves = _curves(answer, tables)
    axes = canvas.subplots()
    counts = curves.index.to_numpy(float)
    tips: Tips = {}
    for k, name in enumerate(curves):
        u = 100 * curves[name].to_numpy(float)
        colour, marker = SERIES[k % len(SERIES)], MARKERS[k % len(MARKERS)]
        axes.plot(counts[:-1], u[:-1], color=colour, linewidth=1.3)
        axes.plot(counts[-2:], u[-2:], color=colour, linewidth=1.0, linestyle="--")
        seen = np.isfinite(u)
        texts = [
            f"{name}, {n:.0f} poses: {plain(v, 2)} %"
            for n, v in zip(counts[seen], u[seen], strict=True)
        ]
        style = {"s": 14, "color": colour, "marker": marker, "linewidths": 0, "label": name}
        tips |= dots(axes, f"enough-{k}", counts[seen], u[seen], texts, **style)
    axes.axvline(counts[-2], color=MUTED, linewidth=0.8, linestyle=":")
    axes.set(xscale="log", yscale="log", xlabel="Poses, in the order of measuring")
    axes.set_ylabel("Standard uncertainty [%]")
    ticks = counts[np.unique(np.linspace(0, len(counts) - 1, 7).round().astype(int))]
    axes.set_xticks(ticks, [f"{n:.0f}" for n in ticks])
    axes.minorticks_off()
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    legend_above(axes, 5)
    return tips


def _write_enough(answer: Answer, tables: Tables) -> Figure | None:
    curves = _curves(answer, tables)
    if curves.empty or len(curves) < 3:
        return None
    half, now, twice = (curves.iloc[_row(curves, share)] for share in (0.5, 1.0, 2.0))
    widest = str(now.idxmax())
    text = (
        f"With all {int(curves.index[-2])} poses {widest} is the least certain, "
        f"{percent(now[widest])}; half of them would have given {_known(half[widest])}, and "
        f"measuring all "
        f"of them once more would give {_known(twice[widest])}."
    )
    return Figure(
        "enough",
        "Uncertainty over the number of poses",
        f"{text} A curve that is still steep gains from more poses; one that is flat rests on an "
        "error common to all of them, such as the gain of the scale, or on poses that load the "
        "joint alike. The dashed part is every pose measured once more.",
        f"Standard uncertainty of {curves.shape[1]} stiffnesses over the number of poses. {text}",
    )


def _row(curves: pd.DataFrame, share: float) -> int:
    """Row of the curves nearest to this share of the poses; the last row but one has all."""
    counts = curves.index.to_numpy(float)
    return int(np.abs(counts - share * counts[-2]).argmin())


def _known(share: float) -> str:
    return percent(share) if np.isfinite(share) else "no value"


def _correlation(answer: Answer, tables: Tables) -> tuple[list[str], Array]:
    """Names of the determined parameters, and their correlation matrix, shape (k, k)."""
    table = tables["covariance"]
    cov = table[list(table["parameter"])].to_numpy(float)
    std = np.sqrt(np.diag(cov))
    kept = np.flatnonzero(np.isfinite(std) & (std > 0))
    names = [parameter(answer, str(table["parameter"].iloc[k])) for k in kept]
    return names, np.asarray(cov[np.ix_(kept, kept)] / np.outer(std[kept], std[kept]))


def _draw_correlation(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw a square for each pair, with an area proportional to the absolute correlation."""
    names, r = _correlation(answer, tables)
    n = len(names)
    canvas.set_size_inches(5.6, 1.3 + 0.28 * n)
    axes = canvas.subplots()
    rows, columns = np.tril_indices(n, -1)
    values = r[rows, columns]
    tips: Tips = {}
    for key, colour, label, here in (
        ("positive", BLUE, "positive", values > 0),
        ("negative", RED, "negative", values <= 0),
    ):
        texts = [
            f"{names[i]} and {names[j]}: {v:+.2f}"
            for i, j, v in zip(rows[here], columns[here], values[here], strict=True)
        ]
        style = {"s": 620 * np.abs(values[here]) + 1, "marker": "s", "linewidths": 0}
        at = columns[here], rows[here]
        tips |= dots(axes, key, *at, texts, color=colour, label=label, **style)
    axes.set_yticks(range(1, n), names[1:])
    axes.set_xticks(range(n - 1), names[:-1], rotation=90)
    axes.set(xlim=(-0.6, n - 1.4), ylim=(n - 0.4, 0.4))
    axes.set_aspect("equal", adjustable="box", anchor="W")
    axes.grid(visible=False)
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1), markerscale=0.6)
    return {key: tip for key, tip in tips.items() if tip}


def _write_correlation(answer: Answer, tables: Tables) -> Figure | None:
    names, r = _correlation(answer, tables)
    if len(names) < 2:
        return None
    rows, columns = np.tril_indices(len(names), -1)
    values = r[rows, columns]
    worst = int(np.abs(values).argmax())
    count = int((np.abs(values) > _ALIKE).sum())
    text = (
        f"{names[rows[worst]]} and {names[columns[worst]]} are correlated most strongly, by "
        f"{values[worst]:+.2f}; {count or 'none'} of {len(values)} pairs "
        f"{'is' if count == 1 else 'are'} beyond ±{_ALIKE}."
    )
    return Figure(
        "correlation",
        "Correlation of the estimates",
        f"{text} The larger a square, the less these poses distinguish the two: their sum or "
        "difference is then known better than either of them. Predictions use the full covariance.",
        f"Triangle of the correlations of {len(names)} estimated parameters. {text}",
    )


ENOUGH = Plot("enough", ("enough",), _write_enough, _draw_enough)
CORRELATION = Plot("correlation", ("covariance",), _write_correlation, _draw_correlation)
