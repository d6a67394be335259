"""How hard a robot may be pulled: by what it carries, and by how far it would bend."""

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
"""The hardest pull of the reference set-up [N], at a KR500 that carries `_REFERENCE_KG`."""

_REFERENCE_KG = 480.0
"""Payload of a KUKA KR500 L480 [kg], by its name: the reference pull is 0.64 of its weight."""

_MOST_M = 0.01
"""How far the hardest pull should move the load point [m]. The equations are linear: of a
deflection d of an arm that reaches L they leave out about d^2/L, which for 10 mm at 3 m is the
scatter of one reading of a tracker, 0.03 mm."""

ABSURD = 3.0
"""A pull of more times the weight of the payload than this is a slip. Drives of robots are servo
motors, which give about three times their rated torque for seconds (300 to 350 % in data sheets of
the Yaskawa Sigma-7), and a robot is rated to move its payload all day: it does not hold more."""


def weight_n(robot: Robot) -> float | None:
    """Weight of what the robot carries [N], None when its file does not say."""
    return None if robot.payload_kg is None else robot.payload_kg * STANDARD_GRAVITY


def payloads(robot: Robot, force_n: float) -> float | None:
    """A force [N] as a multiple of the weight that the robot carries, None when nobody says."""
    weight = weight_n(robot)
    return None if weight is None else force_n / weight


def relative(robot: Robot) -> float:
    """Payload over that of the reference robot; 1 where its file does not say."""
    return 1.0 if robot.payload_kg is None else robot.payload_kg / _REFERENCE_KG


def share(robot: Robot, load_point: Array) -> float:
    """How hard to pull a robot, relative to the reference set-up.

    As much less as it carries less, and no harder than what moves the load point by `_MOST_M`; as
    hard as there where its file says neither payload nor stiffness.

    Args:
        robot: The robot.
        load_point: Where it is pulled, flange frame [m], shape (3,).
    """
    found = relative(robot)
    if all(joint.stiffness or joint.stiffness_range for joint in robot.joints):
        found = min(found, _MOST_M / (REFERENCE_PULL_N * _softness(robot, load_point)))
    return found


def _softness(robot: Robot, load_point: Array) -> float:
    """Deflection of the load point along a pull [m/N], in the direction that bends most, rms.

    Over poses within the limits; joints without them turn once, and slide a metre.
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
    """A pull as people set it: two digits."""
    return float(f"{value:.2g}")


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
