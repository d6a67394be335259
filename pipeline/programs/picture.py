"""Picture of a program before and after its correction: one SVG, drawn without a library."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.library.compensate import Compensation

_WIDE, _HIGH, _EDGE = 760, 250, 60
_TAUGHT, _BEFORE, _AFTER = "#6b7280", "#c2410c", "#0f766e"
_SHARE = 0.08
"""Size of the largest deflection as drawn, relative to the size of the part [1]."""


def picture(name: str, tips: Array, found: Compensation) -> str:
    """Deflection along the path before and after, and the part with the deflection enlarged.

    Args:
        name: Name of the program.
        tips: Point where the force acts at each target, F_b [m], shape (m, 3).
        found: Offsets of the targets.
    """
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    before, after = 1e3 * found.deflection, 1e3 * found.left
    title = f"{name}: deflection under its load, before and after the correction"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE} {2 * _HIGH}" role="img" '
        f'font-family="sans-serif" font-size="12"><title>{escape(title)}</title>'
        f'<rect width="100%" height="100%" fill="white"/>',
        *_curves(along, before, after),
        f'<g transform="translate(0,{_HIGH})">',
        *_part(tips, found.shift),
        "</g></svg>",
    ]
    return "\n".join([*parts, ""])


def _curves(along: Array, before: Array, after: Array) -> Iterator[str]:
    """Curves of the deflection [mm] over the distance travelled [m]."""
    far, most = max(float(along[-1]), 1e-9), max(float(before.max()), 1e-9)
    x = _EDGE + along / far * (_WIDE - 2 * _EDGE)
    floor, height = _HIGH - 45, _HIGH - 90
    yield _line([(_EDGE, floor), (_WIDE - _EDGE, floor)], _TAUGHT)
    yield _words(_EDGE - 6, floor - height, f"{most:.3f} mm", _BEFORE, "end")
    yield _words(_EDGE - 6, floor, "0", _TAUGHT, "end")
    yield _words(_WIDE - _EDGE, floor + 18, f"{far:.3f} m along the way", _TAUGHT, "end")
    for values, color, text, at in (
        (before, _BEFORE, f"before: up to {before.max():.3f} mm", _EDGE),
        (after, _AFTER, f"after, by the model: up to {after.max():.4f} mm", _EDGE + 260),
    ):
        y = floor - values / most * height
        yield _line([*zip(x, y, strict=True)], color, True)
        yield _words(at, 22, text, color)


def _part(tips: Array, shift: Array) -> Iterator[str]:
    """The targets in their plane of largest extent, and their positions under load, enlarged."""
    middle = tips.mean(axis=0)
    plane = linear.principal(tips - middle)[2][:2]
    wide, high = np.maximum(np.abs((tips - middle) @ plane.T).max(axis=0), 1e-6)
    size = max(float(wide), float(high))
    most = float(np.linalg.norm(shift, axis=1).max())
    times = _SHARE * 2 * size / most if most else 0.0
    scale = min((_WIDE / 2 - _EDGE) / wide, (_HIGH / 2 - 60) / max(high, _SHARE * 2 * size))

    def drawn(points: Array) -> list[tuple[float, float]]:
        flat = (points - middle) @ plane.T * scale
        return [(_WIDE / 2 + a, _HIGH / 2 - b) for a, b in flat.tolist()]

    yield _line(drawn(tips), _TAUGHT)
    yield _line(drawn(tips - times * shift), _BEFORE, True)
    yield _words(_EDGE, 22, "as taught", _TAUGHT)
    yield _words(_EDGE + 90, 22, f"under the load, enlarged {times:.0f} times", _BEFORE)


def _line(points: Sequence[tuple[float, float]], color: str, dotted: bool = False) -> str:
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    marks = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.2" fill="{color}"/>' for x, y in points if dotted
    )
    return f'<polyline points="{places}" fill="none" stroke="{color}" stroke-width="1.5"/>{marks}'


def _words(x: float, y: float, text: str, color: str, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" fill="{color}" text-anchor="{anchor}">{escape(text)}</text>'
    )
