"""Unloaded reflectors of a campaign of pulls: their positions by the table, and deviations from it.

To first order in all small quantities, a reflector of pose i deviates in F_b from its position by
the robot's table by

    s + w x p + R_i dl + sum_k L_ik x_k + Z_i G_i m + Z_i e_i + B_i b + noise

with s and w the position and rotation of F_b, dl the error of its point of the tool, x_k the errors
of the geometric parameters of the table with their unit twists L_ik, m the masses of the arm, whose
weight deflects the joints by G_i m, e_i an unmodelled error of each joint at each pose
(transmission, repeatability), and b unit errors of what absolute positions of the same robot tell
besides its table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.linear import rms
from pipeline.base.tails import chi2_beyond
from pipeline.geometry.arm_weight import carried_by, usual
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Geometry, Pulls
from pipeline.machine.known_robot import KnownRobot
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.dh_parameters import DhParameter, changed, dh_parameters, twists
from pipeline.machine.robot.weight import by_moments, carried, work
from pipeline.reduction.course import Course
from pipeline.reduction.idle import Idle
from pipeline.reduction.measured import STILL_M, Measured

START = {True: 5e-5, False: 1e-4}
"""Initial standard deviation of the unmodelled error of a sliding joint [m] and of a rotary
one [rad]."""

USUAL = (2e-4, 2e-4)
"""Standard deviation of lengths [m] and angles [rad] of a table as delivered, where the robot file
states none. Nubiola and Bonev (Robotics and Computer-Integrated Manufacturing 29, 2013) found 0.1
to 2 mm and mrad on one robot; a reflector then deviates by some 0.3 to 3 mm."""

_TOOL_M = 5e-3
"""Prior standard deviation of the tool's points as given [m]: the campaign measures them anew."""

_ANYWHERE_M = 10.0
"""Prior standard deviation of the position of F_b [m]: its base reflectors are not part of the
robot."""

_TOOL_ARM_M = 0.2
"""Distance of a tool's centre of mass from the flange [m]: what payload diagrams of medium and
heavy robots allow for at the rated payload."""

_UNMOVED_M = 1e-6
"""Rms motion of a reflector below which a combination of masses counts as none [m]: a tenth of the
best tracker's noise."""

FIXED_STD = 1e-8
"""Standard deviation of what is not estimated [m or rad]; for masses it is a thousand times as
large."""


@dataclass(frozen=True)
class MidChange:
    """A joint's zero that changed in mid-campaign, or a robot or target that was moved then.

    The log is right since, of a joint that was mastered anew, or before, of one that slipped; where
    F_b has the robot, and [tool] the target, was right before.

    Attributes:
        joint: From 1; 0 of the robot as a whole, which has three shifts [m] and three turns [rad],
            and of a target.
        before: Numbers of the poses before that.
        since: Number of the first pose after it.
        target: Index of the target, which has three shifts in the flange frame [m]; else None.
        slipped: Whether the joint's log is wrong since, and not before.
    """

    joint: int
    before: tuple[int, ...]
    since: int
    target: int | None = None
    slipped: bool = False

    @property
    def early(self) -> bool:
        """Whether the poses before it are off, and not those since."""
        return self.joint > 0 and not self.slipped

    @property
    def unknowns(self) -> int:
        """How many it has."""
        return 3 if self.target is not None else 1 if self.joint else 6

    def share(self, pulls: Pulls) -> Array:
        """What one unit of it adds to each pull, shape (m,)."""
        off = np.isin(pulls.pose, self.before) == self.early
        return -off.astype(float) if self.joint else off.astype(float)


@dataclass(frozen=True)
class _UnknownColumns:
    """Slices of the vector of unknowns.

    Attributes:
        shift: Position of F_b [m], relative to `Unloaded.place`.
        turn: Its rotation within the stated uncertainty of the registration, in units of that.
        tool: Three of each target [m].
        table: Geometric parameters.
        loose: Turn of F_b beyond what is stated, or of the rail in it [rad].
        masses: Of the arm, in units of their usual sizes.
        links: Mass and first moments of links that weigh, in principal axes of their effect.
        beside: Independent errors of what absolute positions tell of the robot besides its table,
            in standard deviations.
        changes: In mid-campaign [m] or [rad], one after the other.
    """

    shift: slice
    turn: slice
    tool: slice
    table: slice
    loose: slice
    masses: slice
    links: slice
    beside: slice
    changes: slice

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return int(self.changes.stop)


@dataclass(frozen=True, eq=False)
class Unloaded(Locked):
    """Unloaded positions as read by the tracker.

    Attributes:
        robot: Robot with its table as delivered.
        tool: Tool with its points as given.
        sag: Effect of the arm's own weight on the joints of a robot with the identified
            stiffnesses, or None.
        pulls: One for each zero, shape (z,).
        pose: Pose of each zero, 0..p-1, shape (z,).
        target: Its target in the tool, shape (z,).
        at: Its position [m], F_b, shape (z, 3).
        cov: Covariance of its position [m^2], shape (z, 3, 3).
        rotation: Factor of the covariance of the registration's rotation [rad], shape (3, 3).
        joint_std: Standard uncertainty of the joints' zeros as stated [m] or [rad], shape (n,).
        tool_std: Standard uncertainty of points of the tool as stated [m], 0 where not stated.
        place: Approximate position of F_b by the table [m], shape (3,): with metres in the unknowns
            the likelihoods, which are differences of squares, would lose digits.
        misshapen: Poses without a pull that are left out: their targets are not where a rigid
            effector has them, so that one of the readings is spoilt.
        turned: Covariance of the rotation of each pose at the radius of the targets [m^2], shape
            (p, 3, 3), where all targets of a pose were computed from one 6D pose, in place of which
            its position, of covariance `cov`, and its rotation are read; else None.
        changes: What may have changed in mid-campaign.
        weighs: Whether all links weigh, so that lengths and joint zeros do not have to take what
            their weight does; then there is no `sag` by two of them.
        beside: Motion of each reading by each of those errors [m], shape (z, 3, r): of a crooked
            rail for instance, where poses near each other err alike.
    """

    robot: Robot
    tool: Tool
    sag: Geometry | None
    pulls: Pulls
    pose: Ints
    target: Ints
    at: Array
    cov: Array
    rotation: Array
    joint_std: Array
    tool_std: float = 0.0
    place: Array = field(default_factory=lambda: np.zeros(3))
    misshapen: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    turned: Array | None = None
    changes: tuple[MidChange, ...] = ()
    weighs: bool = False
    beside: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @cached_property
    def letters(self) -> tuple[DhParameter, ...]:
        """Geometric parameters with distinct effects on a reflector."""
        return dh_parameters(self.robot)

    @cached_property
    def turns(self) -> Bools:
        """Which of them are angles, shape (k,)."""
        return np.array([letter.turns for letter in self.letters], dtype=bool)

    @cached_property
    def columns(self) -> _UnknownColumns:
        """Layout of the unknowns."""
        masses = len(self.sag.parameters) if self.sag else 0
        changes = sum(one.unknowns for one in self.changes)
        more, tool = self.beside.shape[2], 3 * len(self.tool.points)
        links = self._principal.shape[1]
        sizes = (3, 3, tool, len(self.letters), 3, masses, links, more, changes)
        ends = np.cumsum([0, *sizes]).tolist()
        return _UnknownColumns(*(slice(a, b) for a, b in pairwise(ends)))

    @property
    def changed(self) -> Iterator[tuple[MidChange, slice]]:
        """Each change with its unknowns."""
        ends = np.cumsum([self.columns.changes.start, *(one.unknowns for one in self.changes)])
        for one, (a, b) in zip(self.changes, pairwise(ends.tolist()), strict=True):
            yield one, slice(a, b)

    @property
    def poses(self) -> int:
        """Number of poses p."""
        return int(self.pose.max()) + 1

    @property
    def read(self) -> Ints:
        """Pose of each point that is read, or of each position and rotation; shape (v,)."""
        return self.pose if self.turned is None else np.repeat(np.arange(self.poses), 2)

    @property
    def dof(self) -> int:
        """Degrees of freedom if only position and tool are estimated."""
        tool = 6 if self.turned is not None else 3 * len(self.tool.points)
        return 3 * len(self.read) - 3 - tool

    def usual(self) -> Array:
        """Standard deviation of each geometric parameter as delivered and stated, shape (k,)."""
        stated = self.robot.roughness
        length, angle = (u if np.isnan(s) else s for u, s in zip(USUAL, stated, strict=True))
        return np.hypot(np.where(self.turns, angle, length), self.stated)

    @cached_property
    def stated(self) -> Array:
        """Stated standard uncertainty of the joint zeros, for each geometric parameter, (k,)."""
        known = len(self.joint_std) == self.robot.n
        std = self.joint_std if known else np.zeros(self.robot.n)
        zero = [letter.name == "joint_offset" for letter in self.letters]
        return np.where(zero, std[[letter.joint - 1 for letter in self.letters]], 0.0)

    def held(self) -> Array:
        """Prior standard deviations if only position, stated rotation and tool are free, (K,)."""
        std, where = np.full(self.columns.count, FIXED_STD), self.columns
        std[where.shift] = _ANYWHERE_M
        std[where.turn], std[where.links], std[where.beside] = 1.0, 1.0, 1.0
        std[where.tool], std[where.masses] = max(_TOOL_M, self.tool_std), 1e3 * FIXED_STD
        return std

    def masses(self, x: Array) -> Array:
        """Masses of the arm [kg]."""
        if self.sag is None:
            return np.zeros(0)
        typical = np.array([parameter.typical for parameter in self.sag.parameters])
        return np.asarray(typical * x[self.columns.masses])

    def where_it_is(self, x: Array) -> tuple[Robot, Pulls]:
        """The robot with corrected table, and pulls with the joints deflected by the arm's weight.

        Args:
            x: The unknowns, shape (K,).
        """
        robot, pulls = changed(self.robot, self.letters, x[self.columns.table]), self.pulls
        if self.sag is not None:
            pulls = replace(pulls, q=self.sag.geometry(self.robot, pulls, self.masses(x)))
        return robot, self.as_changed(pulls, x)

    def as_changed(self, pulls: Pulls, x: Array) -> Pulls:
        """Pulls of this campaign at joint values after changes of their zeros and under the links.

        Args:
            pulls: Pulls with the joint values of the log, or those under the masses of `sag`.
            x: The unknowns, shape (K,).
        """
        q = pulls.q + self._bent(pulls.q) @ x[self.columns.links]
        for one, at in self.changed:
            if one.joint:
                q[:, one.joint - 1] += x[at] * one.share(pulls)
        return replace(pulls, q=q)

    @property
    def at_end(self) -> Array:
        """The table of the robot as it stands at the end, by the unknowns, shape (letters, K).

        A joint that slipped has another zero then; one without a zero in the table has not.
        """
        labels = [letter.label for letter in self.letters]
        out = np.zeros((len(labels), self.columns.count))
        out[:, self.columns.table] = np.eye(len(labels))
        for one, at in self.changed:
            label = f"joint_offset:{one.joint}"
            if one.slipped and label in labels:
                out[labels.index(label), at] = -1.0
        return out

    def base_turn(self, x: Array) -> Array:
        """Rotation of F_b relative to the base reflectors [rad], shape (3,)."""
        return np.asarray(self.rotation @ x[self.columns.turn] + x[self.columns.loose])

    def about(self, x: Array) -> PoseRows:
        """The readings linearised about some unknowns, absolute: y = D x if all is explained."""
        robot, pulls = self.where_it_is(x)
        here, where, z = configure(robot, pulls.q), self.columns, np.arange(len(self.target))
        points = (self.tool.points + x[where.tool].reshape(-1, 3))[self.target]
        p = here.flange_origin + np.einsum("zij,zj->zi", here.flange_axes, points)
        R = Rotation.from_rotvec(self.base_turn(x)).as_matrix()
        stands = p @ R.T + self.place + x[where.shift]
        D = np.zeros((len(z), 3, where.count))
        D[:, :, where.shift] = np.eye(3)
        cross = np.stack([np.cross(axis, p @ R.T) for axis in np.eye(3)], axis=2)
        D[:, :, where.turn], D[:, :, where.loose] = cross @ self.rotation, cross
        tool = np.zeros((len(z), 3, len(self.tool.points), 3))
        tool[z, :, self.target] = R @ here.flange_axes
        D[:, :, where.tool] = tool.reshape(len(z), 3, -1)
        Z = R @ reach(here.twists, p[:, None])[:, :3]
        D[:, :, where.table] = R @ reach(twists(here, self.letters), p[:, None])[:, :3]
        if self.sag is not None:
            D[:, :, where.masses] = Z @ self._sagging()
        D[:, :, where.links] = Z @ self._bent(self.pulls.q)
        if self.beside.size:
            D[:, :, where.beside] = self.beside
            stands += self.beside @ x[where.beside]
        whole = np.concatenate([D[:, :, where.shift], cross], axis=2)
        for change, at in self.changed:
            unit = Z[:, :, [change.joint - 1]] if change.joint else whole
            if change.target is not None:
                unit = tool[:, :, change.target]
            D[:, :, at] = unit * change.share(self.pulls)[:, None, None]
            stands += 0.0 if change.joint else D[:, :, at] @ x[at]
        y = self.at - stands + D @ x
        if self.turned is not None:
            y, D, Z = self._in_poses(y[..., None])[..., 0], self._in_poses(D), self._in_poses(Z)
        return _by_pose(self, y, D, Z)

    def _in_poses(self, moved: Array) -> Array:
        """Position and rotation of each pose from small motions of its targets, (v, 3, k)."""
        t = len(self.tool.points)
        here = configure(self.robot, self.pulls.q[::t])
        six = replace(self.tool, six=True).coordinates(here, moved.reshape(-1, t, *moved.shape[1:]))
        return np.asarray(six.reshape(-1, *moved.shape[1:]))

    @property
    def errors(self) -> Array:
        """Covariance of the readings [m^2], shape (v, 3, 3)."""
        if self.turned is None:
            return self.cov
        own = self.cov[:: len(self.tool.points)]
        return np.asarray(np.stack([own, self.turned], axis=1).reshape(-1, 3, 3))

    def _sagging(self) -> Array:
        """Deflection of the joints by each of the masses at its usual size, (z, n, masses)."""
        assert self.sag is not None
        typical = np.diag([parameter.typical for parameter in self.sag.parameters])
        each = [self.sag.geometry(self.robot, self.pulls, one) - self.pulls.q for one in typical]
        return np.stack(each, axis=2)

    def _by_links(self, q: Array) -> Array:
        """Deflection of the joints by mass and first moments of each link, of usual size.

        Those of each link are independent a priori and of the usual size (`yielding.usual`), on the
        last one also a tool as heavy as the rated payload. Shape (m, n, 4 n).
        """
        here, n = configure(self.robot, q), self.robot.n
        size = np.hypot(*usual(self.robot))
        size[-1] += (self.robot.payload_kg or 0.0) * np.array([1.0, *[_TOOL_ARM_M] * 3])
        unit = by_moments(here, self.robot.gravity)
        torques = carried_by(here.twists, np.arange(1, n + 1), unit) * size.ravel()
        return np.asarray(self.robot.nominal_compliance[:, None] * torques)

    @cached_property
    def _principal(self) -> Array:
        """Combinations of those masses and moments that the readings determine, shape (4 n, k).

        The right singular vectors of what they move the reflectors by, Z_i C T_i, of which those
        are kept that move one.
        """
        if not self.weighs:
            return np.zeros((4 * self.robot.n, 0))
        here = configure(self.robot, self.pulls.q)
        points = here.points(self.tool.points)[np.arange(len(self.target)), self.target]
        moved = reach(here.twists, points[:, None])[:, :3] @ self._by_links(self.pulls.q)
        flat = moved.reshape(-1, 4 * self.robot.n)
        square, directions = linear.directions(flat.T @ flat)
        return np.asarray(directions[:, square > _UNMOVED_M**2 * len(points)])

    def _bent(self, q: Array) -> Array:
        """Deflection of the joints by each of those combinations, shape (m, n, k)."""
        none = np.zeros((*q.shape, 0))
        return np.asarray(self._by_links(q) @ self._principal) if self.weighs else none

    def hangs(self, x: Array) -> bool:
        """Whether the usual weight does work in the estimated deflection, as gravity does."""
        here, none = configure(self.robot, self.pulls.q), np.zeros((len(self.pulls.q), 3))
        weight = carried(here, self.robot.gravity, usual(self.robot)[0], none[:, 0], none)
        bent = self._bent(self.pulls.q) @ x[self.columns.links]
        return bool(np.sum(work(here.twists, weight) * bent) > 0)

    def seen(self, x: Array) -> Array:
        """Residuals of the readings [m], without the joints' errors, shape (v, 3)."""
        rows = self.about(x)
        return np.asarray((rows.y - rows.D @ x)[rows.place])


@dataclass(frozen=True, eq=False)
class PoseRows(Locked):
    """Readings by pose; missing rows of a pose are zero.

    Attributes:
        y: Shape (p, r) [m].
        D: Derivatives by the unknowns, shape (p, r, K).
        Z: Derivatives by the joint values, shape (p, r, n).
        N: Covariance of the readings [m^2], 1 on the diagonal of missing rows, shape (p, r, r).
        place: Pose and rows of each point that is read: y[place] has shape (v, 3).
        slides: Which joints are prismatic, shape (n,).
    """

    y: Array
    D: Array
    Z: Array
    N: Array
    place: tuple[Ints, Ints]
    slides: Bools

    def cov(self, transmission: float) -> Array:
        """Covariance of the rows of each pose, shape (p, r, r).

        Args:
            transmission: Error of the joints at a pose over its usual size.
        """
        ZS = self.Z * (transmission * np.where(self.slides, START[True], START[False]))
        return np.asarray(self.N + ZS @ np.swapaxes(ZS, 1, 2))


def _by_pose(zeros: Unloaded, y: Array, D: Array, Z: Array) -> PoseRows:
    pose = zeros.read
    first = np.searchsorted(np.sort(pose), pose)
    order = np.argsort(pose, kind="stable")
    slot = np.empty(len(order), dtype=np.int64)
    slot[order] = np.arange(len(order)) - first[order]
    most, p = int(slot.max()) + 1, zeros.poses
    place = pose[:, None], 3 * slot[:, None] + np.arange(3)

    def rows(part: Array) -> Array:
        out = np.zeros((p, 3 * most, *part.shape[2:]))
        out[place] = part
        return out

    N = np.tile(np.eye(3 * most), (p, 1, 1))
    N[place[0][:, :, None], place[1][:, :, None], place[1][:, None, :]] = zeros.errors
    return PoseRows(rows(y), rows(D), rows(Z), N, place, zeros.robot.prismatic)


def unloaded(
    robot: Robot,
    tool: Tool,
    sag: Geometry | None,
    data: Measured,
    scale: float,
    grown: Course | None = None,
) -> Unloaded | None:
    """The unloaded positions; None where too few poses were read unloaded.

    Args:
        robot: Robot with its table as delivered.
        tool: Tool with its points as given.
        sag: Effect of the arm's own weight on its joints, or None.
        data: The measurements; `unloaded` may be NaN.
        scale: Scatter of the tracker over its stated standard uncertainty.
        grown: Growth of the base frame that the readings are corrected for, in F_b, if any.
    """
    _, first = np.unique(data.zero, return_index=True)
    first = first[np.isfinite(data.unloaded[first]).all(axis=1)]
    pulls, target = data.pulls.part(data.pull[first]), data.target[first]
    at, cov, misshapen = data.unloaded[first], data.zero_cov[first], np.zeros(0, np.int64)
    if data.idle is not None and data.idle.turned is not None:
        pulls, target, at, cov = data.idle.pulls, data.idle.target, data.idle.at, data.idle.cov
    elif data.idle is not None and len(first):
        misshapen = _misshapen(data.idle, _Shape.of(pulls.pose, target, at, cov), scale)
        more = np.flatnonzero(~np.isin(data.idle.pulls.pose, misshapen))
        pulls, target = (
            pulls.and_then(data.idle.pulls.part(more)),
            np.r_[target, data.idle.target[more]],
        )
        at, cov = np.r_[at, data.idle.at[more]], np.r_[cov, data.idle.cov[more]]
    poses, pose = np.unique(pulls.pose, return_inverse=True)
    if len(poses) < _FEWEST or not np.isfinite(scale):
        return None
    better = max(scale**2, STILL_M**2 / float(np.einsum("zii->", cov) / (3 * len(cov))))
    turned = data.idle.turned if data.idle is not None else None
    found = Unloaded(
        robot=robot,
        tool=tool,
        sag=sag,
        pulls=pulls,
        pose=pose.astype(np.int64),
        target=target,
        at=at,
        cov=cov * better,
        rotation=linear.factor(data.rotation_cov),
        joint_std=data.joint_std,
        tool_std=data.tool_std,
        misshapen=misshapen,
        turned=None if turned is None else turned * better,
        beside=np.concatenate(
            [
                _beside(data.stance, pulls.q, tool.targets[target]),
                _parting(grown, at, pulls.time_zero),
            ],
            axis=2,
        ),
    )
    off = found.seen(np.zeros(found.columns.count))
    return replace(found, place=(off if turned is None else off[::2]).mean(axis=0))


def _beside(known: KnownRobot | None, q: Array, names: Strings) -> Array:
    """Motions by errors of what positions tell besides the table, as `Unloaded.beside`."""
    return np.zeros((len(q), 3, 0)) if known is None else known.errors(q, names)


def _parting(grown: Course | None, at: Array, time: Array) -> Array:
    """Motions by the growth that readings are corrected for, if the robot does not share it."""
    return np.zeros((len(at), 3, 0)) if grown is None else grown.parting(at, time)


@dataclass(frozen=True, eq=False)
class _Shape(Locked):
    """Distances between targets of the effector.

    Attributes:
        mean: Mean over the poses with pulls [m], NaN where never read, shape (t, t).
        variance: Variance of the mean [m^2], shape (t, t).
    """

    mean: Array
    variance: Array

    @classmethod
    def of(cls, pose: Ints, target: Ints, at: Array, cov: Array) -> _Shape:
        """Distances from positions of targets in several poses."""
        t = int(target.max()) + 1
        total, variance, count = np.zeros((3, t, t))
        for one in np.unique(pose):
            mine = pose == one
            a, b, D, J = _distances(target[mine], at[mine])
            total[a, b] += D
            variance[a, b] += np.einsum("di,ij,dj->d", J, block_diag(*cov[mine]), J)
            count[a, b] += 1
        with np.errstate(invalid="ignore", divide="ignore"):
            return cls(total / count, variance / count**2)


def _distances(target: Ints, at: Array) -> tuple[Ints, Ints, Array, Array]:
    """Pairs of targets of one pose in ascending order, distances [m], derivatives (pairs, 3 n)."""
    order = np.argsort(target)
    i, j = (order[k] for k in np.triu_indices(len(target), 1))
    apart = at[i] - at[j]
    D = np.linalg.norm(apart, axis=1)
    J, pair = np.zeros((len(i), len(target), 3)), np.arange(len(i))
    J[pair, i] = apart / D[:, None]
    J[pair, j] = -J[pair, i]
    return target[i], target[j], D, J.reshape(len(i), 3 * len(target))


def _misshapen(idle: Idle, shape: _Shape, scale: float) -> Ints:
    """Poses without a pull whose distances between targets differ from those of the other poses.

    There nothing else reveals a spoilt reading: a rigid effector keeps its distances D wherever the
    robot is. With d their differences, chi2 = d' (J C J' + V)^-1 d tests the readings.
    """
    poses = np.unique(idle.pulls.pose)
    out = []
    for one in poses:
        mine = (idle.pulls.pose == one) & (idle.target < len(shape.mean))
        a, b, D, J = _distances(idle.target[mine], idle.at[mine])
        known = np.isfinite(shape.mean[a, b])
        d, J = (D - shape.mean[a, b])[known], J[known]
        V = J @ block_diag(*idle.cov[mine]) @ J.T + np.diag(shape.variance[a, b][known])
        chi2 = float(d @ linear.inverse(V) @ d) / scale**2
        if chi2_beyond(chi2, linear.rank(V)) < _RARE / len(poses):
            out.append(one)
    return np.array(out, dtype=np.int64)


_RARE = 1e-3
"""Probability of leaving out any pose without a pull by chance [1]."""

_FEWEST = 4
"""Minimum number of poses: with fewer, position, rotation and tool explain everything."""


def off(zeros: Unloaded, x: Array) -> float:
    """Rms residual of the positions over coordinates [m]."""
    return rms(zeros.seen(x))


def reach(screws: Array, at: Array) -> Array:
    """Motion of targets (m, t, 3) per unit of screws (m, k, 6), rows by target (m, 6 t, k)."""
    m, t, k = len(at), at.shape[1], screws.shape[1]
    along = np.ascontiguousarray(np.swapaxes(screws, 1, 2))  # m, 6, k
    out = np.empty((m, t, 6, k))
    out[:, :, :3] = along[:, None, 3:] + linear.turning(at) @ along[:, None, :3]
    out[:, :, 3:] = along[:, None, :3]
    return out.reshape(m, 6 * t, k)
