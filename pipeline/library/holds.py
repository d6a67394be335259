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
"""Maximum plausible deflection of a joint spring [rad]: gears twist by 1 to 10 mrad under the
largest torque of their drives."""


def refuse_unheld(
    robot: Robot, q: Array, force: Array, point: Array, file: str, line: Sequence[int]
) -> None:
    """Refuse forces that no such robot can hold, as when newtons are taken for kilonewtons.

    They exceed `ABSURD` times the weight of the payload; if that is not stated, they turn a joint
    of nominal stiffness by more than `TWIST_RAD`.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot [N], F_b, shape (m, 3).
        point: Point of application, flange frame [m], shape (3,).
        file: File of the forces, for the message.
        line: Line of each force, empty if there are none.

    Raises:
        InputError: A force is too large; names the first.
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
    limit_n = float(size[first] / times[first])
    raise InputError(
        f"a force of {float(f'{size[first]:.4g}'):g} N is more than the robot holds, about "
        f"{float(f'{limit_n:.3g}'):g} N ({beside})",
        "correct the force or its unit",
        file=file or None,
        line=line[first] if len(line) else None,
    )


def refuse_absurd(robot: Robot, force_n: float, way_out: str, file: str | None = None) -> None:
    """Refuse a pull that no such robot can hold.

    Args:
        robot: The robot.
        force_n: Largest pull [N].
        way_out: Where to reduce the pull, or leave the choice to the program.
        file: File of the pull, for the message.

    Raises:
        InputError: The pull exceeds `ABSURD` times the weight of the payload.
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
