"""Permissible pulls of a robot, from its payload and from its deflection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.base.strict import STANDARD_GRAVITY
from pipeline.machine.robot.configuration import configure, torque
from pipeline.machine.robot.mdh import Robot

REFERENCE_PULL_N = 3000.0
"""Largest pull of the reference set-up [N], at a KR500 with a payload of `_REFERENCE_KG`."""

_REFERENCE_KG = 480.0
"""Payload of a KUKA KR500 L480 [kg], by its name: the reference pull is 0.64 of its weight."""

_MOST_M = 0.01
"""Maximum displacement of the load point under the largest pull [m]. The linear equations neglect
about d^2/L of a deflection d of an arm of reach L, which for 10 mm at 3 m is the scatter of one
reading of a tracker, 0.03 mm."""

ABSURD = 3.0
"""Multiple of the payload's weight above which a pull must be a mistake [1]. Servo motors give
about three times their rated torque for seconds (300 to 350 % in data sheets of the Yaskawa
Sigma-7), and a robot is rated to move its payload continuously: it cannot hold more."""


def weight_n(robot: Robot) -> float | None:
    """Weight of the rated payload [N], None if the robot's file does not state it."""
    return None if robot.payload_kg is None else robot.payload_kg * STANDARD_GRAVITY


def payloads(robot: Robot, force_n: float) -> float | None:
    """Force [N] as a multiple of the weight of the rated payload, None if that is not stated."""
    weight = weight_n(robot)
    return None if weight is None else force_n / weight


def relative(robot: Robot) -> float:
    """Payload relative to that of the reference robot [1]; 1 if not stated."""
    return 1.0 if robot.payload_kg is None else robot.payload_kg / _REFERENCE_KG


def share(robot: Robot, load_point: Array) -> float:
    """Appropriate pull of a robot relative to the reference set-up [1].

    In proportion to its payload, and limited to what moves the load point by `_MOST_M`; 1 if its
    file states neither payload nor stiffness.

    Args:
        robot: The robot.
        load_point: Point of application, flange frame [m], shape (3,).
    """
    found = relative(robot)
    if all(joint.stiffness or joint.stiffness_range for joint in robot.joints):
        found = min(found, _MOST_M / (REFERENCE_PULL_N * _softness(robot, load_point)))
    return found


def _softness(robot: Robot, load_point: Array) -> float:
    """Compliance of the load point in its most compliant direction [m/N], rms over poses.

    Poses are random within the limits; joints without limits make one turn, or slide a metre either
    way.
    """
    free = np.where(robot.prismatic, 1.0, np.pi)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(robot.lower, -free), np.minimum(robot.upper, free), (256, robot.n))
    at = configure(robot, q)
    points = at.points(load_point[None])[:, 0]
    J = np.stack([torque(at.twists, points, np.tile(e, (len(q), 1))) for e in np.eye(3)], axis=1)
    compliance = np.einsum("mik,k,mjk->mij", J, robot.nominal_compliance, J)
    return linear.rms(linear.directions(compliance)[0][:, -1])


def round_pull(value: float) -> float:
    """Round a pull to two significant digits, as people set it."""
    return float(f"{value:.2g}")


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
    held = float(size[first] / times[first])
    raise InputError(
        f"a force of {float(f'{size[first]:.4g}'):g} N is more than the robot holds, about "
        f"{float(f'{held:.3g}'):g} N ({beside})",
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
