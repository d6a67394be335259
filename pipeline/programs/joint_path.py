"""A path of joint values: a table with forces in, offsets out."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.library.compensate import Compensation
from pipeline.machine.robot import Robot, axes, configure
from pipeline.prediction.path import Path
from pipeline.readers import logs


def read(name: str, data: bytes, robot: Robot, constant: Array | None = None) -> Path:
    """Read a path: pose, the columns of joints.csv, and fx_n, fy_n, fz_n in F_b.

    Args:
        name: Name of the file.
        data: Content of the file.
        robot: Robot that runs the path.
        constant: Force at every point [N], shape (3,); if None, from columns of the file.

    Raises:
        InputError: A row or column is invalid; a path must be complete.
    """
    log = whole(logs.joints(name, data, robot, section=None))
    own = {f"{joint.name}_{unit}" for joint in robot.joints for unit in ("m", "mm", "deg", "rad")}
    return Path(
        pose=log.number["pose"].astype(np.int64),
        q=logs.joint_values(log, robot),
        force=forces(name, data, len(log.line), constant),
        controller=not own & set(logs.columns(name, data)),
        file=name,
        line=tuple(log.line.tolist()),
    )


def whole(log: logs.Log) -> logs.Log:
    """The log itself if it is complete.

    Raises:
        InputError: A row cannot be read, or there is none.
    """
    for file, line, reason in log.rejected:
        thing, _, way_out = reason.partition("; ")
        raise InputError(thing, way_out or "correct the row", file=file, line=line)
    if not len(log.line):
        raise InputError("has no points", "write one row per point of the path", file=log.file)
    return log


FORCES = tuple(logs.Quantity(axis, logs.FORCE) for axis in ("fx", "fy", "fz"))


def forces(name: str, data: bytes, count: int, constant: Array | None) -> Array:
    """Forces at the points of a path [N], shape (m, 3): from its columns, or the same for all.

    Raises:
        InputError: There are none, or both are given.
    """
    if constant is None:
        force = whole(logs.table(name, data, [logs.POSE, *FORCES]))
        return np.column_stack([force.number[axis.stem] for axis in FORCES])
    if any(title.startswith(("fx_", "fy_", "fz_")) for title in logs.columns(name, data)):
        raise InputError("has forces of its own", "leave --force away", file=name)
    return np.tile(constant, (count, 1))


def in_base(robot: Robot, q: Array, tool: Array, force: Array) -> Array:
    """Forces in F_b [N], shape (m, 3), from forces in tool frames.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        tool: Tools in the flange frame, shape (m, 4, 4) or (4, 4).
        force: Forces in the tool frames [N], shape (m, 3).
    """
    turned = configure(robot, q).flange_axes @ tool[..., :3, :3]
    return np.asarray(np.einsum("mij,mj->mi", turned, force))


def table(robot: Robot, path: Path, found: Compensation) -> bytes:
    """Offsets as CSV: of joints in m and degrees, all others in mm and degrees."""
    head, body = columns(axes.of(robot) if path.controller else axes.joints(robot), found)
    rows = pd.DataFrame(body, pd.Index(path.pose, name="pose"), head)
    return rows.to_csv(float_format="%.7f", na_rep="nan", lineterminator="\n").encode()


def columns(of: axes.Axes, found: Compensation) -> tuple[list[str], Array]:
    """Titles and columns of offsets: of these axes in m and degrees, others in mm and degrees."""
    joints = of.moved(found.joints)
    head = [f"d_{name}_{'m' if s else 'deg'}" for name, s in zip(of.names, of.slides, strict=True)]
    head += [*(f"d{a}_mm" for a in "xyz"), *(f"r{a}_deg" for a in "xyz")]
    head += ["deflection_mm", "left_mm", *(f"std_{a}_mm" for a in "xyz")]
    body = [
        np.where(of.slides, joints, np.rad2deg(joints)),
        1e3 * found.shift,
        np.rad2deg(found.turn),
        1e3 * found.deflection,
        1e3 * found.left,
        1e3 * found.std,
    ]
    return head, np.column_stack(body)
