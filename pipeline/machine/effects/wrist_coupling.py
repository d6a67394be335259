"""Coupling of the wrist: its gears share shafts, and torque at one joint turns another.

The compliance matrix of the wrist has off-diagonal entries, symmetric because it derives from one
elastic energy: joint a turns by c_ab tau_b, joint b by c_ab tau_a.
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import compliance, turning
from pipeline.machine.robot import Robot


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for the last three joints of a six-axis arm."""
    numbers = turning(robot)
    if len(numbers) != 6:
        return ()
    a, b, c = numbers[-3:]
    pairs = ((a, b), (b, c), (a, c))
    swapped = [1, 0, 3, 2, 5, 4]

    def parameter(one: int, other: int) -> Parameter:
        mean = float(np.sqrt(compliance(robot, one) * compliance(robot, other)))
        return Parameter(
            *(f"c_{one}{other}", "rad/(N m)", 0.05 * mean),
            meaning=f"compliance that couples joints {one} and {other}",
        )

    def response(loaded: Loaded, torque: Array) -> Array:
        return torque[:, swapped]

    return (
        Elastic(
            name="wrist_coupling",
            noun="coupling of the wrist joints",
            place="wrist",
            parameters=tuple(parameter(*pair) for pair in pairs),
            signature="a wrist joint without torque turns when its neighbour is loaded",
            needs="poses that load one wrist joint at a time",
            source="off-diagonal joint compliance; 5 % is an estimate",
            carrier=tuple(joint for pair in pairs for joint in pair),
            response=response,
            shared=(0, 0, 1, 1, 2, 2),
        ),
    )
