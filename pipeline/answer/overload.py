"""A force that is many times what the robot carries: the fact, and the sentence."""

from __future__ import annotations

import numpy as np

from pipeline.answer.contract import Overload
from pipeline.base.quantities import plain
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot, rating


def overload_entry(robot: Robot, pulls: Pulls) -> Overload | None:
    """The hardest pull, where the robot would not hold it; None where nobody says what it holds."""
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
    """A sentence where a force is many times what the robot carries."""
    if fact is None:
        return []
    return [
        f"The hardest pull, {plain(fact.force_n)} N in pose {fact.pose}, is {plain(fact.times, 2)} "
        f"times the weight of the {fact.payload_kg:g} kg that the robot carries: check the "
        "unit of the loads, and whether campaign.toml names the right robot."
    ]
