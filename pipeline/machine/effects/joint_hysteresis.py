"""Friction in a gear: unloading does not follow the loading curve.

- held: friction carries part of the torque in both directions, -h sgn(tau) branch
- left over: part of the wind-up remains while unloading, h sgn(tau) on the way down
- bow: a loop that closes at zero and at the pose's peak torque, h sgn(tau) 4 (t - t^2) on the way
  down, t = |tau| / peak
- sliding: the joint lags its torque by -h z; z evolves along the load steps of the pose,
  dz = (1 - z sgn(dtau)) dtau / s (Dahl), which integrates to an exponential on each monotonic part

branch is +1 while the turnbuckle tightens and -1 while it slackens.
"""

import numpy as np

from pipeline.base.arrays import Array, Ints, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import clamp, rated_torque, turning
from pipeline.machine.robot import Robot

_SLIDES_OVER = {"sliding, tight": 0.05, "sliding": 0.15, "sliding, wide": 0.4}
"""Sliding scale s of each form, as a fraction of the rated torque [1]."""

_FORMS = ("held", "left over", "bow", *_SLIDES_OVER)


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint, in each form."""
    return tuple(_effect(robot, joint, form) for joint in turning(robot) for form in _FORMS)


def _effect(robot: Robot, joint: int, form: str) -> Elastic:
    rated = rated_torque(robot, joint)

    def response(loaded: Loaded, torque: Array) -> Array:
        pulls = loaded.pulls
        branch, sense = pulls.branch[:, None], np.tanh(torque / (0.03 * rated))
        if form in _SLIDES_OVER:
            return -slid(pulls.pose, pulls.repeat, torque[:, 0] / (_SLIDES_OVER[form] * rated))
        if form == "held":
            return -sense * branch
        if form == "left over":
            return sense * (branch < 0)
        part = np.abs(torque) / np.maximum(_peak(pulls.pose, np.abs(torque)), 1e-9)
        return np.asarray(4 * (part - part**2) * sense * (branch < 0))

    return Elastic(
        name="joint_hysteresis",
        noun="hysteresis",
        place="joint",
        where=joint,
        form=form,
        tolerance=0.2,
        parameters=(
            Parameter(f"f_{joint}", "rad", 5e-5, 0.0, np.inf, "hysteresis of {joint}, each way"),
        ),
        signature=f"at the same reading joint {joint} stands elsewhere while unloading than while "
        "loading",
        needs="the same loads on the way up and on the way down, branch recorded in loads.csv"
        + clamp(robot, joint),
        source="Coulomb friction, Masing's rule, Dahl's model; 50 urad is an estimate",
        carrier=(joint,),
        response=response,
    )


def slid(pose: Ints, repeat: Ints, torque: Array) -> Array:
    """Dahl's z after each pull, integrated in order within each pose from rest, shape (m, 1).

    Torques are given in units of s.
    """
    z, before = np.zeros(len(pose)), np.full(len(pose), -1)
    order = np.lexsort((repeat, pose))
    follows = pose[order[1:]] == pose[order[:-1]]
    before[order[1:][follows]] = order[:-1][follows]
    ready = before < 0
    start, last = np.zeros(len(pose)), np.zeros(len(pose))
    done = np.zeros(len(pose), dtype=bool)
    while ready.any():
        way = np.sign(torque[ready] - last[ready])
        z[ready] = way + (start[ready] - way) * np.exp(-np.abs(torque[ready] - last[ready]))
        done |= ready
        ready = (before >= 0) & ~done & done[before]
        start[ready], last[ready] = z[before[ready]], torque[before[ready]]
    return z[:, None]


def _peak(pose: Ints, torque: Array) -> Array:
    """Largest torque within the pose of each pull, shape (m, 1)."""
    _, number = np.unique(pose, return_inverse=True)
    peak = np.zeros(number.max(initial=0) + 1)
    np.maximum.at(peak, number, torque[:, 0])
    return peak[number][:, None]
