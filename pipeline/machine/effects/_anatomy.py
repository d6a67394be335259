"""Anatomy of a robot as needed by the effects: rail, shoulder, elbow, wrist."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.effect import Loaded
from pipeline.machine.robot import Configuration, Robot
from pipeline.machine.robot.weight import gravity_torque

_RATED_TWIST_RAD = 1e-3
"""Twist of a gear at its rated torque: 1 mrad (3.4 arcmin), catalogue values of RV reducers."""


def rail(robot: Robot) -> bool:
    """True if the first joint is prismatic."""
    return robot.joints[0].prismatic


def turning(robot: Robot) -> tuple[int, ...]:
    """Numbers of the revolute joints, counted from 1 at the base."""
    return tuple(number for number, joint in enumerate(robot.joints, 1) if not joint.prismatic)


def arm(robot: Robot) -> tuple[int, int, int] | None:
    """Numbers of the shoulder, the elbow and the joint whose frame sits at the wrist centre.

    These are the second, third and fifth revolute joint of a six-axis arm; None for other robots.
    """
    numbers = turning(robot)
    return (numbers[1], numbers[2], numbers[4]) if len(numbers) == 6 else None


def compliance(robot: Robot, joint: int) -> float:
    """Typical compliance of a joint [m/N] or [rad/(N m)]."""
    return float(robot.nominal_compliance[joint - 1])


def rated_torque(robot: Robot, joint: int) -> float:
    """Torque that twists a gear of nominal compliance by `_RATED_TWIST_RAD` [N m]."""
    return _RATED_TWIST_RAD / compliance(robot, joint)


@lru_cache(maxsize=1)  # shared by all joints for the same pulls
def by_weight(robot: Robot, here: Configuration) -> Array:
    """Joint torques due to the weight of the links, before the pull [N m], shape (m, n)."""
    m = len(here.q)
    return gravity_torque(robot, here, robot.gravity, np.zeros(m), np.zeros((m, 3)))


@lru_cache(maxsize=8)  # shared by all effects of the carriage for the same poses
def rail_axes(loaded: Loaded) -> tuple[Array, Array, Array]:
    """Unit vectors along the rail, across it and up, each (m, 3), in F_b."""
    along = loaded.configuration.axes[:, 0, :, 2]
    up = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
    return along, np.cross(along, up), up


def rail_ends(robot: Robot) -> tuple[float, float]:
    """Lower and upper end of the rail [m]; 0 and 10 m if its file does not state them."""
    ends = robot.lower[0], robot.upper[0]
    return ends if np.isfinite(ends).all() else (0.0, 10.0)


def harmonics(angle: Array, numbers: Sequence[int]) -> Array:
    """cos(k a), sin(k a) of angles (m,) for each k in `numbers`, shape (m, 2 len(numbers))."""
    return np.stack([wave(k * angle) for k in numbers for wave in (np.cos, np.sin)], axis=1)


def carriage(loaded: Loaded) -> Array:
    """Origin of the carriage [m], shape (m, 3), in F_b."""
    return loaded.configuration.origin[:, 0]


def clamp(robot: Robot, joint: int) -> str:
    """Addition to `needs` for the last joint, which looks like play of the clamp; else empty."""
    if joint != turning(robot)[-1]:
        return ""
    return "; reflectors on the flange, as an effector that turns in its clamp looks the same"


def direction(loaded: Loaded) -> Array:
    """Unit vector of the force on the robot, zero without a force, shape (m, 3)."""
    size = np.linalg.norm(loaded.force, axis=1, keepdims=True)
    return np.asarray(loaded.force / np.where(size > 0, size, 1.0))
