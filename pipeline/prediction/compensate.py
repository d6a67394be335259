"""Offsets that put a loaded robot where its unloaded model would be, along a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.configuration import velocity
from pipeline.prediction.model import Model
from pipeline.readers import logs

_ARM_M = 0.3
"""Turning the tool by an angle counts as moving a point this far from its tip."""

_SINGULAR = 1e-5
"""Directions in which the joints move the tool this much less than in the best one are left."""


@dataclass(frozen=True, eq=False)
class Path(Locked):
    """A path to be corrected.

    Attributes:
        pose: Number of each point, shape (m,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot at the tip [N], F_b, shape (m, 3).
        controller: The file has the controller's axes instead of the model's joints.
    """

    pose: Ints
    q: Array
    force: Array
    controller: bool


@dataclass(frozen=True, eq=False)
class Compensation(Locked):
    """What to add to each point of a path.

    Attributes:
        joints: Joint offsets [m] or [rad], shape (m, n).
        shift: Cartesian offset of the tip [m], F_b, shape (m, 3).
        turn: Cartesian offset of the tool's orientation as rotation vector [rad], F_b, (m, 3).
        deflection: How far the load moves the tip without offsets [m], shape (m,).
        left: What the joint offsets leave of it by the model itself [m], shape (m,).
        std: Standard uncertainty of the predicted deflection per axis [m], F_b, shape (m, 3).
    """

    joints: Array
    shift: Array
    turn: Array
    deflection: Array
    left: Array
    std: Array

    @property
    def summary(self) -> str:
        """How far the tip is off before and after, in one sentence."""
        lost = int(np.sum(~np.isfinite(self.std).all(axis=1)))
        known = f"known to ±{2e3 * self.std.max():.3f} mm (95 %)"
        if lost:
            known = f"but at {lost} of them a stiffness acts that the campaign did not determine"
        return (
            f"{len(self.left)} points: the load moves the tip by up to "
            f"{1e3 * self.deflection.max():.3f} mm; with the offsets the model leaves "
            f"{1e3 * self.left.max():.4f} mm, {known}."
        )


def read(name: str, data: bytes, robot: Robot) -> Path:
    """A path: pose, the columns of joints.csv, and fx_n, fy_n, fz_n in F_b.

    Raises:
        InputError: Any row or column is not as it should be: a path with a hole is no path.
    """
    log = logs.joints(name, data, robot)
    force = logs.table(name, data, [logs.POSE, *(logs.Quantity(a, logs.FORCE) for a in _FORCES)])
    for _, line, reason in (*log.rejected, *force.rejected):
        thing, _, way_out = reason.partition("; ")
        raise InputError(thing, way_out or "correct the row", file=name, line=line)
    if not len(log.line):
        raise InputError("has no points", "write one row per point of the path", file=name)
    own = {f"{joint.name}_{unit}" for joint in robot.joints for unit in ("m", "mm", "deg", "rad")}
    return Path(
        pose=log.number["pose"].astype(np.int64),
        q=logs.joint_values(log, robot),
        force=np.column_stack([force.number[axis] for axis in _FORCES]),
        controller=not own & set(logs.columns(name, data)),
    )


_FORCES = ("fx", "fy", "fz")


def compensate(model: Model, path: Path, tip: Array | None = None, rounds: int = 4) -> Compensation:
    """Offsets that cancel the deflection of the tip, in joint values and in the base frame.

    Among all joint offsets that do it, the ones taken cost the least energy in the joints'
    springs: with joint springs alone, each joint turns back by just what its spring gives way.

    Args:
        model: The identified model.
        path: Where and under which force.
        tip: The point that matters, where the force acts, in the flange frame [m]; the
            campaign's load point when not given.
        rounds: Newton steps; each gains about three digits.
    """
    tip = model.tool.load_point if tip is None else np.asarray(tip, float)
    points = tip + _ARM_M * np.vstack([np.zeros(3), np.eye(3)])
    before = model.positions(path.q, path.force, points)
    offset = np.zeros_like(path.q)
    for _ in range(rounds):
        missed = model.positions(path.q + offset, path.force, points).loaded - before.unloaded
        offset = offset - _least(model.robot, path.q + offset, points, missed)
    left = model.positions(path.q + offset, path.force, points).loaded - before.unloaded
    moved = before.displacement
    return Compensation(
        joints=offset,
        shift=-moved[:, 0],
        turn=-_turned(before.unloaded, moved),
        deflection=np.linalg.norm(moved[:, 0], axis=1),
        left=np.linalg.norm(left[:, 0], axis=1),
        std=model.predict(path.q, path.force, tip).std,
    )


def _least(robot: Robot, q: Array, points: Array, missed: Array) -> Array:
    """Joint motion (m, n) that moves the points by `missed`, least energy first."""
    configuration = configure(robot, q)
    J = velocity(configuration.twists, configuration.points(points))
    J = np.swapaxes(J, 2, 3).reshape(len(q), -1, robot.n)
    soft = np.sqrt(robot.nominal_compliance)
    inverse = linear.shortest(J * soft, _SINGULAR)
    return np.asarray(soft * np.einsum("mjk,mk->mj", inverse, missed.reshape(len(q), -1)))


def _turned(points: Array, moved: Array) -> Array:
    """Rotation vector (m, 3) of a small rigid motion: tip and three arms at right angles."""
    arms = points[:, 1:] - points[:, :1]
    return np.cross(arms, moved[:, 1:] - moved[:, :1]).sum(axis=1) / (2 * _ARM_M**2)


def table(robot: Robot, path: Path, found: Compensation) -> bytes:
    """The offsets as CSV: joint offsets in the units of joints.csv, the rest in mm and degrees."""
    names, slides, joints = _axes(robot, path, found.joints)
    head = [f"d_{name}_{'m' if s else 'deg'}" for name, s in zip(names, slides, strict=True)]
    head += [*(f"d{a}_mm" for a in "xyz"), *(f"r{a}_deg" for a in "xyz")]
    head += ["deflection_mm", "left_mm", *(f"std_{a}_mm" for a in "xyz")]
    body = np.column_stack(
        [
            np.where(slides, joints, np.rad2deg(joints)),
            1e3 * found.shift,
            np.rad2deg(found.turn),
            1e3 * found.deflection,
            1e3 * found.left,
            1e3 * found.std,
        ]
    )
    rows = pd.DataFrame(body, pd.Index(path.pose, name="pose"), head)
    return rows.to_csv(float_format="%.7f", na_rep="nan", lineterminator="\n").encode()


def _axes(robot: Robot, path: Path, joints: Array) -> tuple[list[str], Bools, Array]:
    """Names, which slide, and offsets, of the joints or of the axes the path was written in."""
    if not path.controller:
        return [joint.name for joint in robot.joints], robot.prismatic, joints
    slides = robot.prismatic.astype(float) @ np.abs(robot.controller_matrix) > 0
    return list(robot.controller), slides, joints @ linear.shortest(robot.controller_matrix).T
