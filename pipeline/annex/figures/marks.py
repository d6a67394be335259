"""What the figures share: marks that can be told apart, legends, ticks at whole numbers."""

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
"""Characters of a name in a legend."""

_ACROSS = 78
"""Characters that a legend has beside each other."""

_PER_INCH = 12.5
"""Characters of a title in an inch of a plot and its margins: DejaVu Sans, 8.5 pt, of average width
5.0 pt, and a tenth of the width for the labels of the axis."""

MARKERS = ("o", "s", "^", "D", "v", "P")


def dots(axes: Axes, key: str, x: Any, y: Any, said: Iterable[str], **style: Any) -> Tips:
    """Marks in a plot, and what each of them says."""
    axes.scatter(x, y, gid=key, **style)
    return {key: list(said)}


_SHARES = np.linspace(0.0, 1.0, 41)
"""Steps of a cumulative curve; every fourth has a mark."""


def cumulative(
    axes: Axes, key: str, values: Any, label: str, said: Callable[[float, float], str], **style: Any
) -> Tips:
    """Share of the values below each value [%], with what marks of share and value say."""
    at, shares = np.quantile(values, _SHARES), 100 * _SHARES
    axes.plot(at, shares, linewidth=1.6, label=label, **style)
    shown = slice(4, -1, 4)
    words = [
        f"{label}: {said(share, value)}"
        for share, value in zip(shares[shown], at[shown], strict=True)
    ]
    return dots(axes, key, at[shown], shares[shown], words, s=9, color=style["color"], linewidths=0)


def cumulative_axes(axes: Axes, below: str, share: str) -> None:
    """Axes of cumulative curves: values from small to large in decades."""
    axes.set_xscale("log")
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set(xlabel=below, ylabel=share)
    axes.grid(color=GRID, linewidth=0.6)
    legend_above(axes, 2)


def integer_ticks(axes: Axes, at: np.ndarray, names: Sequence[int]) -> None:
    """Label whole numbers, as many as fit."""
    step = max(1, int(np.ceil(len(at) / 22)))
    axes.set_xticks(at[::step], [str(name) for name in names[::step]])


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"


def legend_above(axes: Axes, columns: int) -> None:
    """The legend on top of a plot, lines before marks."""
    handles, labels = axes.get_legend_handles_labels()
    at = sorted(range(len(labels)), key=lambda i: isinstance(handles[i], PathCollection))
    said = [_short(labels[i]) for i in at]
    columns = min(columns, max(1, _ACROSS // (max(map(len, said), default=1) + 4)))
    axes.legend(
        [handles[i] for i in at],
        said,
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
    """One legend for all plots of a figure, at its lower edge."""
    handles, labels = canvas.axes[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=len(labels), handlelength=1.6)


def title(axes: Axes, name: str) -> None:
    """What a plot shows, on top of it at the left, in lines no wider than its part of the sheet."""
    grid, canvas = axes.get_gridspec(), axes.get_figure(root=True)
    assert canvas is not None
    columns = 1 if grid is None else grid.ncols
    wide = max(int(_PER_INCH * canvas.get_size_inches()[0] / columns), 12)
    lines = [part for line in name.split("\n") for part in textwrap.wrap(line, wide)]
    axes.set_title("\n".join(lines), fontsize=8.5, loc="left", y=1.0, pad=4)
