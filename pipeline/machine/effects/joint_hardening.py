"""A gear stiffens (or softens) with its torque: a nonlinear torsion curve.

In addition to c tau the joint turns by

- cubic, quadratic: h tau (|tau| / tau_rated)^e, e = 2 or 1
- low knee, high knee: h sgn(tau) (|tau| - tau_knee) beyond the knee at 20 % or 50 % of tau_rated

A negative h is a hardening gear.
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import compliance, rated_torque, turning
from pipeline.machine.robot import Robot

_EXPONENT = {"cubic": 2, "quadratic": 1}
_KNEE = {"low knee": 0.2, "high knee": 0.5}
_FORMS = (*_EXPONENT, *_KNEE)

NEEDS = "three load levels at one pose that turns this joint"
FURTHER = "larger loads at a pose that turns this joint"
"""What would settle it, and what would where three levels were pulled."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint, in each form."""
    return tuple(_effect(robot, joint, form) for joint in turning(robot) for form in _FORMS)


def _effect(robot: Robot, joint: int, form: str) -> Elastic:
    c, rated = compliance(robot, joint), rated_torque(robot, joint)

    def response(loaded: Loaded, torque: Array) -> Array:
        size = np.abs(torque)
        if form in _KNEE:
            return np.asarray(np.sign(torque) * np.maximum(size - _KNEE[form] * rated, 0.0))
        return np.asarray(torque * (size / rated) ** _EXPONENT[form])

    return Elastic(
        name="joint_hardening",
        noun="stiffness that changes with the load",
        place="joint",
        element="gear",
        where=joint,
        form=form,
        tolerance=0.2,
        parameters=(
            Parameter(
                *(f"h_{joint}", "rad/(N m)", 0.15 * c),
                meaning="change of the compliance of {joint} with the load",
            ),
        ),
        signature=f"displacement over force at joint {joint} changes with the force: "
        "odd in the load, no jump at zero",
        needs=NEEDS,
        source="the torsion curve of a strain-wave or cycloidal gear steepens with torque; "
        "15 % at rated torque is an estimate, rated torque taken as 1 mrad of twist",
        carrier=(joint,),
        response=response,
    )
