"""A path of poses instead of joint values: a table in, one with corrected coordinates out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.library.compensate import Compensation
from pipeline.machine.robot import Robot, axes
from pipeline.programs.joint_path import columns, forces, whole
from pipeline.programs.notation import Form, Notation
from pipeline.programs.program import Number, Target
from pipeline.readers import logs
from pipeline.readers.logs import Quantity

_XYZ = tuple(Quantity(axis, logs.LENGTH) for axis in "xyz")
_TURNS: dict[Form, tuple[Quantity, ...]] = {
    "quaternion": tuple(Quantity(f"q{axis}", {}) for axis in "wxyz"),
    "abc": tuple(Quantity(axis, logs.ANGLE) for axis in "ABC"),
    "wpr": tuple(Quantity(axis, logs.ANGLE) for axis in "WPR"),
}


@dataclass(frozen=True, eq=False)
class _Poses(Locked):
    """A path of poses.

    Attributes:
        pose: Number of each point, shape (m,).
        targets: The points; their numbers are in m and rad and have no place in a text.
        notation: Notation of these numbers.
        force: Force on the robot at the tip [N], shape (m, 3).
        titles: Titles of the columns with coordinates.
        units: Their units in m, rad or 1, shape (6,) or (7,).
    """

    pose: Ints
    targets: tuple[Target, ...]
    notation: Notation
    force: Array
    titles: tuple[str, ...]
    units: Array


def form(name: str, data: bytes) -> Form | None:
    """Notation of the orientations of a path; None if it has only joint values."""
    titles = logs.columns(name, data)
    if not all(_title(titles, one) for one in _XYZ):
        return None
    for one, turn in _TURNS.items():
        if all(_title(titles, each) for each in turn):
            return one
    raise InputError(
        "has places without orientation",
        "add the columns qw,qx,qy,qz or A_deg,B_deg,C_deg or W_deg,P_deg,R_deg",
        file=name,
    )


def _title(titles: Sequence[str], q: Quantity) -> str | None:
    """The column of a quantity; None if there is none."""
    names = [f"{q.stem}_{unit}".lower() for unit in q.units] or [q.stem.lower()]
    return next((title for title in titles if title in names), None)


def read(
    name: str, data: bytes, robot: Robot, letters: Form, constant: Array | None = None
) -> _Poses:
    """Read a path of poses: pose, x, y, z, an orientation, and the rail if the robot has one.

    Additional joint values determine the arm configuration.

    Args:
        name: Name of the file.
        data: Content of the file.
        robot: Robot that runs the path.
        letters: Notation of orientations.
        constant: Force at every point [N], shape (3,); if None, from columns of the file.

    Raises:
        InputError: A row or column is invalid; a path must be complete.
    """
    titles = logs.columns(name, data)
    named, known = _axes(titles, robot)
    beside = [
        q for q, slides in zip(_quantities(named), named.slides, strict=True) if known or slides
    ]
    coordinates = [*_XYZ, *_TURNS[letters]]
    log = whole(logs.table(name, data, [logs.POSE, *coordinates, *beside]))
    found = [_title(titles, q) or q.stem for q in coordinates]
    units = [_unit(q, title) for q, title in zip(coordinates, found, strict=True)]
    return _Poses(
        log.number["pose"].astype(np.int64),
        _targets(log, coordinates, named, axes.of(robot), known),
        Notation(letters, 1.0, 1.0),
        forces(name, data, len(log.line), constant),
        tuple(found),
        np.array(units),
    )


def _axes(titles: Sequence[str], robot: Robot) -> tuple[axes.Axes, bool]:
    """Axes (controller's or joints) that all have columns, and True; else those of the rail."""
    kinds = axes.of(robot), axes.joints(robot)
    for one in kinds:
        if all(_title(titles, q) for q in _quantities(one)):
            return one, True
    return next((one for one in kinds if _has_rail(titles, one)), kinds[0]), False


def _unit(q: Quantity, title: str) -> float:
    """The unit in the title of a column [SI]."""
    return q.units[title.rpartition("_")[2]] if q.units else 1.0


def _targets(
    log: logs.Log, coordinates: Sequence[Quantity], named: axes.Axes, of: axes.Axes, known: bool
) -> tuple[Target, ...]:
    """The rows as targets.

    Args:
        log: The table.
        coordinates: Its columns that form a pose.
        named: Axes that may have columns in it.
        of: Axes of the controller.
        known: Whether all axes have columns.
    """
    none = np.zeros(len(log.line))
    given = np.column_stack([log.number.get(q.stem, none) for q in _quantities(named)])
    near = of.values(named.joints(given))
    values = np.column_stack([log.number[q.stem] for q in coordinates])
    return tuple(
        Target(
            f"pose {int(log.number['pose'][k])}",
            log.file,
            int(log.line[k]),
            "cartesian",
            tuple(Number(0, 0, float(value)) for value in values[k]),
            tuple(1e3 * near[k, of.slides]),
            near=tuple(near[k, ~of.slides]) if known else (),
        )
        for k in range(len(values))
    )


def _quantities(of: axes.Axes) -> list[Quantity]:
    both = zip(of.names, of.slides, strict=True)
    return [Quantity(name, logs.LENGTH if slides else logs.ANGLE) for name, slides in both]


def _has_rail(titles: Sequence[str], of: axes.Axes) -> bool:
    both = zip(_quantities(of), of.slides, strict=True)
    return all(_title(titles, q) for q, slides in both if slides)


def table(robot: Robot, path: _Poses, values: Sequence[Array], found: Compensation) -> bytes:
    """The corrected coordinates under the titles of the path, followed by the offsets."""
    head, body = columns(axes.joints(robot), found)
    coordinates = np.array(values) / path.units
    rows = pd.DataFrame(
        np.hstack([coordinates, body]), pd.Index(path.pose, name="pose"), [*path.titles, *head]
    )
    return rows.to_csv(float_format="%.7f", na_rep="nan", lineterminator="\n").encode()
