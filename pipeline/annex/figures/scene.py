"""The cell in three dimensions: robot, instrument, reflectors, poses, deflections and residuals.

A still picture serves paper and pages without scripts; from the same data the page draws a picture
that its reader can turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from pipeline.annex.figures.marks import rounded_down
from pipeline.annex.figures.sheet import FROM, PITCH, TO, View, outlines
from pipeline.annex.scene import MOST_POSES
from pipeline.answer.contract import Answer, JointType
from pipeline.base.arrays import Array
from pipeline.base.quantities import MM, known, plain, typeset
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, each_row
from pipeline.report.svg import BLUE, BODY, EDGE, GRID, INK, RED

_ASIDE = np.deg2rad(-28.0)
"""Angle between the view and the normal of the longer horizontal side [rad], in the still and at
first on the page."""

_REACH = 0.12
"""Length of the median vector as drawn, over the height of the space that the arm takes [1]."""

_SOLID = ("base", "carriage", "arm", "tool")

_BESIDE = 1.6
"""Distance from the middle up to which instrument and reflectors are in the still, over the size of
the view [1]."""

_WIDE_IN = 5.6
"""Width of the still [in]."""

_SLIM = 0.55
"""Radius of links as drawn over their true one [1]; thinner, so that adjacent poses can be
distinguished."""

_LEAST_M = 0.006
"""Minimum radius of a body as drawn [m]."""

_AT, _MOVED, _LEFT = ([f"{name}{a}_m" for a in "xyz"] for name in ("", "moved_", "left_"))
_COV = [f"c{pair}_m2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")]


def _view(tables: Tables) -> View:
    """View centred on the robot at all its poses; distant instruments do not reduce its size."""
    rows = tables["scene"]
    seen = rows[rows["part"].isin(_SOLID)]
    ends = np.concatenate([seen[FROM].to_numpy(float), seen[TO].to_numpy(float)])
    low, high = ends.min(axis=0), ends.max(axis=0)
    across = 0.0 if high[1] - low[1] >= high[0] - low[0] else -np.pi / 2
    size = float(np.linalg.norm(high - low)) / 2
    return View((low + high) / 2, size, float(across + _ASIDE))


def _magnified(tables: Tables) -> tuple[float, float]:
    """Magnifications of deflections and residuals [1], each 1, 2 or 5 times a power of ten."""
    vectors = tables["vectors"]
    arm = tables["scene"][tables["scene"]["part"] == "arm"]
    height = np.ptp(arm[[FROM[2], TO[2]]].to_numpy(float)) or 1.0
    return tuple(
        rounded_down(_REACH * height / max(float(np.median(_size(vectors, columns))), 1e-9))
        for columns in (_MOVED, _LEFT)
    )  # type: ignore[return-value]  # two of them, which no generator says


def _size(vectors: pd.DataFrame, columns: Sequence[str]) -> Array:
    return np.asarray(np.linalg.norm(vectors[list(columns)].to_numpy(float), axis=1))


# --- the still ------------------------------------------------------------------------------------


def _draw(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw the cell in perspective, nearer bodies over those behind them."""
    view, rows = _view(tables), tables["scene"]
    axes = canvas.subplots()
    axes.set_axis_off()
    axes.set_aspect("equal")
    solid = rows[rows["part"].isin(_SOLID)]
    near, shapes = outlines(view, solid, np.maximum(_slim(solid), _LEAST_M))
    order = np.argsort(near, kind="stable")
    fill = np.where(solid["part"] == "base", GRID, BODY)[order].tolist()
    shapes = [shapes[k] for k in order]
    axes.add_collection(
        PolyCollection(shapes, facecolors=fill, edgecolors=EDGE, linewidths=0.4, zorder=1)
    )
    _points(axes, view, rows)
    moved, left = _magnified(tables)
    for columns, scale, colour in ((_MOVED, moved, BLUE), (_LEFT, left, RED)):
        _arrows(axes, view, tables["vectors"], columns, scale, colour)
    axes.autoscale_view()
    canvas.set_size_inches(_WIDE_IN, _height(axes))
    legend = _legend(answer, moved, left)
    handles = [Line2D([], [], color=colour, lw=1.6) for colour in (BLUE, RED)]
    axes.legend(handles, legend, loc="lower left", bbox_to_anchor=(0, 1), ncols=1, borderaxespad=0)
    return {}


def _height(axes: Any) -> float:
    """Height of the still without empty margins, including its legend [in]."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    return float(np.clip(0.45 + _WIDE_IN * (high - low) / (right - left), 1.8, 4.2))


def _legend(answer: Answer, moved: float, left: float) -> tuple[str, str]:
    first, second = _names(answer)
    return f"{first}, {moved:,.0f} times", f"{second}, {left:,.0f} times"


def _names(answer: Answer) -> tuple[str, str]:
    """Names of the two kinds of vectors."""
    return ("off the nominal robot" if answer.of_positions else "measured deflection", "residual")


def _slim(rows: pd.DataFrame) -> Array:
    """Radius as drawn [m]."""
    moves = rows["part"].isin(("arm", "tool")).to_numpy()
    return np.asarray(np.where(moves, _SLIM, 1.0) * rows["radius_m"].to_numpy(float))


def _points(axes: Any, view: View, rows: pd.DataFrame) -> None:
    """Draw nearby base reflectors as dots, and nearby instruments as triangles with names."""
    at = rows[FROM].to_numpy(float)
    near = rows[np.linalg.norm(at - view.middle, axis=1) < _BESIDE * view.size]
    x, y, _ = view(near[near["part"] == "reflector"][FROM].to_numpy(float))
    axes.scatter(x, y, s=10, color=INK, linewidths=0, zorder=2)
    for one in each_row(near[near["part"] == "tracker"]):
        x, y, _ = view(np.array([one.from_x_m, one.from_y_m, one.from_z_m]))
        axes.scatter(x, y, s=26, marker="^", color=INK, linewidths=0, zorder=2)
        axes.annotate(one.name, (x, y), (5, 3), textcoords="offset points", fontsize=8)


def _arrows(
    axes: Any, view: View, vectors: pd.DataFrame, columns: Sequence[str], scale: float, colour: str
) -> None:
    at = vectors[_AT].to_numpy(float)
    tip = at + scale * vectors[list(columns)].to_numpy(float)
    lines = [np.stack(view(end)[:2], axis=-1) for end in (at, tip)]
    axes.add_collection(
        LineCollection(list(np.stack(lines, axis=1)), colors=colour, linewidths=0.9, zorder=3)
    )
    axes.scatter(*lines[1].T, s=3, color=colour, linewidths=0, zorder=3)


# --- data of the picture that can be turned -------------------------------------------------------


def _live(answer: Answer, tables: Tables) -> dict[str, Any]:
    """Data of the picture for JSON, in metres and radians, with vectors not magnified."""
    rows, view, (moved, left) = tables["scene"], _view(tables), _magnified(tables)
    by_pose = dict(list(rows.groupby("pose")))
    vectors = dict(list(tables["vectors"].groupby("pose")))
    return {
        "view": {
            "beside": _BESIDE * view.size,
            "yaw": view.yaw,
            "pitch": float(PITCH),
            "middle": _numbers(view.middle),
            "size": view.size,
        },
        "magnify": {"moved": moved, "left": left},
        "names": _names(answer),
        "still": _parts(by_pose.get(0, rows.iloc[:0])),
        "poses": [
            {
                "pose": one.pose,
                "label": one.label,
                "says": _pose_line(one, vectors.get(one.pose, tables["vectors"].iloc[:0]), answer),
                "parts": _parts(by_pose.get(one.pose, rows.iloc[:0])),
                "points": _reflectors(vectors.get(one.pose, tables["vectors"].iloc[:0])),
            }
            for one in each_row(tables["poses"])
        ],
    }


def _parts(rows: pd.DataFrame) -> list[list[Any]]:
    """Part, name, both ends [m] and radius [m] of each capsule; the radius of points is 0."""
    numbers = rows.assign(slim=_slim(rows))[[*FROM, *TO, "slim"]].to_numpy(float)
    words = rows[["part", "name"]].to_numpy(object)
    return [[*word, *_numbers(row)] for word, row in zip(words, numbers, strict=True)]


def _reflectors(vectors: pd.DataFrame) -> list[list[Any]]:
    """Name, position, displacement, residual [m] and covariance [m²] of each reflector, in F_b."""
    numbers = vectors[[*_AT, *_MOVED, *_LEFT, *_COV]].to_numpy(float)
    names = vectors["target"].to_numpy(object)
    return [[str(name), *_numbers(row)] for name, row in zip(names, numbers, strict=True)]


def _numbers(values: Array) -> list[float | None]:
    """Values rounded to five significant digits; None for those that are not finite."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def _pose_line(pose: Any, vectors: pd.DataFrame, answer: Answer) -> str:
    """A pose in one line: its files, its pulls, its largest deflection and residual."""
    known_of_it = "; ".join(part for part in (_source(pose), _pulls(pose)) if part)
    return typeset(f"{pose.label}: {known_of_it}. {_did(vectors, answer)}")


def _source(pose: Any) -> str:
    """Files and lines of a pose's readings and joint values."""
    places = dict.fromkeys((readings_of(pose), joints_of(pose)))
    return ", ".join(place for place in places if place)


def readings_of(pose: Any) -> str:
    """File and lines of the readings; empty if only displacements are known."""
    return f"{pose.file} {_lines(pose.first_line, pose.last_line)}".strip() if pose.file else ""


def joints_of(pose: Any) -> str:
    """File and line of the joint values."""
    return f"{pose.joints_file} {_lines(pose.joints_line, None)}".strip()


def _lines(first: object, last: object) -> str:
    if not known(first):
        return ""
    several = known(last) and last != first
    return f"lines {int(first)}–{int(str(last))}" if several else f"line {int(first)}"


def _pulls(pose: Any) -> str:
    if not pose.pulls:
        return ""
    count = f"{pose.pulls} pulls up to" if pose.pulls > 1 else "1 pull of"
    return f"{count} {plain(pose.force_n)} N"


def _did(vectors: pd.DataFrame, answer: Answer) -> str:
    if vectors.empty:
        return "No reflector was read."
    words = (
        ("Largest deviation from the nominal robot", "from the identified one")
        if answer.of_positions
        else ("Largest deflection", "largest residual")
    )
    parts = [_largest(vectors, columns) for columns in (_MOVED, _LEFT)]
    texts = [f"{name} {plain(mm)} mm at {at}" for name, (at, mm) in zip(words, parts, strict=True)]
    return f"{', '.join(texts)}."


def _largest(vectors: pd.DataFrame, columns: Sequence[str]) -> tuple[str, float]:
    """Reflector with the largest vector, and its length [mm]."""
    size = _size(vectors, columns)
    return str(vectors["target"].iloc[int(size.argmax())]), MM * float(size.max())


def largest(tables: Tables) -> dict[int, tuple[float, float]]:
    """Largest deflection and largest residual of each pose [mm], by number of the pose."""
    vectors = tables["vectors"]
    sizes = {k: MM * _size(vectors, columns) for k, columns in enumerate((_MOVED, _LEFT))}
    most = pd.DataFrame(sizes).groupby(vectors["pose"].to_numpy()).max()
    return {int(pose): (moved, left) for pose, moved, left in most.itertuples()}


# --- texts ----------------------------------------------------------------------------------------


def _write(answer: Answer, tables: Tables) -> Figure:
    moved, left = _magnified(tables)
    poses, vectors = tables["poses"], tables["vectors"]
    at = vectors.iloc[int(_size(vectors, _LEFT).argmax())]
    label = poses.set_index("pose").loc[at["pose"], "label"]
    first = _names(answer)[0]
    text = (
        f"{len(poses)} poses{_of_all(poses)}. Blue: {first}, {moved:,.0f} times magnified; "
        f"orange: residual, {left:,.0f} times. The longest residual vector is "
        f"{plain(MM * _size(vectors, _LEFT).max())} mm, at {at['target']} in "
        f"{label[0].lower()}{label[1:]}."
    )
    return Figure(
        "scene",
        "The cell and its measured poses",
        f"{text} Residuals that all point one way{_along(answer)} indicate an effect that the "
        "model does not have.",
        f"Picture of the cell in perspective: robot, reflectors and vectors. {text} The table "
        "below has the same, pose by pose.",
    )


def _along(answer: Answer) -> str:
    """A further pattern of residuals that noise does not have, for a robot on a rail."""
    rail = any(joint.joint_type is JointType.PRISMATIC for joint in answer.stiffness)
    return ", or turn along the rail," if rail else ""


def _of_all(poses: pd.DataFrame) -> str:
    """How the poses were selected, if not all are drawn."""
    return (
        ""
        if len(poses) < MOST_POSES
        else ", those with the largest residuals and an even selection"
    )


SCENE = Plot("scene", ("scene", "poses", "vectors"), _write, _draw, _live)
