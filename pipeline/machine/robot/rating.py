"""Permissible pulls of a robot, from its payload and from its deflection."""

from __future__ import annotations

from pipeline.base.strict import STANDARD_GRAVITY
from pipeline.machine.robot.mdh import Robot

_REFERENCE_KG = 480.0
"""Payload of a KUKA KR500 L480 [kg], by its name: the reference pull is 0.64 of its weight."""

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
