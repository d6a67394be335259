"""How hard a robot may be pulled: by what it carries, and by how far it would bend."""

from __future__ import annotations

from pipeline.base.strict import STANDARD_GRAVITY
from pipeline.machine.robot.mdh import Robot

_REFERENCE_KG = 480.0
"""Payload of a KUKA KR500 L480 [kg], by its name: the reference pull is 0.64 of its weight."""

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
