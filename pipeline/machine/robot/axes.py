"""The axes that a program or a log speaks of: the controller's, or the robot's own joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.machine.robot.mdh import Robot


@dataclass(frozen=True, eq=False)
class Axes(Locked):
    """Axes by name, q = matrix @ axes + offset.

    Attributes:
        names: Their names, k of them.
        slides: Which of them are lengths, shape (k,); the others are angles.
        matrix: Joints per axis, shape (n, k).
        offset: Joints where all axes are 0 [m] or [rad], shape (n,).
    """

    names: tuple[str, ...]
    slides: Bools
    matrix: Array
    offset: Array

    def joints(self, values: Array) -> Array:
        """Joint values (m, n) of axes (m, k), both [m] or [rad]."""
        return np.asarray(values @ self.matrix.T + self.offset)

    def values(self, q: Array) -> Array:
        """Axes (m, k) at joint values (m, n), both [m] or [rad]."""
        return self.moved(q - self.offset)

    def moved(self, offsets: Array) -> Array:
        """What joint offsets (m, n) are in the axes, (m, k), both [m] or [rad]."""
        return np.asarray(offsets @ linear.shortest(self.matrix).T)

    def alone(self, joint: int) -> tuple[int, float] | None:
        """The axis that turns this joint and nothing else, with its ratio; None without one."""
        mine = np.flatnonzero(self.matrix[joint])
        if len(mine) != 1 or np.count_nonzero(self.matrix[:, mine[0]]) != 1:
            return None
        return int(mine[0]), float(self.matrix[joint, mine[0]])


LIMIT_SLACK = 1e-9
"""How far a joint may seem beyond its limit [m] or [rad]: degrees are rounded when converted."""


def of(robot: Robot) -> Axes:
    """The controller's axes; the joints themselves where the robot file does not map them."""
    if not robot.controller:
        return joints(robot)
    slides = robot.prismatic.astype(float) @ np.abs(robot.controller_matrix) > 0
    return Axes(robot.controller, slides, robot.controller_matrix, robot.controller_offset)


def shown(robot: Robot, q: Array) -> Array:
    """Axes as a controller shows them, mm and degrees, at joint values [m] or [rad], (..., k)."""
    mapped = of(robot)
    values = mapped.values(np.atleast_2d(q)).reshape(*np.shape(q)[:-1], len(mapped.names))
    return np.asarray(np.where(mapped.slides, 1e3 * values, np.rad2deg(values)))


def from_shown(robot: Robot, values: Array) -> Array:
    """The inverse of `shown`, to m and rad, (..., n)."""
    return robot.from_controller(values)


def joints(robot: Robot) -> Axes:
    """The joints of the robot as axes."""
    names = tuple(joint.name for joint in robot.joints)
    return Axes(names, robot.prismatic, np.eye(robot.n), np.zeros(robot.n))


def sense(robot: Robot, joint: int) -> int:
    """1 where the axis that `alone` names turns with a joint, -1 against it, 0 without one.

    Args:
        robot: The robot.
        joint: Index of the joint.
    """
    found = of(robot).alone(joint) if alone(robot)[joint] else None
    return 0 if found is None else int(np.sign(found[1]))


def alone(robot: Robot) -> tuple[str | None, ...]:
    """The controller's axis of each joint, A1 or E1, that moves it alone and as far.

    None where no axis does, as behind a parallel link, or the robot file maps none.
    """
    if not robot.controller:
        return (None,) * robot.n
    mapped, out = of(robot), []
    for joint in range(robot.n):
        found = mapped.alone(joint)
        as_far = found is not None and bool(np.isclose(abs(found[1]), 1.0))
        out.append(mapped.names[found[0]] if found is not None and as_far else None)
    return tuple(out)


def rounded(robot: Robot, q: Array, decimals: int = 6) -> Array:
    """Joint values [m] or [rad] that a log in m and degrees with so many decimals holds exactly."""
    logged = np.round(in_log_units(robot, q), decimals)
    return from_log_units(robot, logged)


def in_log_units(robot: Robot, q: Array) -> Array:
    """Joint values as joints.csv has them: prismatic in m, revolute in degrees.

    Twelve decimals undo the rounding of degrees to radians and back: what was -10 is -10 again.
    """
    logged = np.where(robot.prismatic, q, np.rad2deg(q))
    return np.asarray(np.round(logged, 12), dtype=np.float64)


def from_log_units(robot: Robot, q: Array) -> Array:
    """The inverse of `in_log_units`, to m and rad."""
    return np.where(robot.prismatic, q, np.deg2rad(q))
