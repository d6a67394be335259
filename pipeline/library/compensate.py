"""Offsets that move a loaded robot to the positions of its unloaded model, along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, compared
from pipeline.base.quantities import plain
from pipeline.library import holds
from pipeline.library.each_way import BothStiffnesses, along, each_way
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.configuration import velocity
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import ARM_M, Path

_FURTHEST = holds.TWIST_RAD
"""Maximum joint rotation for a correction [rad]; tool motions that need more are left uncorrected,
as the arm is near a singularity."""

_ROUNDING = 1e-9
"""Singular value relative to the largest that is treated as zero [1]."""


@dataclass(frozen=True, eq=False)
class Compensation(Locked):
    """Offsets to be added to each point of a path.

    Attributes:
        joints: Joint offsets [m] or [rad], shape (m, n).
        shift: Cartesian offset of the tip [m], F_b, shape (m, 3).
        turn: Cartesian offset of the tool's orientation as rotation vector [rad], F_b, (m, 3).
        deflection: Displacement of the tip by the load without offsets [m], shape (m,).
        left: Residual displacement with the joint offsets, according to the model [m], shape (m,).
        std: Standard uncertainty of the predicted deflection per axis [m], F_b, shape (m, 3).
        held_out: Held-out error of the model, rms per axis [m]; None if the campaign does not state
            it.
        force: Magnitude of the forces [N], shape (m,).
        pulled: Smallest and largest pull from which the model was estimated [N]; None if not
            stated.
        each_way: Joints whose stiffness depends on the sign of the torque, at these points.
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
    each_way: tuple[BothStiffnesses, ...] = ()

    def part(self, rows: Sequence[int] | Ints) -> Compensation:
        """Compensation of some of the points, in this order."""
        of_each = {one.name: getattr(self, one.name) for one in fields(self)}
        picked = {k: v[rows] for k, v in of_each.items() if isinstance(v, np.ndarray)}
        return Compensation(**of_each | picked)

    @classmethod
    def joined(cls, parts: Sequence[Compensation]) -> Compensation:
        """Concatenate several paths of one model."""
        of_each = {one.name: [getattr(part, one.name) for part in parts] for one in fields(cls)}
        joined = {k: np.concatenate(v) for k, v in of_each.items() if isinstance(v[0], np.ndarray)}
        ways = along(of_each["each_way"])
        return cls(**{k: v[0] for k, v in of_each.items()} | joined | {"each_way": ways})

    @property
    def summary(self) -> str:
        """Displacement of the tip before and after, in one sentence."""
        return (
            f"{len(self.left)} points: the load moves the tip by up to "
            f"{1e3 * self.deflection.max():.3f} mm; with the offsets the model leaves "
            f"{1e3 * self.left.max():.4f} mm, {self._known}."
        )

    @property
    def remarks(self) -> list[str]:
        """Summary, and comparison of the forces with the range of the pulls."""
        ways = [one.sentence for one in self.each_way]
        return [self.summary, *ways, *against_pulls(self.force, self.pulled)]

    @property
    def _known(self) -> str:
        """Uncertainty in words: as stated by the model, and from held-out poses."""
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


def compensate(
    model: IdentifiedModel,
    path: Path,
    tip: Array | None = None,
    held: Bools | None = None,
    rounds: int = 4,
) -> Compensation:
    """Offsets that cancel the deflection of the tip, in joint values and in the base frame.

    Among all joint offsets that do so, those with the least elastic energy in the joints' springs
    are chosen: with joint springs alone, each joint turns back by exactly the deflection of its
    spring.

    Args:
        model: The identified model.
        path: Poses and forces.
        tip: Point to be corrected, at which the force acts, in the flange frame [m]; the campaign's
            load point when not given.
        held: Joints that are not corrected, shape (n,); none when not given.
        rounds: Number of Newton steps; each gains about three digits.
    """
    tip = model.tool.load_point if tip is None else np.asarray(tip, float)
    points = tip + ARM_M * np.vstack([np.zeros(3), np.eye(3)])
    holds.refuse_unheld(model.robot, path.q, path.force, tip, path.file, path.line)
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


def _least(robot: Robot, q: Array, points: Array, missed: Array, soft: Array) -> Array:
    """Joint motion (m, n) of least elastic energy that moves the points by `missed`.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        points: Points in the flange frame [m], shape (t, 3).
        missed: Motion of the points [m], F_b, shape (m, t, 3).
        soft: Square roots of the compliances, 0 for a joint that is held, shape (n,).
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
    """Rotation vector (m, 3) of a small rigid motion of the tip and three orthogonal arms."""
    arms = points[:, 1:] - points[:, :1]
    return np.cross(arms, moved[:, 1:] - moved[:, :1]).sum(axis=1) / (2 * ARM_M**2)


def against_pulls(force_n: Array, pulled: tuple[float, float] | None) -> list[str]:
    """Warning if forces [N], shape (m,), are outside the range of the pulls, as a list.

    A model is valid where it was tested: above the largest pull its error grows with the force. If
    all forces are below the smallest pull by the ratio of two units, they may be in another unit.
    """
    if pulled is None:
        return []
    hardest, lowest, highest = compared([force_n.max(), pulled[0] / _LBF_N, pulled[1]])
    if lowest < hardest <= highest:
        return []
    least, most, reached = (plain(one) for one in (*pulled, hardest))
    text = f"The forces reach {reached} N; the campaign pulled with {least} to {most} N"
    if hardest < pulled[0]:
        return [f"{text}: check their unit."]
    return [f"{text}: beyond that its model was not tested, and its error grows with the force."]


_LBF_N = 4.4482
"""A pound-force [N] (NIST SP 811): the smallest ratio between two units of force."""
