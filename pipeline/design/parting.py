"""The motion of a joint that would separate parameters of which the data determine only a mix."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell, jacobian
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot
from pipeline.system.elimination import eliminate
from pipeline.system.fit import Fitted
from pipeline.system.system import System

_STEP_RAD, _STEP_M = np.deg2rad(10.0), 0.5
"""Step of the joint values that are tried."""

_POSES = 12
"""Maximum number of measured poses used; of more, evenly spaced ones are taken."""


@dataclass(frozen=True)
class Motion:
    """A joint to be moved in the measured poses, with all pulls unchanged.

    Attributes:
        joint: Index of the joint.
        to: Its new value [m] or [rad].
        low: Its smallest value so far.
        high: Its largest value so far.
    """

    joint: int
    to: float
    low: float
    high: float


def needs(fitted: Fitted, N: Array, of: Ints) -> str:
    """The motion of a joint that would best separate the members of a mix, in words.

    Args:
        fitted: The campaign.
        N: Information on the parameters in typical sizes, shape (n, n).
        of: The members, shape (m,).
    """
    robot = fitted.case.robot
    motion = parting(fitted.case.cell, fitted.system, fitted.data.pulls, N, of)
    joint, unit = robot.joints[motion.joint], "deg"
    to, low, high = (float(np.rad2deg(one)) for one in (motion.to, motion.low, motion.high))
    if joint.prismatic:
        to, low, high, unit = motion.to, motion.low, motion.high, "m"
    at, before, after = (f"{round(one, 1):g}" for one in (to, low, high))
    so_far = f"at {before} {unit}" if before == after else f"from {before} to {after} {unit}"
    return f"the same pulls in poses with {joint.name} at {at} {unit} (so far {so_far})"


def parting(cell: Cell, system: System, pulls: Pulls, N: Array, of: Ints) -> Motion:
    """Find the motion of one joint that would best separate the members of a mix.

    For each joint and each of its values within the limits, the strongest pull of each pose is
    repeated there. With B_P the displacements per member in typical sizes and s the rms standard
    uncertainty of a row, that adds B_P' B_P / s^2 to the members' information N_P, all other
    parameters taken as known. The criterion is

        log det(I + N_P + B_P' B_P / s^2),

    the information gained on members with a prior of their typical sizes (Lindley, Annals of
    Mathematical Statistics 27, 1956). Among equally good motions the shortest is taken.

    Args:
        cell: The model; its first parameters are those of N.
        system: The campaign's system, for s.
        pulls: The measured pulls.
        N: Information on the parameters in typical sizes, shape (n, n).
        of: The members, shape (m,).
    """
    typical, flat = system.typical[of], replace(cell, equilibrium="undeformed")
    variance = float(np.mean(system.errors.G.multiply(system.errors.G).sum(axis=1)))
    known = np.eye(len(of)) + eliminate(N, np.setdiff1d(np.arange(len(N)), of))[np.ix_(of, of)]
    few, tried = pulls.part(_strongest(pulls)), []
    for joint in range(cell.robot.n):
        low, high = float(pulls.q[:, joint].min()), float(pulls.q[:, joint].max())
        to = _values(cell.robot, joint)
        q = np.tile(few.q, (len(to), 1))
        q[:, joint] = np.repeat(to, len(few))
        moved = Pulls.at(q, np.tile(few.force, (len(to), 1)))
        B = jacobian(flat, moved, np.zeros(len(cell.parameters)))[..., of] * typical
        B = B.reshape(len(to), -1, len(of))
        learnt = linear.log_det(known + np.swapaxes(B, 1, 2) @ B / variance)
        away = np.maximum(np.maximum(to - high, low - to), 0.0)
        tried += [
            (-round(much, _DIGITS), far, Motion(joint, value, low, high))
            for much, far, value in zip(learnt.tolist(), away.tolist(), to.tolist(), strict=True)
        ]
    return min(tried, key=lambda one: one[:2])[2]


_DIGITS = 6
"""Decimals of the log determinant to which motions are compared; equal ones count as equally
good."""


def _strongest(pulls: Pulls) -> Ints:
    """The strongest pull of each pose, of at most `_POSES` poses."""
    order = np.lexsort((-np.linalg.norm(pulls.force, axis=1), pulls.pose))
    _, first = np.unique(pulls.pose[order], return_index=True)
    some = np.unique(np.linspace(0, len(first) - 1, min(_POSES, len(first))).astype(int))
    return np.asarray(order[first[some]], dtype=np.int64)


def _values(robot: Robot, joint: int) -> Array:
    """Values of a joint within its limits; half a turn or a metre each way where it has none."""
    step, far = (_STEP_M, 1.0) if robot.prismatic[joint] else (_STEP_RAD, np.pi)
    low, high = float(robot.lower[joint]), float(robot.upper[joint])
    low, high = (low if np.isfinite(low) else -far), (high if np.isfinite(high) else far)
    steps = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return steps if len(steps) else np.array([(low + high) / 2])
