"""Room around the plots of a figure for what is written there, measured once.

Matplotlib's constrained layout gives the same pictures, but it measures every label several times:
all figures of a report then take 1.45 times as long to draw, twice as long without the coarser
ticks. Here each label is measured once, by its letters alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.figure import Figure as Canvas
from matplotlib.gridspec import GridSpecBase
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text
from matplotlib.textpath import text_to_path
from matplotlib.ticker import AutoLocator

_POINTS = 72.0
"""To the inch; all lengths here are points."""
_EDGE = 4.0
"""Between what is written and the edge of the figure."""
_GAP = 6.0
"""Between plots side by side or one above the other."""
_MOST_ROOM = 0.75
"""Share of a figure that words may take; longer ones are cut, so that a plot is left."""
LINE = 1.25
"""Height of a line of text over the size of its letters."""
_TICK_PAD = 3.5
"""Matplotlib's own, from a plot to the labels of its ticks."""
_LABEL_PAD = 4.5
"""Between the labels of the ticks and the label of their axis."""
_PLOT_SHARE = 0.7
"""Of a column, about what its plot gets; only labels that reach beyond the ends need it."""
_STEPS = 6
"""At most so many steps on an axis that chooses its own: enough to read, and each costs time."""


class Margins(LayoutEngine):
    """Sets a regular grid of plots as large as their labels leave room for."""

    _adjust_compatible = False
    _colorbar_gridspec = True

    def __init__(self) -> None:
        """Nothing is kept above any plot."""
        super().__init__()
        self._above: dict[Axes, float] = {}
        self._below = 0.0

    @staticmethod
    def of(canvas: Canvas | None) -> Margins:
        """Those of a figure made with them."""
        assert canvas is not None
        engine = canvas.get_layout_engine()
        assert isinstance(engine, Margins)
        return engine

    def keep_above(self, axes: Axes, points: float) -> None:
        """Keep room above a plot, for a legend or a title."""
        self._above[axes] = self._above.get(axes, 0.0) + points

    def keep_below(self, points: float) -> None:
        """Keep room at the lower edge of the figure."""
        self._below += points

    def execute(self, fig: Canvas) -> None:
        """Place the plots of a figure and the labels of their axes."""
        width, height = _POINTS * fig.get_size_inches()
        cells = {a: spec for a in fig.axes if (spec := a.get_subplotspec()) is not None}
        grid = next(iter(cells.values())).get_gridspec()
        rooms = _rooms(cells, grid, width)
        in_column = [[a for a in cells if cells[a].colspan.start == k] for k in range(grid.ncols)]
        in_row = [[a for a in cells if cells[a].rowspan.start == k] for k in range(grid.nrows)]
        beside = [[(rooms[a].left, rooms[a].right) for a in line] for line in in_column]
        above = [[(self._top(a), rooms[a].bottom) for a in line] for line in in_row]
        columns = _spans(width, beside, grid.get_width_ratios())
        rows = _spans(height - self._below, above, grid.get_height_ratios())
        for axes, cell in cells.items():
            (left, wide), (top, high) = columns[cell.colspan.start], rows[cell.rowspan.start]
            bottom = height - top - high
            axes.set_position((left / width, bottom / height, wide / width, high / height))
            ticks = max(rooms[a].y_ticks for a in in_column[cell.colspan.start])
            aside = (ticks + _LABEL_PAD) / wide
            below = (rooms[axes].x_ticks + _LABEL_PAD) / high
            axes.xaxis.set_label_coords(_middle(axes.xaxis, left, wide, width), -below)
            middle = _middle(axes.yaxis, bottom, high, height)
            axes.yaxis.set_label_coords(1 + aside if _on_right(axes) else -aside, middle)

    def _top(self, axes: Axes) -> float:
        return _EDGE + self._above.get(axes, 0.0)


@dataclass(frozen=True)
class _Room:
    """What one plot needs around it, and how far the labels of its ticks reach [pt]."""

    left: float
    right: float
    bottom: float
    x_ticks: float
    y_ticks: float


def _rooms(cells: Iterable[Axes], grid: GridSpecBase, width: float) -> dict[Axes, _Room]:
    """What each plot needs, once all of them have the steps that they keep."""
    for axes in cells:
        _coarsen(axes.xaxis, grid.ncols)
        _coarsen(axes.yaxis, grid.nrows)
    return {axes: _room(axes, _PLOT_SHARE * width / grid.ncols) for axes in cells}


def _room(axes: Axes, wide: float) -> _Room:
    x_ticks, low, high = _ticks(axes.xaxis, wide)
    y_ticks, _, _ = _ticks(axes.yaxis, wide)
    side = _EDGE + y_ticks + _label(axes.yaxis)
    left, right = (_EDGE, side) if _on_right(axes) else (side, _EDGE)
    bottom = _EDGE + x_ticks + _label(axes.xaxis)
    return _Room(max(left, low), max(right, high), bottom, x_ticks, y_ticks)


def _coarsen(axis: Axis, plots: int) -> None:
    """Fewer steps where several plots share the figure."""
    if isinstance(locator := axis.get_major_locator(), AutoLocator):
        locator.set_params(nbins=max(_STEPS // plots + (plots > 1), 3))


def _on_right(axes: Axes) -> bool:
    return str(axes.yaxis.get_label_position()) == "right"


def _spans(
    whole: float, around: Sequence[Sequence[tuple[float, float]]], ratios: Any
) -> list[tuple[float, float]]:
    """Start and length of every column or row, from what its plots need before and after [pt]."""
    first, last = np.array([np.max(line, axis=0) for line in around]).T
    share = min(1.0, _MOST_ROOM * whole / (first + last + _GAP).sum())
    taken = share * (first + last + _GAP)
    length = (whole + share * _GAP - taken.sum()) * np.asarray(ratios) / np.sum(ratios)
    start = share * first + np.concatenate([[0.0], np.cumsum(taken + length)[:-1]])
    return list(zip(start.tolist(), length.tolist(), strict=True))


def _label(axis: Axis) -> float:
    """Thickness of an axis label with its distance from the ticks."""
    words = axis.label.get_text()
    lines = words.count("\n") + 1
    return _LABEL_PAD + LINE * lines * float(axis.label.get_fontsize()) if words else 0.0


def _middle(axis: Axis, start: float, length: float, whole: float) -> float:
    """Where along its axis a label stands: in the middle, unless the figure would cut it there."""
    half = max(_width(line, axis.label) for line in axis.label.get_text().split("\n")) / 2 + _EDGE
    inside = min(max(start + length / 2, half), max(whole - half, half))
    return (inside - start) / length


def _ticks(axis: Axis, wide: float) -> tuple[float, float, float]:
    """How far tick labels reach out of a plot, and beyond both ends of an x axis."""
    labels = axis.get_ticklabels() if axis.get_tick_params()[_shown(axis)] else []
    labels = [label for label in labels if label.get_text()]
    if not labels:
        return 0.0, 0.0, 0.0
    boxes = [_turned(label) for label in labels]
    out = _TICK_PAD + max(box[isinstance(axis, XAxis)] for box in boxes)
    if not isinstance(axis, XAxis):
        return out, 0.0, 0.0
    limits = axis.get_transform().transform(axis.get_view_interval())
    at = axis.get_transform().transform(np.asarray(axis.get_ticklocs(), dtype=float))
    shares = (at[: len(boxes)] - limits[0]) / (limits[1] - limits[0])
    seen = [
        (s, box[0], label.get_horizontalalignment())
        for s, box, label in zip(shares, boxes, labels, strict=False)
        if -1e-6 <= s <= 1 + 1e-6
    ]
    low = max((w * _before(how) - s * wide for s, w, how in seen), default=0.0)
    high = max((w * (1 - _before(how)) - (1 - s) * wide for s, w, how in seen), default=0.0)
    return out, low + _EDGE, high + _EDGE


def _shown(axis: Axis) -> str:
    return "labelbottom" if isinstance(axis, XAxis) else f"label{axis.get_label_position()}"


def _before(alignment: str) -> float:
    """Share of a label that lies before its tick."""
    return {"left": 0.0, "center": 0.5, "right": 1.0}[alignment]


def _turned(label: Text) -> tuple[float, float]:
    """Width and height of a label as it stands [pt]."""
    width, height = _width(label.get_text(), label), float(label.get_fontsize())
    angle = np.radians(label.get_rotation())
    c, s = abs(np.cos(angle)), abs(np.sin(angle))
    return float(c * width + s * height), float(s * width + c * height)


def _width(line: str, style: Text) -> float:
    """Width of a line of text in the letters of another [pt]."""
    font = style.get_fontproperties()
    return float(text_to_path.get_text_width_height_descent(line, font, ismath=False)[0])
