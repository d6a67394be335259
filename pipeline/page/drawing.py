"""The cell as entered, from the side and from above, which reveals a wrong axis or unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.machine.robot import Robot, configure, load

_WIDE, _HIGH, _MARGIN = 520, 380, 34
"""Width, height and margin of one view [pixel]."""

_LETTER = 14.0
"""Height of a line of text, about twice the width of a letter [pixel]."""

_VIEWS = (("from the side", 0, 2, "x", "z"), ("from above", 0, 1, "x", "y"))
"""Title of each view, and the axes of F_b that point right and up."""


class _Mark(NamedTuple):
    """A point with its name, kind (`joint`, `tool` or `base`) and position [m]."""

    name: str
    kind: str
    at: Array


def cell(
    robot: str, folder: Path, q: Sequence[float] | None, tool: Mapping[str, Sequence[float]],
    base: Mapping[str, Sequence[float]],
) -> str:  # fmt: skip
    """Two views as SVG; empty if the robot cannot be read.

    Args:
        robot: A robot that ships, or a robot file in the folder.
        folder: Folder of the campaign.
        q: Joint values [m] or [rad]; if None, zero, or the middle of its range for a joint whose
            range does not include zero.
        tool: Points in the flange frame [m] by name.
        base: Reflectors in F_b [m] by name.
    """
    try:
        arm = load(robot, folder)
    except InputError:
        return ""
    joints, tips = _places(arm, np.asarray(_usual(arm) if q is None else q, dtype=float), tool)
    marks = [*joints, *tips, *(_Mark(n, "base", np.asarray(p)) for n, p in base.items())]
    return "".join(_view(*view, marks, joints) for view in _VIEWS)


def _usual(robot: Robot) -> Array:
    """Posture that shows the arm: zero where that is within the range, else the middle."""
    zero = np.zeros(robot.n)
    middle = (np.maximum(robot.lower, -10.0) + np.minimum(robot.upper, 10.0)) / 2
    return np.where((robot.lower <= 0) & (robot.upper >= 0), zero, middle)


def _places(
    robot: Robot, q: Array, tool: Mapping[str, Sequence[float]]
) -> tuple[list[_Mark], list[_Mark]]:
    """Origins of joints and flange, and points of the tool, in F_b [m]."""
    here = configure(robot, q[None])
    names = [*(one.name for one in robot.joints), "flange"]
    at = np.vstack([here.origin[0], here.flange_origin])
    joints = [_Mark(name, "joint", place) for name, place in zip(names, at, strict=True)]
    tips = here.points(np.array(list(tool.values())).reshape(-1, 3))[0] if tool else []
    return joints, [_Mark(name, "tool", p) for name, p in zip(tool, tips, strict=True)]


def _view(
    title: str, right: int, up: int, x: str, y: str, marks: Sequence[_Mark], arm: Sequence[_Mark]
) -> str:
    """One view of all points, with the arm as a line through its joints."""
    flat = np.array([[one.at[right], one.at[up]] for one in marks] + [[0.0, 0.0]])
    low, size = flat.min(axis=0), np.ptp(flat, axis=0)
    scale = min(
        (_WIDE - 2 * _MARGIN) / max(size[0], 0.5),
        (_HIGH - 2 * _MARGIN - 2 * _LETTER) / max(size[1], 0.5),  # the title is above
    )

    def place(at: Array) -> tuple[float, float]:
        x, y = (np.array([at[right], at[up]]) - low) * scale + _MARGIN
        return float(x), float(_HIGH - y)

    def pixel(at: Array) -> str:
        x, y = place(at)
        return f"{x:.1f},{y:.1f}"

    origin = _Mark("F_b", "origin", np.zeros(3))
    named = [(one.name, *place(one.at)) for one in (origin, *marks) if one.kind != "joint"]
    parts = [
        f'<svg viewBox="0 0 {_WIDE} {_HIGH}" role="img" aria-label="The cell {title}">',
        f"<title>The cell {title}</title>",
        f'<text x="8" y="16">{title}: {x} to the right, {y} upwards</text>',
        _dot(origin.name, origin.kind, pixel(origin.at)),
        f'<polyline class="arm" points="{" ".join(pixel(one.at) for one in arm)}"/>',
        *(_dot(one.name, one.kind, pixel(one.at)) for one in marks),
        *_labels(named),
        _ruler(scale),
        "</svg>",
    ]
    return "".join(parts)


def _dot(name: str, kind: str, at: str) -> str:
    x, y = at.split(",")
    return f'<circle class="{kind}" cx="{x}" cy="{y}" r="4"><title>{escape(name)}</title></circle>'


def _labels(named: Sequence[tuple[str, float, float]]) -> Iterator[str]:
    """Names beside their points; points whose names would overlap share one line of names.

    Args:
        named: Name and position [pixel] of each point.
    """
    lines: list[tuple[list[str], float, float]] = []
    for name, x, y in named:
        near = (line for line in lines if abs(line[2] - y) < _LETTER and _meet(line, name, x))
        if line := next(near, None):
            line[0].append(name)
        else:
            lines.append(([name], x, y))
    for names, x, y in lines:
        side = 'dx="-6" text-anchor="end"' if x > _WIDE / 2 else 'dx="6"'
        yield f'<text x="{x:.1f}" y="{y:.1f}" {side} dy="-5">{escape(", ".join(names))}</text>'


def _meet(line: tuple[list[str], float, float], name: str, x: float) -> bool:
    """Whether a name beside a point would overlap a line of names."""
    (left, right), (low, high) = _extent(", ".join(line[0]), line[1]), _extent(name, x)
    return left < high and low < right


def _extent(text: str, x: float) -> tuple[float, float]:
    """Left and right end of a text beside a point, which is on the inner side of it."""
    long = _LETTER / 2 * len(text) + 12
    return (x - long, x) if x > _WIDE / 2 else (x, x + long)


def _ruler(scale: float) -> str:
    """Scale bar of one, two or five times a power of ten in metres, at the bottom."""
    steps = [m * 10.0**e for e in (-2, -1, 0, 1) for m in (1, 2, 5)]
    length = max((one for one in steps if one * scale <= _WIDE / 3), default=steps[0])
    end = _MARGIN + length * scale
    return (
        f'<line class="ruler" x1="{_MARGIN}" y1="{_HIGH - 8}" x2="{end:.1f}" y2="{_HIGH - 8}"/>'
        f'<text x="{end + 6:.1f}" y="{_HIGH - 4}">{length:g} m</text>'
    )


# --- during the measurement -----------------------------------------------------------------------

_PER_CENT = (0.1, 1, 10, 100)
"""Grid lines of the logarithmic scale [%]."""

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555")
"""Distinguishable with every kind of colour vision (Okabe and Ito), and by labels at the end."""


def _known(
    told: Mapping[int, Mapping[str, Any]], most: int
) -> dict[str, list[tuple[float, float]]]:
    """Points of the curve of each axis, from the updates by number of poses."""
    known: dict[str, list[tuple[float, float]]] = {}
    for poses, one in sorted(told.items()):
        for joint in one["stiffness"]:
            if (share := joint["relative_std"]) is not None:
                point = (_across(poses, most), _up(100 * share))
                known.setdefault(str(joint["axis"]), []).append(point)
    return known


def curves(updates: Sequence[Mapping[str, Any]]) -> str:
    """Relative standard uncertainty of each stiffness over the number of poses measured, as SVG.

    Args:
        updates: Lines of `pipeline watch --live --json`.
    """
    entries = {one["poses"]: one for one in updates if one.get("stiffness")}
    if not entries:
        return ""
    most = max(max(entries), 2)
    known = _known(entries, most)
    out = [f'<svg viewBox="0 0 {_WIDE} {_HIGH}" role="img" aria-label="Uncertainty over poses">']
    for line in _PER_CENT:
        y = _up(line)
        out.append(f'<line class="grid" x1="{_MARGIN}" x2="{_WIDE - _MARGIN}" y1="{y}" y2="{y}"/>')
        out.append(f'<text x="2" y="{y + 4}">{line} %</text>')
    for poses in range(1, most + 1):
        x = _across(poses, most)
        out.append(f'<text x="{x}" y="{_HIGH - 8}" text-anchor="middle">{poses}</text>')
    labels = _spread([points[-1][1] for points in known.values()])
    for k, (name, points) in enumerate(known.items()):
        path, colour = " ".join(f"{x},{y}" for x, y in points), _COLOURS[k % len(_COLOURS)]
        out.append(f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{path}"/>')
        x, y = points[-1][0] + 6, labels[k] + 4
        out.append(f'<text x="{x:.1f}" y="{y:.1f}">{escape(name)}</text>')
    return "".join([*out, "</svg>"])


def _spread(heights: Sequence[float]) -> Array:
    """Heights of labels, shifted upwards where necessary so that they do not overlap."""
    out = np.array(heights, dtype=float)
    for before, here in pairwise(np.argsort(-out)):
        out[here] = min(out[here], out[before] - _LETTER)
    return out


def _across(poses: int, most: int) -> float:
    return round(_MARGIN + (_WIDE - 3 * _MARGIN) * (poses - 1) / (most - 1), 1)


def _up(per_cent: float) -> float:
    """Vertical position of a percentage, on a logarithmic scale with the range of `_PER_CENT`."""
    low, high = np.log10([_PER_CENT[0], _PER_CENT[-1]])
    share = np.clip((np.log10(max(per_cent, 1e-9)) - low) / (high - low), 0.0, 1.0)
    return round(float(_HIGH - _MARGIN - share * (_HIGH - 2 * _MARGIN)), 1)
