"""A gear has lost motion: it turns by b as soon as its torque leaves zero, b tanh(tau / tau_b)."""

import numpy as np

from pipeline.base.arrays import Parameter
from pipeline.machine.effect import Elastic
from pipeline.machine.effects._anatomy import clamp, rated_torque, turning
from pipeline.machine.robot import Robot

_WIDTH = {"narrow": 0.03, "wide": 0.08}
"""tau_b over the rated torque; lost motion is specified at 3 % of the rated torque."""

_MOST_RAD = 2.2e-3
"""Half of 15 arcmin, the backlash of ordinary planetary gears; a worn reducer comes there, too."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint, in each form."""
    return tuple(_effect(robot, joint, form) for joint in turning(robot) for form in _WIDTH)


def _effect(robot: Robot, joint: int, form: str) -> Elastic:
    full = _WIDTH[form] * rated_torque(robot, joint)

    return Elastic(
        name="joint_lost_motion",
        noun="lost motion",
        place="joint",
        element="gear",
        where=joint,
        form=form,
        tolerance=0.15,
        parameters=(Parameter(f"b_{joint}", "rad", 6e-5, 0.0, _MOST_RAD),),
        signature=f"joint {joint} turns by the same angle at every load, in the sense of its "
        "torque: half of the gear's total lost motion",
        needs="a small and a large load at poses that turn this joint both ways"
        + clamp(robot, joint),
        source="RV reducers: lost motion within 1 arcmin (290 urad) at +-3 % of rated torque",
        carrier=(joint,),
        response=lambda loaded, torque: np.tanh(torque / full),
    )
