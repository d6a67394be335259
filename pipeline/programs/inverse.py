"""Inverse kinematics: joint values that bring the flange to a pose, for an arm of any structure.

Levenberg-Marquardt with the squared error as damping (Sugihara, IEEE Trans. Robotics 27, 2011): the
steps are those of Newton's method near a solution and stay finite at singularities and out of
reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.machine.robot.axes import Axes
from pipeline.machine.robot.configuration import Configuration, configure, velocity
from pipeline.machine.robot.mdh import Robot
from pipeline.prediction.path import ARM_M

_REACHED_M = 1e-7
"""Largest error of a solution [m]; a hundredth of the last digit of a program."""
_ROUNDS = 60
"""Maximum number of iterations; from anywhere in the workspace thirty are usual."""
_LONGEST = 0.5
"""Longest step of a joint [rad]; beyond it the linearised model of the arm is not valid. A pose
within this of the last one in every joint is assumed to have the same arm configuration."""
_STARTS = 256
"""Number of random starting points; each configuration of a six-axis arm attracts some per cent of
them."""
_SAME = 1e-3
"""Largest joint difference of solutions that are considered equal [rad]; converged ones agree to
1e-7."""
_SLACK = 1e-3
"""Tolerance on the range of an axis [rad]: coordinates have three decimals, and near a singularity
their rounding is magnified."""
_LEVEL = 1e-9
"""Sine of an angle that is treated as zero [1]."""
_TURNS = 2 * np.pi * np.arange(-2.0, 3.0)
"""Whole turns that may be added to an angle [rad]; wrists turn by no more than two."""

Range = tuple[float, float] | None
"""Smallest and largest value of an axis [rad]; None if it is not restricted."""


@dataclass(frozen=True, eq=False)
class _Reached(Locked):
    """Result of the inverse kinematics of one pose.

    Attributes:
        q: Joint values [m] or [rad], shape (n,); those of the nearest pose if it cannot be reached.
        why_not: Problem and remedy, in words; None if there is no problem.
    """

    q: Array
    why_not: tuple[str, str] | None = None


@dataclass(frozen=True, eq=False)
class FixedSlidingArm(Locked):
    """A robot whose sliding joints are fixed during inverse kinematics.

    Attributes:
        robot: The robot.
        axes: Axes in which arm configurations are stated.
    """

    robot: Robot
    axes: Axes

    def reach(
        self, flange: Array, start: Array, known: bool, ranges: Sequence[Range] = ()
    ) -> _Reached:
        """Joint values for a pose of the flange.

        Of several arm configurations, the one within `ranges` is taken, else the nearest to
        `start`.

        Args:
            flange: Pose of the flange in F_b, shape (4, 4).
            start: Joint values to start from, which sliding joints keep, shape (n,).
            known: Whether the robot is known to come from `start`.
            ranges: Range of each turning axis, in the order of the axes.
        """
        within = self._within(ranges)
        if known and (near := self._near(flange, start, within, ranges)) is not None:
            return _Reached(near)
        found, left = self._solved(flange, np.vstack([start[None], self._starts(start)]))
        good = found[left < _REACHED_M]
        if not len(good):
            return _Reached(found[left.argmin()], self._unreachable(flange, found[left.argmin()]))
        turned = (self._turned(q, start, within) for q in good)
        fits = _distinct([q for q in turned if q is not None])
        if not fits:
            return _Reached(good[0], self._outside(good, start, ranges))
        if len(fits) > 1 and not known:
            return _Reached(fits[0], _several(len(fits)))
        return _Reached(min(fits, key=lambda q: float(np.abs(q - start).max())))

    def _near(
        self, flange: Array, start: Array, within: Sequence[Range], ranges: Sequence[Range]
    ) -> Array | None:
        """The solution near `start`, if the configuration is not ambiguous; else None.

        It is not if the ranges of all axes are stated, or if the robot hardly moves.
        """
        found, left = self._solved(flange, start[None])
        near = self._turned(found[0], start, within)
        if left[0] > _REACHED_M or near is None:
            return None
        stated = len(ranges) > 0 and all(one is not None for one in ranges)
        return near if stated or np.abs(near - start).max() < _LONGEST else None

    def _within(self, ranges: Sequence[Range]) -> list[Range]:
        """Range of each joint that is moved by one axis alone."""
        turning = np.flatnonzero(~self.axes.slides).tolist()
        ranges_of = dict(zip(turning, ranges, strict=False))
        out: list[Range] = []
        for j in range(self.robot.n):
            own = self.axes.alone(j)
            both = ranges_of.get(own[0]) if own else None
            ends = [own[1] * end + float(self.axes.offset[j]) for end in both or ()] if own else []
            out.append((min(ends), max(ends)) if ends else None)
        return out

    def _starts(self, start: Array) -> Array:
        """Random joint values all over the workspace, always the same, shape (`_STARTS`, n)."""
        robot = self.robot
        low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
        q = np.random.default_rng(0).uniform(low, np.maximum(low, high), (_STARTS, robot.n))
        return np.where(robot.prismatic, start, q)

    def _solved(self, flange: Array, q: Array) -> tuple[Array, Array]:
        """Joint values (m, n) from each start, and the remaining error [m], shape (m,)."""
        free = ~self.robot.prismatic
        for _ in range(_ROUNDS):
            at = configure(self.robot, q)
            error = _off(at, flange)
            square = np.einsum("mi,mi->m", error, error)
            if (square < (1e-2 * _REACHED_M) ** 2).all():
                break
            J = _jacobian(at) * free
            damped = J @ np.swapaxes(J, 1, 2) + (square[:, None, None] + 1e-12) * np.eye(6)
            step = np.einsum("mij,mi->mj", J, linear.solve(damped, error))
            size = np.abs(step).max(axis=1, keepdims=True)
            q = q + step * np.minimum(1.0, _LONGEST / np.maximum(size, _LONGEST))
        return q, np.linalg.norm(_off(configure(self.robot, q), flange), axis=1)

    def _turned(self, q: Array, near: Array, within: Sequence[Range]) -> Array | None:
        """The same pose with every joint within limits and ranges, nearest to `near`; or None."""
        out = q.copy()
        for j in np.flatnonzero(~self.robot.prismatic).tolist():
            turns = q[j] + _TURNS
            low, high = self.robot.lower[j], self.robot.upper[j]
            if (interval := within[j]) is not None:
                low, high = max(low, interval[0]), min(high, interval[1])
            fits = turns[(turns >= low - _SLACK) & (turns <= high + _SLACK)]
            if not len(fits):
                return None
            out[j] = fits[np.abs(fits - near[j]).argmin()]
        return out

    def _unreachable(self, flange: Array, q: Array) -> tuple[str, str]:
        """Problem and remedy for a pose that no arm configuration reaches."""
        at = configure(self.robot, q[None])
        off, turn = np.split(_off(at, flange)[0], 2)
        away = f"{1e3 * np.linalg.norm(off):.0f} mm"
        turned = f"{np.rad2deg(np.linalg.norm(turn) / ARM_M):.1f} deg"
        return (
            f"the robot cannot reach it: the nearest it comes is {away} and {turned} away",
            "correct the target, or the frames in which it is given",
        )

    def _outside(self, found: Array, start: Array, ranges: Sequence[Range]) -> tuple[str, str]:
        """Problem and remedy for a pose reached only by configurations other than those allowed."""
        none: list[Range] = [None] * self.robot.n
        turned = [self._turned(q, start, none) for q in found] if ranges else []
        if ways := [self._in_words(q) for q in turned if q is not None]:
            return (
                "no arm configuration that reaches it is the one it states: it is reached with "
                f"{' or '.join(ways[:_SAID])}",
                "correct it, the frames in which it is given or [controller] of the robot file",
            )
        nearest = min(found, key=lambda q: self._beyond(q)[1])
        joint, beyond = self._beyond(nearest)
        name = self.robot.joints[joint].name
        return (
            f"it is reached only with joint {name} {np.rad2deg(beyond):.1f} deg beyond its limit",
            "correct the target, or the frames in which it is given",
        )

    def _in_words(self, q: Array) -> str:
        """Axis values of a configuration [deg], and KUKA's T: bits of the negative ones."""
        turning = ~self.axes.slides
        values = np.rad2deg(self.axes.values(q[None])[0])[turning]
        names = [name for name, turns in zip(self.axes.names, turning, strict=True) if turns]
        text = ", ".join(f"{name} {x:.1f}" for name, x in zip(names, values, strict=True))
        bits = sum(int(x < 0) << k for k, x in enumerate(values))
        return f"{text} (T {bits})" if names[0] == "A1" else text

    def _beyond(self, q: Array) -> tuple[int, float]:
        """The joint furthest beyond its limits, and by how much [rad]."""
        turns = q[:, None] + _TURNS
        over = np.maximum(self.robot.lower[:, None] - turns, turns - self.robot.upper[:, None])
        least = np.where(self.robot.prismatic, 0.0, over.min(axis=1))
        return int(least.argmax()), float(least.max())


_SAID = 4
"""Maximum number of configurations listed if the stated one does not reach the pose."""


def _distinct(found: Sequence[Array]) -> list[Array]:
    """Solutions without duplicates."""
    out: list[Array] = []
    for q in found:
        if all(np.abs(q - other).max() > _SAME for other in out):
            out.append(q)
    return out


def _several(count: int) -> tuple[str, str]:
    return (
        f"{count} arm configurations reach it and none is specified",
        "give the joint values before it with --start",
    )


def _off(at: Configuration, flange: Array) -> Array:
    """Pose error of the flanges: position, and rotation times `ARM_M` [m], F_b, shape (m, 6)."""
    turn = flange[:3, :3] @ np.swapaxes(at.flange_axes, 1, 2)
    away = flange[:3, 3] - at.flange_origin
    return np.hstack([away, ARM_M * _vector(turn)])


def _vector(turn: Array) -> Array:
    """Rotation vectors [rad], (m, 3), of rotations (m, 3, 3); half turns are taken about x."""
    twice = turn[:, [2, 0, 1], [1, 2, 0]] - turn[:, [1, 2, 0], [2, 0, 1]]
    sine = np.sqrt(np.einsum("mi,mi->m", twice, twice)) / 2
    angle = np.arctan2(sine, (np.einsum("mii->m", turn) - 1) / 2)
    level = sine < _LEVEL
    vector = twice * (np.where(level, 1.0, angle) / np.where(level, 2.0, 2 * sine))[:, None]
    half = level & (angle > 1.0)
    vector[half] = [np.pi, 0.0, 0.0]
    return np.asarray(vector)


def _jacobian(at: Configuration) -> Array:
    """Jacobian of position [m] and rotation times `ARM_M` of the flange, shape (m, 6, n)."""
    moved = velocity(at.twists, at.flange_origin[:, None])[:, 0]
    return np.swapaxes(np.concatenate([moved, ARM_M * at.twists[..., :3]], axis=-1), 1, 2)
