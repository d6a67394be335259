"""Lost motion of a gear: it turns by b as soon as its torque leaves zero.

In addition to c tau the joint turns by

- pull: b tanh(tau / tau_b)
- total: b (tanh((tau + tau_w) / tau_b) - tanh(tau_w / tau_b)), where tau_w is the torque of the
  arm's own weight before the pull: flanks that the weight holds in contact stay so until the pull
  takes the torque across zero
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import by_weight, clamp, rated_torque, turning
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import weighs

_WIDTH = {"narrow": 0.03, "wide": 0.08}
"""tau_b as a fraction of the rated torque [1]; lost motion is specified at 3 % of the rated
torque."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect per revolute joint and form; also of the total torque if link masses are known."""
    totals = (False, True) if weighs(robot) else (False,)
    return tuple(
        _effect(robot, joint, width, total)
        for joint in turning(robot)
        for total in totals
        for width in _WIDTH
    )


def _effect(robot: Robot, joint: int, width: str, total: bool) -> Elastic:
    full = _WIDTH[width] * rated_torque(robot, joint)

    def law(torque: Array) -> Array:
        return np.asarray(np.tanh(torque / full))

    def response(loaded: Loaded, torque: Array) -> Array:
        if not total:
            return law(torque)
        own = by_weight(robot, loaded.configuration)[:, joint - 1 : joint]
        return law(torque + own) - law(own)

    return Elastic(
        name="joint_lost_motion",
        noun="lost motion",
        place="joint",
        element="gear",
        where=joint,
        form=f"{width}, total" if total else width,
        tolerance=0.15,
        parameters=(
            Parameter(f"b_{joint}", "rad", 6e-5, 0.0, np.inf, "half of the lost motion of {joint}"),
        ),
        signature=f"joint {joint} turns by the same angle at every load, in the sense of its "
        "torque: half of the gear's total lost motion",
        needs="a small and a large load at poses that turn this joint both ways"
        + clamp(robot, joint),
        source="RV reducers: lost motion within 1 arcmin (290 urad) at +-3 % of rated torque",
        carrier=(joint,),
        response=response,
        under_weight=law,
    )
