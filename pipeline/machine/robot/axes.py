"""Axes used in programs and logs: those of the controller, or the robot's own joints."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.machine.robot.mdh import Robot


@dataclass(frozen=True, eq=False)
class Axes(Locked):
    """Named axes, q = matrix @ axes + offset.

    Attributes:
        names: Their names, k of them.
        slides: True for lengths, shape (k,); the others are angles.
        matrix: Joint motion per axis motion, shape (n, k).
        offset: Joint values where all axes are 0 [m] or [rad], shape (n,).
    """

    names: tuple[str, ...]
    slides: Bools
    matrix: Array
    offset: Array

    def joints(self, values: Array) -> Array:
        """Joint values (m, n) of axes (m, k), both [m] or [rad]."""
        return np.asarray(values @ self.matrix.T + self.offset)

    def values(self, q: Array) -> Array:
        """Axis values (m, k) at joint values (m, n), both [m] or [rad]."""
        return self.moved(q - self.offset)

    def moved(self, offsets: Array) -> Array:
        """Axis offsets (m, k) of joint offsets (m, n), both [m] or [rad]."""
        return np.asarray(offsets @ linear.shortest(self.matrix).T)

    def alone(self, joint: int) -> tuple[int, float] | None:
        """Index and ratio of the axis that moves this joint and nothing else; None without one."""
        mine = np.flatnonzero(self.matrix[joint])
        if len(mine) != 1 or np.count_nonzero(self.matrix[:, mine[0]]) != 1:
            return None
        return int(mine[0]), float(self.matrix[joint, mine[0]])


LIMIT_SLACK = 1e-9
"""Tolerance for joint limits [m] or [rad]: degrees are rounded when converted."""


def of(robot: Robot) -> Axes:
    """The controller's axes; the joints themselves if the robot file does not map them."""
    if not robot.controller:
        return joints(robot)
    return Axes(robot.controller, robot.slides, robot.controller_matrix, robot.controller_offset)


def displayed(robot: Robot, q: Array) -> Array:
    """Axis values as the controller displays them, mm and degrees, (..., k).

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (..., n).
    """
    mapped = of(robot)
    values = mapped.values(np.atleast_2d(q)).reshape(*np.shape(q)[:-1], len(mapped.names))
    return np.asarray(np.where(mapped.slides, 1e3 * values, np.rad2deg(values)))


def joints(robot: Robot) -> Axes:
    """The joints of the robot as axes."""
    names = tuple(joint.name for joint in robot.joints)
    return Axes(names, robot.prismatic, np.eye(robot.n), np.zeros(robot.n))


def sense(robot: Robot, joint: int) -> int:
    """Sign of the axis that `alone` names relative to its joint: 1, -1, or 0 without one.

    Args:
        robot: The robot.
        joint: Index of the joint.
    """
    found = of(robot).alone(joint) if alone(robot)[joint] else None
    return 0 if found is None else int(np.sign(found[1]))


def alone(robot: Robot) -> tuple[str | None, ...]:
    """Name of the axis (A1, E1) that moves each joint alone with ratio 1 or -1.

    None if there is no such axis, as behind a parallel link. Where the robot file maps no axes of
    the controller, joints have the names of that file, None where it has the joint's own number.
    """
    if not robot.controller:
        own = (joint.name for joint in robot.joints)
        return tuple(_unlike(name, number) for number, name in enumerate(own, start=1))
    mapped, out = of(robot), []
    for joint in range(robot.n):
        found = mapped.alone(joint)
        as_far = found is not None and bool(np.isclose(abs(found[1]), 1.0))
        out.append(mapped.names[found[0]] if found is not None and as_far else None)
    return tuple(out)


def _unlike(name: str, number: int) -> str | None:
    """The name of a joint, if a reader could take it for another than the one of this number."""
    return None if re.findall(r"\d+", name) == [str(number)] else name


def rounded(robot: Robot, q: Array, decimals: int = 6) -> Array:
    """Joint values [m] or [rad] rounded to `decimals` decimals of a log in m and degrees."""
    return from_log_units(robot, np.round(in_log_units(robot, q), decimals))


def in_log_units(robot: Robot, q: Array) -> Array:
    """Joint values in the units of joints.csv: prismatic in m, revolute in degrees.

    Rounding to twelve decimals removes the error of converting degrees to radians and back.
    """
    return np.asarray(np.round(np.where(robot.prismatic, q, np.rad2deg(q)), 12), dtype=np.float64)


def from_log_units(robot: Robot, q: Array) -> Array:
    """The inverse of `in_log_units`, to m and rad."""
    return np.where(robot.prismatic, q, np.deg2rad(q))
