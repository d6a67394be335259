"""The stiffness of a gear depends on the sign of its torque: bilinear, with a kink at zero.

In addition to c tau the joint turns by

- pull: dc |tau|
- total: dc (|tau + tau_w| - |tau_w|), where tau_w is the torque of the arm's own weight before
  the pull

The compliance is c + dc for positive and c - dc for negative torque; c alone is that of neither
direction. In `total` the pull may carry the torque across zero: the displacement is the difference
of two states.
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import by_weight, compliance, turning
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import weighs

_NONE_NM = 1e-6
"""Torque [N m] that is none, but for rounding: that of a weight on a vertical axis."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint; also of the total torque if link masses are known."""
    forms = ("total", "pull") if weighs(robot) else ("pull",)
    return tuple(_effect(robot, joint, form) for joint in turning(robot) for form in forms)


def _effect(robot: Robot, joint: int, form: str) -> Elastic:
    c = compliance(robot, joint)

    def before(loaded: Loaded) -> Array:
        """Torque on the joint before the pull [N m], shape (m, 1)."""
        if form == "pull":
            return np.zeros((len(loaded.pulls), 1))
        return by_weight(robot, loaded.configuration)[:, joint - 1 : joint]

    def response(loaded: Loaded, torque: Array) -> Array:
        own = before(loaded)
        return np.abs(torque + own) - np.abs(own)

    return Elastic(
        name="joint_asymmetry",
        noun="direction-dependent stiffness",
        place="joint",
        element="gear",
        where=joint,
        form=form,
        tolerance=0.005,
        parameters=(
            Parameter(
                *(f"dc_{joint}", "rad/(N m)", 0.15 * c),
                meaning="half of the difference of both compliances of {joint}",
            ),
        ),
        signature=f"displacement over force at joint {joint} is constant each way of its torque, "
        "and another one each way: even in the load, a kink at zero",
        needs="pulls that turn this joint both ways",
        source="flanks, bearings and preload of a gear are not alike each way; 15 % of the mean to "
        "either side, at most that of a gear twice as soft as its nominal one, are estimates",
        carrier=(joint,),
        response=response,
        under_weight=np.abs,
        side=lambda loaded, torque: np.where(torque + before(loaded) < -_NONE_NM, -1.0, 1.0),
    )
