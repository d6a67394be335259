"""From a matplotlib figure to reproducible SVG with hover texts and the colours of the page."""

from __future__ import annotations

import contextlib
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.base.environment import elsewhere, without

# the first import reads a matplotlibrc, which must not be a campaign's, and fails for a backend of
# another name than its own
with elsewhere(), without("MPLBACKEND") as _backend:
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Canvas
if _backend:  # for figures of whoever imports us
    with contextlib.suppress(ValueError):
        matplotlib.rcParams["backend"] = _backend

FONTS = f"{matplotlib.get_data_path()}/fonts/ttf"
"""Folder of the typeface of the figures."""

INK, MUTED, GRID, PAPER = "#1a1c21", "#5b6270", "#d4d8de", "#ffffff"
BLUE, RED, GREEN, PURPLE = "#0072b2", "#c8500a", "#00785a", "#8a4f7e"
BODY, EDGE = "#b9c3d1", "#4a5568"
"""Colours of a robot's links and of their outlines."""

SERIES = (BLUE, RED, GREEN, PURPLE)
"""Colours of data series, after Okabe and Ito, darkened to a contrast of at least 3:1 on white."""

SHADES = tuple(
    "#00224e #123570 #3b496c #575d6d #707173 #8a8678 #a59c74 #c3b369 #e1cc55".split()  # noqa: SIM905
)
"""Nine steps of cividis, distinguishable by brightness alone."""

APART_SHADES = ("#7a1f00", "#b5480f", "#dc8c55", "#eac8ab", "#f1e6dc")
"""Five shades from strong to faint; the strongest marks what to act on, also on a dark page."""

_VARIABLES = {
    **{shade: f"--shade-{step}" for step, shade in enumerate(SHADES)},
    **{shade: f"--apart-{step}" for step, shade in enumerate(APART_SHADES)},
    INK: "--fig-ink",
    MUTED: "--fig-muted",
    GRID: "--fig-grid",
    PAPER: "--paper",
    BODY: "--fig-body",
    EDGE: "--fig-edge",
    **{colour: f"--fig-{place}" for place, colour in enumerate(SERIES, 1)},
}
"""Style variable of the page for each colour, so that a dark page can redefine it."""

STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pipeline",
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.parse_math": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    **{f"{axis}tick.color": MUTED for axis in "xy"},
    **{f"{axis}tick.labelcolor": INK for axis in "xy"},
    **{f"{axis}tick.major.size": 0 for axis in "xy"},
    "xtick.bottom": False,
    "ytick.left": False,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.figsize": (5.6, 3.1),
    "figure.constrained_layout.use": True,
}

_PLAIN: Any = {key: matplotlib.rcParamsDefault[key] for key in matplotlib.rcParamsDefault}
_PLAIN.pop("backend")  # concerns windows, and none is opened
_ON_THE_PAGE: Any = _PLAIN | STYLE | {"figure.facecolor": "none", "axes.facecolor": "none"}
"""All settings of matplotlib, so that figures do not depend on a matplotlibrc."""

_SHAPES = {"use", "path"}


_WHOLE_PX = 560
"""Maximum width of a hand-written SVG figure that shrinks with the page [px]; a wider one is
scrolled."""

_HALF_PX = 544
"""Minimum width of half a page in page.css [px]: 34 rem of 16 pixels."""


@dataclass(frozen=True)
class Drawing:
    """A finished figure.

    Attributes:
        svg: The self-contained file in light colours.
        inline: The same for use inside a page: colours as variables, `data-tip` on every value.
    """

    svg: str
    inline: str


def drawn(name: str, draw: Callable[[Canvas], Mapping[str, Sequence[str]]]) -> Drawing:
    """Draw a figure, write it as SVG, and attach hover texts to its marks.

    Args:
        name: Name of the figure, which makes its ids unique within a page.
        draw: Draws on an empty figure and returns, by id of an artist, the text of each of its
            marks in drawing order.
    """
    text = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context(_ON_THE_PAGE | {"svg.hashsalt": name}):
        canvas = Canvas()
        tips = draw(canvas)
        if len(canvas.axes) == 1 and not canvas.legends:  # one pass over its labels is enough
            canvas.set_layout_engine("tight", pad=0.4)
        canvas.align_ylabels()  # of plots below each other
        # Figure.savefig would draw everything a second time for the layout.
        FigureCanvasSVG(canvas).print_svg(text, metadata=nothing)  # type: ignore[no-untyped-call]
    return Drawing(text.getvalue(), _inline(text.getvalue(), tips))


def by_hand(svg: str) -> Drawing:
    """A figure that is already SVG with its hover texts; one wider than `_WHOLE_PX` is scrolled."""
    width = float(ET.fromstring(svg).attrib["viewBox"].split()[2])
    return Drawing(svg, _inline(svg, {}, whole=width <= _WHOLE_PX))


def _inline(svg: str, tips: Mapping[str, Sequence[str]], *, whole: bool = False) -> str:
    """SVG for use inside a page; a `whole` figure shrinks with the page, others are scrolled."""
    root = ET.fromstring(svg)
    for artist, words in tips.items():
        _attach(root, artist, words)
    _without_namespaces(root)
    _, _, width, _ = root.attrib["viewBox"].split()
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    least = 0.0 if whole else 1.06 * float(width)  # a point is a pixel at least
    root.set("style", f"min-width: {least:.0f}px")
    if least > _HALF_PX:
        root.set("class", "broad")
    text = ET.tostring(root, encoding="unicode")
    used = {a or b for a, b in re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', text)}
    text = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r"font-family: [^;\"]*", "font-family: inherit", text)
    text = re.sub(r"<style[^>]*>.*?</style>", "", text, flags=re.DOTALL)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    return text


def _without_namespaces(root: ET.Element) -> None:
    """Remove the namespaces of tags and attributes, as HTML requires."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        for key in [one for one in element.attrib if one.startswith("{")]:
            element.set(key.rpartition("}")[2], element.attrib.pop(key))


def _attach(root: ET.Element, artist: str, words: Sequence[str]) -> None:
    marks = [mark for group in root.iter() if group.get("id") == artist for mark in _marks(group)]
    if len(marks) != len(words):
        raise AssertionError(f"{artist}: {len(marks)} marks drawn for {len(words)} values")
    for mark, word in zip(marks, words, strict=True):
        mark.set("data-tip", word)


def _marks(element: ET.Element) -> list[ET.Element]:
    """Shapes drawn below an element, without those in `defs`."""
    found = []
    for child in element:
        kind = child.tag.rpartition("}")[2]
        if kind == "defs":
            continue
        found += [child] if kind in _SHAPES else _marks(child)
    return found
