"""Draw robots from the side to one scale, at the zero of the controller, as makers do."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot import Robot, axes, configure

_CELL_PX, _TEXT_PX, _BESIDE = 250.0, 64.0, 4
"""Width and height of a drawing, height of the text below it [px], and drawings in a row [1]."""
_INK, _MUTED = "#1b1b1f", "#5f6368"


def drawing(robots: Sequence[Robot]) -> str:
    """Draw robots as SVG, with name, description, payload and reach of the arm at zero."""
    arms = [_arm(robot) for robot in robots]
    widest = max(float(np.ptp(np.vstack([arm, [0.0, 0.0]]), axis=0).max()) for arm in arms)
    scale = 0.84 * _CELL_PX / widest
    columns = min(_BESIDE, len(robots))
    rows = -(-len(robots) // columns)
    width, height = columns * _CELL_PX, rows * (_CELL_PX + _TEXT_PX)
    cells = "".join(
        _cell(robot, arm, scale, k % columns * _CELL_PX, k // columns * (_CELL_PX + _TEXT_PX))
        for k, (robot, arm) in enumerate(zip(robots, arms, strict=True))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}" font-family="sans-serif">'
        f'<rect width="100%" height="100%" fill="#fff"/>{cells}</svg>\n'
    )


def _arm(robot: Robot) -> Array:
    """Joints and flange in the vertical plane of the arm [m], shape (k, 2)."""
    zero = robot.from_controller(np.zeros(len(axes.of(robot).names)))
    at = configure(robot, zero[None])
    turning = int(np.argmin(robot.prismatic))
    points = np.vstack([at.origin[0, turning:], at.flange_origin])
    points = points - [*points[0, :2], 0.0]
    across = int(np.argmax(np.abs(points[:, :2]).max(axis=0)))
    side = points[:, [across, 2]]
    return side if side[np.argmax(np.abs(side[:, 0])), 0] >= 0 else side * [-1, 1]


def _cell(robot: Robot, arm: Array, scale: float, left: float, top: float) -> str:
    low, high = (f(np.vstack([arm, [0.0, 0.0]]), axis=0) for f in (np.min, np.max))
    middle = left + _CELL_PX / 2 - scale * (low[0] + high[0]) / 2
    floor = top + _CELL_PX - 16 + scale * min(0.0, float(low[1]))
    xy = [(middle + scale * x, floor - scale * z) for x, z in arm]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in [(middle, floor), *xy])
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>' for x, y in xy)
    payload = "" if robot.payload_kg is None else f"{robot.payload_kg:g} kg, "
    size = (
        f"{payload}{float(np.hypot(*(arm[-1] - [0.0, arm[0, 1]]))):.2f} m from axis 1 to the flange"
    )
    words = [(robot.name, _INK, 700), (robot.description[:38], _MUTED, 400), (size, _MUTED, 400)]
    text = "".join(
        f'<text x="{left + 12:g}" y="{top + _CELL_PX + 14 + 16 * k:g}" font-size="12" '
        f'font-weight="{weight}" fill="{colour}">{escape(word)}</text>'
        for k, (word, colour, weight) in enumerate(words)
    )
    return (
        f'<g fill="{_INK}"><path d="M{left + 12:g} {floor:.1f}h{_CELL_PX - 24:g}" '
        f'stroke="{_MUTED}"/><polyline points="{line}" fill="none" stroke="{_INK}" '
        f'stroke-width="4" stroke-linejoin="round"/>{dots}{text}</g>'
    )
