"""Offsets that put a loaded robot where its unloaded model would be, along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.base.quantities import plain
from pipeline.machine.robot import Robot, axes, configure, rating
from pipeline.machine.robot.configuration import velocity
from pipeline.machine.robot.inverse import ARM_M
from pipeline.prediction.each_way import Ways, along, each_way
from pipeline.prediction.model import Model
from pipeline.readers import logs

_FURTHEST = rating.TWIST_RAD
"""A motion of the tool for which joints would have to turn further is left: the arm is at a
singularity."""

_ROUNDING = 1e-9
"""Motion of the tool in a direction, over that in the best one, that is rounding [1]."""


@dataclass(frozen=True, eq=False)
class Path(Locked):
    """A path to be corrected.

    Attributes:
        pose: Number of each point, shape (m,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot at the tip [N], F_b, shape (m, 3).
        controller: The file has the controller's axes instead of the model's joints.
        file: Its name.
        line: Of each point in it; none where they stand in no line.
    """

    pose: Ints
    q: Array
    force: Array
    controller: bool
    file: str = ""
    line: tuple[int, ...] = ()


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
        held_out: By how much the model missed poses that were left out, rms per axis [m]; None
            where the campaign does not say.
        force: Size of the forces [N], shape (m,).
        pulled: The gentlest and the hardest pull that the model is from [N]; None where it does
            not say.
        each_way: Joints with another stiffness each way of their torque, at these points.
    """

    joints: Array
    shift: Array
    turn: Array
    deflection: Array
    left: Array
    std: Array
    force: Array
    held_out: float | None = None
    pulled: tuple[float, float] | None = None
    each_way: tuple[Ways, ...] = ()

    def part(self, rows: Sequence[int] | Ints) -> Compensation:
        """That of some of the points, in this order."""
        of_each = {one.name: getattr(self, one.name) for one in fields(self)}
        picked = {k: v[rows] for k, v in of_each.items() if isinstance(v, np.ndarray)}
        return Compensation(**of_each | picked)

    @classmethod
    def joined(cls, parts: Sequence[Compensation]) -> Compensation:
        """Several paths of one model, one behind the other."""
        of_each = {one.name: [getattr(part, one.name) for part in parts] for one in fields(cls)}
        joined = {k: np.concatenate(v) for k, v in of_each.items() if isinstance(v[0], np.ndarray)}
        ways = along(of_each["each_way"])
        return cls(**{k: v[0] for k, v in of_each.items()} | joined | {"each_way": ways})

    @property
    def summary(self) -> str:
        """How far the tip is off before and after, in one sentence."""
        return (
            f"{len(self.left)} points: the load moves the tip by up to "
            f"{1e3 * self.deflection.max():.3f} mm; with the offsets the model leaves "
            f"{1e3 * self.left.max():.4f} mm, {self._known}."
        )

    @property
    def remarks(self) -> list[str]:
        """The summary, and how the forces compare with those that the model is from."""
        ways = [one.sentence for one in self.each_way]
        return [self.summary, *ways, *beside_pulls(self.force, self.pulled)]

    @property
    def _known(self) -> str:
        """How well that is known: by the model's own word, and by what left-out poses showed."""
        lost = int(np.sum(~np.isfinite(self.std).all(axis=1)))
        if lost:
            return f"but at {lost} of them a stiffness acts that the campaign did not determine"
        known = f"known to ±{2e3 * self.std.max():.3f} mm per axis (95 %)"
        if self.held_out is None:
            return f"{known} by its own word alone: no pose was left out to test it"
        hardest = self.pulled[1] if self.pulled else np.inf
        least = self.held_out * np.maximum(1.0, self.force / hardest)
        count_on = 2e3 * np.maximum(self.std.max(axis=1), least).max()
        return (
            f"{known} by its own word; poses that were left out of its estimate were missed by "
            f"{1e3 * self.held_out:.3f} mm rms per coordinate, noise of the readings included: "
            f"count on ±{count_on:.3f} mm"
        )


def read(name: str, data: bytes, robot: Robot, constant: Array | None = None) -> Path:
    """A path: pose, the columns of joints.csv, and fx_n, fy_n, fz_n in F_b.

    Args:
        name: Name of the file.
        data: Its content.
        robot: Whose path it is.
        constant: The force of every point [N], shape (3,); columns of the file where not given.

    Raises:
        InputError: Any row or column is not as it should be: a path with a hole is no path.
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


def beside_pulls(force_n: Array, pulled: tuple[float, float] | None) -> list[str]:
    """A sentence where forces [N], shape (m,), are all gentler or some harder than any pull.

    A model is known where it was pulled: beyond the hardest pull its error grows with the force,
    and a path without a force as large as the gentlest pull may be in another unit.
    """
    if pulled is None or pulled[0] <= (hardest := float(force_n.max())) <= pulled[1]:
        return []
    least, most = (plain(one) for one in pulled)
    told = f"The forces reach {plain(hardest)} N; the campaign pulled with {least} to {most} N"
    if hardest < pulled[0]:
        return [f"{told}: check their unit."]
    return [f"{told}: beyond that its model was not tested, and its error grows with the force."]


def whole(log: logs.Log) -> logs.Log:
    """A log without a hole.

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
    """Forces of the points of a path [N], shape (m, 3): its columns, or one for all.

    Raises:
        InputError: It has none, or both are given.
    """
    if constant is None:
        force = whole(logs.table(name, data, [logs.POSE, *FORCES]))
        return np.column_stack([force.number[axis.stem] for axis in FORCES])
    if any(title.startswith(("fx_", "fy_", "fz_")) for title in logs.columns(name, data)):
        raise InputError("has forces of its own", "leave --force away", file=name)
    return np.tile(constant, (count, 1))


def compensate(
    model: Model,
    path: Path,
    tip: Array | None = None,
    held: Bools | None = None,
    rounds: int = 4,
) -> Compensation:
    """Offsets that cancel the deflection of the tip, in joint values and in the base frame.

    Among all joint offsets that do it, the ones taken cost the least energy in the joints'
    springs: with joint springs alone, each joint turns back by just what its spring gives way.

    Args:
        model: The identified model.
        path: Where and under which force.
        tip: The point that matters, where the force acts, in the flange frame [m]; the
            campaign's load point when not given.
        held: Joints that stay where they are, shape (n,); none where not given.
        rounds: Newton steps; each gains about three digits.
    """
    tip = model.tool.load_point if tip is None else np.asarray(tip, float)
    points = tip + ARM_M * np.vstack([np.zeros(3), np.eye(3)])
    rating.refuse_unheld(model.robot, path.q, path.force, tip, path.file, path.line)
    before = model.positions(path.q, path.force, points)
    offset = np.zeros_like(path.q)
    soft = np.sqrt(model.robot.nominal_compliance)
    soft = soft if held is None else np.where(held, 0.0, soft)
    for _ in range(rounds):
        missed = model.positions(path.q + offset, path.force, points).loaded - before.unloaded
        offset = offset - _least(model.robot, path.q + offset, points, missed, soft)
    left = model.positions(path.q + offset, path.force, points).loaded - before.unloaded
    moved = before.displacement
    return Compensation(
        joints=offset,
        shift=-moved[:, 0],
        turn=-_turned(before.unloaded, moved),
        deflection=np.linalg.norm(moved[:, 0], axis=1),
        left=np.linalg.norm(left[:, 0], axis=1),
        std=model.predict(path.q, path.force, tip).std,
        held_out=model.held_out_m,
        force=np.linalg.norm(path.force, axis=1),
        pulled=model.pulled_n,
        each_way=each_way(model, path.q, path.force),
    )


def in_base(robot: Robot, q: Array, tool: Array, force: Array) -> Array:
    """Forces [N], (m, 3), in F_b, from those in the frames of tools.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        tool: Tools in the flange frame, shape (m, 4, 4) or (4, 4).
        force: [N], shape (m, 3).
    """
    turned = configure(robot, q).flange_axes @ tool[..., :3, :3]
    return np.asarray(np.einsum("mij,mj->mi", turned, force))


def _least(robot: Robot, q: Array, points: Array, missed: Array, soft: Array) -> Array:
    """Joint motion (m, n) that moves the points by `missed`, least energy first.

    Args:
        robot: Whose joints they are.
        q: Where they are [m] or [rad], shape (m, n).
        points: In the flange frame [m], shape (t, 3).
        missed: Motion of the points [m], F_b, shape (m, t, 3).
        soft: Roots of the compliances, 0 for a joint that stays, shape (n,).
    """
    configuration = configure(robot, q)
    J = velocity(configuration.twists, configuration.points(points))
    J = np.swapaxes(J, 2, 3).reshape(len(q), -1, robot.n)
    U, s, Vt = linear.principal(J * soft)
    part = np.einsum("mki,mk->mi", U[..., : s.shape[1]], missed.reshape(len(q), -1))
    each = (
        soft[:, None] * np.swapaxes(Vt, 1, 2)[..., : s.shape[1]]
    )  # motion of each joint, (m, n, i)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = each * (part / s)[:, None, :]
    turned = np.abs(np.where(robot.prismatic[:, None], 0.0, each)).max(axis=1)
    good = (s > _ROUNDING * s[:, :1]) & (turned <= _FURTHEST)
    return np.asarray(np.where(good[:, None, :], each, 0.0).sum(axis=2))


def _turned(points: Array, moved: Array) -> Array:
    """Rotation vector (m, 3) of a small rigid motion: tip and three arms at right angles."""
    arms = points[:, 1:] - points[:, :1]
    return np.cross(arms, moved[:, 1:] - moved[:, :1]).sum(axis=1) / (2 * ARM_M**2)


def table(robot: Robot, path: Path, found: Compensation) -> bytes:
    """The offsets as CSV: joint offsets in the units of joints.csv, the rest in mm and degrees."""
    head, body = columns(axes.of(robot) if path.controller else axes.joints(robot), found)
    rows = pd.DataFrame(body, pd.Index(path.pose, name="pose"), head)
    return rows.to_csv(float_format="%.7f", na_rep="nan", lineterminator="\n").encode()


def columns(of: axes.Axes, found: Compensation) -> tuple[list[str], Array]:
    """Titles and columns of offsets: of these axes in m and degrees, the rest in mm and degrees."""
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
