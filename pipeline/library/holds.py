"""Forces that no such robot holds are refused."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.machine.robot.configuration import configure, torque
from pipeline.machine.robot.mdh import Robot
from pipeline.machine.robot.rating import ABSURD, payloads, weight_n

TWIST_RAD = 1e-2
"""No spring of a joint gives way by more: gears twist by 1 to 10 mrad under the largest torque of
their drives."""


def refuse_unheld(
    robot: Robot, q: Array, force: Array, point: Array, file: str, line: Sequence[int]
) -> None:
    """Refuse forces of a path that no such robot holds, as where newtons are taken for kilonewtons.

    They are more than `ABSURD` times the weight that it carries; where its file does not say what
    it carries, they turn a joint of nominal stiffness by more than `TWIST_RAD`.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot [N], F_b, shape (m, 3).
        point: Where it acts, flange frame [m], shape (3,).
        file: Where the forces stand, for the message.
        line: Of each of them, empty where they stand in no line.

    Raises:
        InputError: One is too large; names the first.
    """
    size, most = np.linalg.norm(force, axis=1), weight_n(robot)
    if most is not None:
        times, beside = size / (ABSURD * most), f"{robot.name} carries {robot.payload_kg:g} kg"
    else:
        at = configure(robot, q)
        twist = np.abs(torque(at.twists, at.points(point[None])[:, 0], force))
        twist = np.where(robot.prismatic, 0.0, twist * robot.nominal_compliance).max(axis=1)
        times = twist / TWIST_RAD
        beside = f"it turns a joint of {robot.name} by more than {1e3 * TWIST_RAD:g} mrad"
    beyond = np.flatnonzero(times > 1)
    if not len(beyond):
        return
    first = int(beyond[0])
    held = float(size[first] / times[first])
    raise InputError(
        f"a force of {float(f'{size[first]:.4g}'):g} N is more than the robot holds, about "
        f"{float(f'{held:.3g}'):g} N ({beside})",
        "correct the force or its unit",
        file=file or None,
        line=line[first] if len(line) else None,
    )


def refuse_absurd(robot: Robot, force_n: float, way_out: str, file: str | None = None) -> None:
    """Refuse a pull that no such robot holds.

    Args:
        robot: The robot.
        force_n: The hardest pull [N].
        way_out: Where to pull less, or leave the pulls to us.
        file: Where it stands, for the message.

    Raises:
        InputError: The pull is more than `ABSURD` times the weight that the robot carries.
    """
    times, weight = payloads(robot, force_n), weight_n(robot)
    if times is None or weight is None or times <= ABSURD:
        return
    raise InputError(
        f"a pull of {float(f'{force_n:.4g}'):g} N is {times:.3g} times what {robot.name} carries "
        f"({robot.payload_kg:g} kg, {weight:.0f} N)",
        f"pull at most {ABSURD * weight:.0f} N: {way_out}, or correct payload_kg of the robot file",
        file=file,
    )
