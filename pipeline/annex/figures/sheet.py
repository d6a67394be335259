"""Figures written directly as SVG: a sheet with shapes and texts, and a view of the cell."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
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

    def text(self, x: float, y: float, words: str, size: float = 12, **style: Any) -> None:
        """Add a text that starts at a point of its baseline, with a halo in the paper's colour."""
        own = {"x": f"{x:.1f}", "y": f"{y:.1f}", "paint-order": "stroke", "stroke": PAPER}
        own |= {"stroke-width": "3", "stroke-linejoin": "round"}
        base = {"font_family": _FONT, "font_size": f"{size:g}px", "fill": INK}
        self._add("text", own, base | style).text = self.say(words)

    def _add(self, kind: str, own: dict[str, str], style: dict[str, Any]) -> ET.Element:
        entries = {name.replace("_", "-"): f"{value}" for name, value in style.items()}
        return ET.SubElement(self.root, kind, own | entries)


PITCH = np.deg2rad(22.0)
"""Elevation of the viewing direction [rad]."""

_FAR = 3.0
"""Distance of the eye over the size of the cell [1]."""

FROM, TO = ([f"{end}_{a}_m" for a in "xyz"] for end in ("from", "to"))


@dataclass(frozen=True, eq=False)
class View:
    """A perspective view of the cell; the eye circles about its middle and z stays upright.

    Attributes:
        middle: Centre of the circle in F_b [m], shape (3,).
        size: Radius of the region to be shown [m].
        yaw: Direction of the eye, about z from x of F_b [rad].
    """

    middle: Array
    size: float
    yaw: float

    def __call__(self, points: Array) -> tuple[Array, Array, Array]:
        """Project points in F_b [m], shape (..., 3).

        Returns:
            Coordinates to the right and upwards [m], and the scale of the perspective [1], each of
            shape (...); the nearer a point, the larger its scale.
        """
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        d = points - self.middle
        right = c * d[..., 1] - s * d[..., 0]
        ahead = -(c * d[..., 0] + s * d[..., 1])
        up = np.cos(PITCH) * d[..., 2] + np.sin(PITCH) * ahead
        depth = np.cos(PITCH) * ahead - np.sin(PITCH) * d[..., 2]
        scale = 1 / (1 + depth / (_FAR * self.size))
        return scale * right, scale * up, scale


def outlines(view: View, rows: pd.DataFrame, radius: Array) -> tuple[Array, list[Array]]:
    """Outlines of projected capsules: two circular arcs and their common tangents.

    Args:
        view: The view.
        rows: Ends of the capsules' axes, one capsule per row.
        radius: Their radii [m], shape (c,).

    Returns:
        Mean scale of the perspective of each capsule, by which they are sorted, shape (c,), and
        its outline [m], shape (14, 2).
    """
    x, y, scale = view(np.stack([rows[FROM].to_numpy(float), rows[TO].to_numpy(float)]))
    r = scale * radius
    along = np.arctan2(y[1] - y[0], x[1] - x[0])
    apart = np.maximum(np.hypot(x[1] - x[0], y[1] - y[0]), 1e-9)
    half = np.arccos(np.clip((r[0] - r[1]) / apart, -1, 1))
    turn = np.linspace(0, 1, 7)[:, None]
    back = along + half + turn * (2 * np.pi - 2 * half)
    front = along - half + turn * 2 * half
    parts = [
        np.stack([x[k] + r[k] * np.cos(angle), y[k] + r[k] * np.sin(angle)], axis=-1)
        for k, angle in ((0, back), (1, front))
    ]
    outline = np.concatenate(parts).transpose(1, 0, 2)
    return scale.mean(axis=0), list(outline)
