"""Joint values that bring the flange to a pose: numerically, whatever the arm looks like.

Levenberg-Marquardt with the squared error as damping (Sugihara, IEEE Trans. Robotics 27, 2011):
the steps are Newton's near a solution and stay finite at singularities and out of reach.
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
"""[m]: errors below it are a hundredth of what a program's last digit says."""
_ROUNDS = 60
"""Newton steps; from anywhere in the workspace thirty are usual."""
_LONGEST = 0.5
"""[rad]: longest step; a linear model of the arm says nothing beyond it. A pose that is no more
than this from the last one in every joint is taken to be of the same arm configuration."""
_STARTS = 256
"""From how many places the arm is tried; each configuration of a six-axis arm attracts some per
cent of them."""
_SAME = 1e-3
"""[rad]: solutions that differ less are one; Newton's agree to 1e-7."""
_SLACK = 1e-3
"""[rad]: how far an axis may seem beyond its range: coordinates have three decimals, which an arm
near a singularity magnifies."""
_LEVEL = 1e-9
"""Sine of an angle that is rounding [1]."""
_TURNS = 2 * np.pi * np.arange(-2.0, 3.0)
"""[rad]: what may be added to an angle; wrists turn no more than twice."""

Range = tuple[float, float] | None
"""Lowest and highest value of an axis [rad]; None where nothing is said."""


@dataclass(frozen=True, eq=False)
class _Reached(Locked):
    """Whether, and how, a pose can be reached.

    Attributes:
        q: Joint values [m] or [rad], shape (n,); of the nearest pose where it cannot.
        why_not: What is wrong with it, in words, and what to do about it; None where nothing is.
    """

    q: Array
    why_not: tuple[str, str] | None = None


@dataclass(frozen=True, eq=False)
class Arm(Locked):
    """A robot whose sliding joints stand still while it looks for a pose.

    Attributes:
        robot: The robot.
        axes: The axes in which configurations are stated.
    """

    robot: Robot
    axes: Axes

    def reach(
        self, flange: Array, start: Array, known: bool, ranges: Sequence[Range] = ()
    ) -> _Reached:
        """Joint values for a pose of the flange.

        Of several arm configurations it is the one that `ranges` leaves, else the nearest to
        `start`.

        Args:
            flange: Pose of the flange in F_b, shape (4, 4).
            start: Joint values to start from; of sliding joints the ones to keep, shape (n,).
            known: Whether the robot is known to come from there.
            ranges: What is said of each axis, in the order of those that turn.
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
        """The solution that Newton's steps find from `start`, where nothing else can be meant.

        That is, where all axes are stated, or the robot hardly moves.
        """
        found, left = self._solved(flange, start[None])
        near = self._turned(found[0], start, within)
        if left[0] > _REACHED_M or near is None:
            return None
        stated = len(ranges) > 0 and all(one is not None for one in ranges)
        return near if stated or np.abs(near - start).max() < _LONGEST else None

    def _within(self, ranges: Sequence[Range]) -> list[Range]:
        """What is said of each joint that one axis alone turns."""
        turning = np.flatnonzero(~self.axes.slides).tolist()
        said = dict(zip(turning, ranges, strict=False))
        out: list[Range] = []
        for j in range(self.robot.n):
            own = self.axes.alone(j)
            both = said.get(own[0]) if own else None
            ends = [own[1] * end + float(self.axes.offset[j]) for end in both or ()] if own else []
            out.append((min(ends), max(ends)) if ends else None)
        return out

    def _starts(self, start: Array) -> Array:
        """Places all over the workspace, always the same, shape (`_STARTS`, n)."""
        robot = self.robot
        low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
        q = np.random.default_rng(0).uniform(low, np.maximum(low, high), (_STARTS, robot.n))
        return np.where(robot.prismatic, start, q)

    def _solved(self, flange: Array, q: Array) -> tuple[Array, Array]:
        """Joint values (m, n) from each start, and what is left of the error [m], (m,)."""
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
        """The same pose with every joint in its limits and ranges, nearest to another; or None."""
        out = q.copy()
        for j in np.flatnonzero(~self.robot.prismatic).tolist():
            turns = q[j] + _TURNS
            low, high = self.robot.lower[j], self.robot.upper[j]
            if (said := within[j]) is not None:
                low, high = max(low, said[0]), min(high, said[1])
            fits = turns[(turns >= low - _SLACK) & (turns <= high + _SLACK)]
            if not len(fits):
                return None
            out[j] = fits[np.abs(fits - near[j]).argmin()]
        return out

    def _unreachable(self, flange: Array, q: Array) -> tuple[str, str]:
        """What is said of a pose that no configuration reaches."""
        at = configure(self.robot, q[None])
        off, turn = np.split(_off(at, flange)[0], 2)
        away = f"{1e3 * np.linalg.norm(off):.0f} mm"
        turned = f"{np.rad2deg(np.linalg.norm(turn) / ARM_M):.1f} deg"
        return (
            f"the robot cannot reach it: the nearest it comes is {away} and {turned} away",
            "correct the target, or the frames in which it is given",
        )

    def _outside(self, found: Array, start: Array, ranges: Sequence[Range]) -> tuple[str, str]:
        """What is said of a pose that configurations reach, but not these."""
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
        """Axes of a configuration [deg], and as KUKA's T: the bits of the negative ones."""
        turning = ~self.axes.slides
        values = np.rad2deg(self.axes.values(q[None])[0])[turning]
        names = [name for name, turns in zip(self.axes.names, turning, strict=True) if turns]
        said = ", ".join(f"{name} {x:.1f}" for name, x in zip(names, values, strict=True))
        bits = sum(int(x < 0) << k for k, x in enumerate(values))
        return f"{said} (T {bits})" if names[0] == "A1" else said

    def _beyond(self, q: Array) -> tuple[int, float]:
        """The joint that is furthest beyond its limits, and how far [rad]."""
        turns = q[:, None] + _TURNS
        over = np.maximum(self.robot.lower[:, None] - turns, turns - self.robot.upper[:, None])
        least = np.where(self.robot.prismatic, 0.0, over.min(axis=1))
        return int(least.argmax()), float(least.max())


_SAID = 4
"""Configurations that are said where a target states none of them."""


def _distinct(found: Sequence[Array]) -> list[Array]:
    """Solutions without repetitions."""
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
    """How far flanges are from a pose: place, and turn times `ARM_M` [m], F_b, shape (m, 6)."""
    turn = flange[:3, :3] @ np.swapaxes(at.flange_axes, 1, 2)
    away = flange[:3, 3] - at.flange_origin
    return np.hstack([away, ARM_M * _vector(turn)])


def _vector(turn: Array) -> Array:
    """Rotation vectors [rad], (m, 3), of turns (m, 3, 3); half turns count as turns about x."""
    twice = turn[:, [2, 0, 1], [1, 2, 0]] - turn[:, [1, 2, 0], [2, 0, 1]]
    sine = np.sqrt(np.einsum("mi,mi->m", twice, twice)) / 2
    angle = np.arctan2(sine, (np.einsum("mii->m", turn) - 1) / 2)
    level = sine < _LEVEL
    vector = twice * (np.where(level, 1.0, angle) / np.where(level, 2.0, 2 * sine))[:, None]
    half = level & (angle > 1.0)
    vector[half] = [np.pi, 0.0, 0.0]
    return np.asarray(vector)


def _jacobian(at: Configuration) -> Array:
    """Derivative of place and turn of the flange by the joints, shape (m, 6, n)."""
    moved = velocity(at.twists, at.flange_origin[:, None])[:, 0]
    return np.swapaxes(np.concatenate([moved, ARM_M * at.twists[..., :3]], axis=-1), 1, 2)
