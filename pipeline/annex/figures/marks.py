"""Shared parts of figures: distinguishable marks, legends, ticks at integers, titles."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure as Canvas

from pipeline.report.figures.plot import Tips
from pipeline.report.svg import GRID

_LONGEST = 100
"""Maximum length of a name in a legend [characters]."""

_ACROSS = 78
"""Number of characters that fit across a legend."""

_PER_INCH = 12.5
"""Characters of a title per inch of a plot with its margins: DejaVu Sans of 8.5 pt has an average
width of 5.0 pt, and the labels of the axis take a tenth of the width."""

MARKERS = ("o", "s", "^", "D", "v", "P")


def dots(axes: Axes, key: str, x: Any, y: Any, texts: Iterable[str], **style: Any) -> Tips:
    """Draw marks in a plot, and return their hover texts `texts` under `key`."""
    axes.scatter(x, y, gid=key, **style)
    return {key: list(texts)}


_SHARES = np.linspace(0.0, 1.0, 41)
"""Shares of a cumulative curve [1]; every fourth has a mark."""


def cumulative(
    axes: Axes,
    key: str,
    values: Any,
    label: str,
    text_of: Callable[[float, float], str],
    **style: Any,
) -> Tips:
    """Draw the share of the values below each value [%], with marks and their hover texts.

    Args:
        axes: The plot.
        key: Id of the marks.
        values: The values, shape (n,).
        label: Name in the legend.
        text_of: Hover text of a mark from its share [%] and its value.
        style: Style of the curve.
    """
    at, shares = np.quantile(values, _SHARES), 100 * _SHARES
    axes.plot(at, shares, linewidth=1.6, label=label, **style)
    shown = slice(4, -1, 4)
    words = [
        f"{label}: {text_of(share, value)}"
        for share, value in zip(shares[shown], at[shown], strict=True)
    ]
    return dots(axes, key, at[shown], shares[shown], words, s=9, color=style["color"], linewidths=0)


def cumulative_axes(axes: Axes, below: str, share: str) -> None:
    """Set up logarithmic axes of cumulative curves with these labels, and a legend."""
    axes.set_xscale("log")
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set(xlabel=below, ylabel=share)
    axes.grid(color=GRID, linewidth=0.6)
    legend_above(axes, 2)


def integer_ticks(axes: Axes, at: np.ndarray, names: Sequence[int]) -> None:
    """Label integers, as many as fit."""
    step = max(1, int(np.ceil(len(at) / 22)))
    axes.set_xticks(at[::step], [str(name) for name in names[::step]])


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"


def legend_above(axes: Axes, columns: int) -> None:
    """Add a legend above a plot, lines before marks."""
    handles, labels = axes.get_legend_handles_labels()
    at = sorted(range(len(labels)), key=lambda i: isinstance(handles[i], PathCollection))
    wordings = [_short(labels[i]) for i in at]
    columns = min(columns, max(1, _ACROSS // (max(map(len, wordings), default=1) + 4)))
    axes.legend(
        [handles[i] for i in at],
        wordings,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.1,
        labelspacing=0.15,
        markerscale=1.6,
        handletextpad=0.4,
    )


def legend_below(canvas: Canvas) -> None:
    """Add one legend for all plots of a figure, at its lower edge."""
    handles, labels = canvas.axes[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=len(labels), handlelength=1.6)


def title(axes: Axes, name: str) -> None:
    """Set the title of a plot above it at the left, wrapped to its part of the figure."""
    grid, canvas = axes.get_gridspec(), axes.get_figure(root=True)
    assert canvas is not None
    columns = 1 if grid is None else grid.ncols
    wide = max(int(_PER_INCH * canvas.get_size_inches()[0] / columns), 12)
    lines = [part for line in name.split("\n") for part in textwrap.wrap(line, wide)]
    axes.set_title("\n".join(lines), fontsize=8.5, loc="left", y=1.0, pad=4)


def rounded_down(value: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that does not exceed the value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-300)))
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-12)) * power)
