"""A force of many times the robot's payload: the fact, and the sentence."""

from __future__ import annotations

import numpy as np

from pipeline.answer.contract import Overload
from pipeline.base.quantities import plain
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot, rating


def overload_entry(robot: Robot, pulls: Pulls) -> Overload | None:
    """The strongest pull, if the robot could not hold it; None also if no payload is stated."""
    force = np.linalg.norm(pulls.force, axis=1)
    if not len(force):
        return None
    hardest = int(force.argmax())
    times = rating.payloads(robot, float(force[hardest]))
    if robot.payload_kg is None or times is None or times <= rating.ABSURD:
        return None
    return Overload(
        pose=int(pulls.pose[hardest]),
        repeat=int(pulls.repeat[hardest]),
        force_n=float(force[hardest]),
        payload_kg=robot.payload_kg,
        times=times,
    )


def overloaded(fact: Overload | None) -> list[str]:
    """A sentence on an overload; none without one."""
    if fact is None:
        return []
    return [
        f"The hardest pull, {plain(fact.force_n)} N in pose {fact.pose}, is {plain(fact.times, 2)} "
        f"times the weight of the {fact.payload_kg:g} kg that the robot carries: check the "
        "unit of the loads, and whether campaign.toml names the right robot."
    ]
