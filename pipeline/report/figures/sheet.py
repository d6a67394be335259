"""Figures written directly as SVG: a sheet with shapes and texts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from pipeline.base.language import Say
from pipeline.report.svg import INK, PAPER

_FONT = "DejaVu Sans"


class PixelSheet:
    """A drawing in pixels from the upper left corner; later shapes cover earlier ones."""

    def __init__(self, width: float, height: float, say: Say = str) -> None:
        """Begin an empty sheet of this size [px]; `say` translates its texts."""
        size = {"width": f"{width:g}pt", "height": f"{height:g}pt"}
        box = {"viewBox": f"0 0 {width:g} {height:g}"}
        self.root = ET.Element("svg", {"xmlns": "http://www.w3.org/2000/svg", **box, **size})
        self.width, self.height, self.say = width, height, say

    @property
    def svg(self) -> str:
        """The sheet as the text of an SVG file."""
        return ET.tostring(self.root, encoding="unicode")

    def shape(self, points: Any, close: bool = True, **style: Any) -> None:
        """Add a polygon, or a polyline, through points [px], shape (k, 2)."""
        at = " ".join(f"{x:.1f},{y:.1f}" for x, y in np.asarray(points, dtype=float))
        self._add("polygon" if close else "polyline", {"points": at}, style)

    def line(self, a: Any, b: Any, colour: str = INK, width: float = 1.0, **style: Any) -> None:
        """Add a straight line."""
        self.shape([a, b], close=False, stroke=colour, stroke_width=width, fill="none", **style)

    def arrow(self, a: Any, b: Any, colour: str, width: float = 2.4) -> None:
        """Add an arrow from a to b."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        length = float(np.hypot(*(b - a))) or 1.0
        along = (b - a) / length
        head, across = min(4 * width, 0.6 * length), np.array([-along[1], along[0]])
        neck = b - head * along
        self.line(a, neck, colour, width)
        self.shape([b, neck + 0.45 * head * across, neck - 0.45 * head * across], fill=colour)

    def disc(self, at: Any, radius: float, tip: str = "", **style: Any) -> None:
        """Add a circle, with the text shown when the pointer is over it."""
        x, y = at
        own = {"cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": f"{radius:g}"}
        self._add("circle", own | ({"data-tip": self.say(tip)} if tip else {}), style)

    def square(self, x: float, y: float, side: float, tip: str = "", **style: Any) -> None:
        """Add a square at its upper left corner, with the text shown under the pointer."""
        own = {"x": f"{x:.1f}", "y": f"{y:.1f}", "width": f"{side:.1f}", "height": f"{side:.1f}"}
        self._add("rect", own | ({"data-tip": tip} if tip else {}), style)

    def text(self, x: float, y: float, said: str, size: float = 12, **style: Any) -> None:
        """Add a text that starts at a point of its baseline, with a halo in the paper's colour."""
        own = {"x": f"{x:.1f}", "y": f"{y:.1f}", "paint-order": "stroke", "stroke": PAPER}
        own |= {"stroke-width": "3", "stroke-linejoin": "round"}
        base = {"font_family": _FONT, "font_size": f"{size:g}px", "fill": INK}
        self._add("text", own, base | style).text = self.say(said)

    def _add(self, kind: str, own: dict[str, str], style: dict[str, Any]) -> ET.Element:
        entries = {name.replace("_", "-"): f"{value}" for name, value in style.items()}
        return ET.SubElement(self.root, kind, own | entries)
