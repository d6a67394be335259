"""Friction in a gear: unloading does not come back the way loading went.

    held:      friction takes its part of the torque both ways: -h sgn(tau) branch
    left over: what loading wound up is left while unloading:    h sgn(tau) on the way down
    bow:       a loop that closes at zero and at the pose's peak: h 4 (t - t^2), t = tau / peak

branch is +1 while the turnbuckle tightens and -1 while it slackens.
"""

import numpy as np

from pipeline.effects._anatomy import joint_screw, rated_torque, turning
from pipeline.effects._effect import Elastic, Loaded
from pipeline.results import Array, Ints, Parameter
from pipeline.robot import Robot

FORMS = ("held", "left over", "bow")


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint, in each form."""
    return tuple(_effect(robot, joint, form) for joint in turning(robot) for form in FORMS)


def _effect(robot: Robot, joint: int, form: str) -> Elastic:
    step = 0.03 * rated_torque(robot, joint)

    def response(loaded: Loaded, torque: Array) -> Array:
        branch, sense = loaded.pulls.branch[:, None], np.tanh(torque / step)
        if form == "held":
            return -sense * branch
        if form == "left over":
            return sense * (branch < 0)
        part = np.abs(torque) / np.maximum(_peak(loaded.pulls.pose, np.abs(torque)), 1e-9)
        return 4 * (part - part**2) * sense * (branch < 0)

    return Elastic(
        name="joint_hysteresis",
        where=joint,
        form=form,
        tolerance=0.2,
        parameters=(Parameter(f"f_{joint}", "rad", 5e-5, 0.0, 1e-3),),
        signature=f"at the same reading joint {joint} stands elsewhere while unloading than while "
        "loading",
        needs="the same loads on the way up and on the way down, branch recorded in loads.csv",
        source="Coulomb friction and Masing's rule; 50 urad is an estimate",
        carrier=(joint,),
        twists=lambda loaded: joint_screw(loaded, joint),
        response=response,
    )


def _peak(pose: Ints, torque: Array) -> Array:
    """Largest torque of the pull's pose, shape (m, 1)."""
    _, number = np.unique(pose, return_inverse=True)
    peak = np.zeros(number.max(initial=0) + 1)
    np.maximum.at(peak, number, torque[:, 0])
    return peak[number][:, None]
