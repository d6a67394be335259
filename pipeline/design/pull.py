"""Choose the pull of a robot from its payload and its compliance."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.machine.robot.configuration import configure, torque
from pipeline.machine.robot.mdh import Robot
from pipeline.machine.robot.rating import relative

REFERENCE_PULL_N = 3000.0
"""Largest pull of the reference set-up [N], at a KR500 with a payload of 480 kg."""

_MOST_M = 0.01
"""Maximum displacement of the load point under the largest pull [m]. The linear equations neglect
about d^2/L of a deflection d of an arm of reach L, which for 10 mm at 3 m is the scatter of one
reading of a tracker, 0.03 mm."""


def share(robot: Robot, load_point: Array) -> float:
    """Appropriate pull of a robot relative to the reference set-up [1].

    In proportion to its payload, and limited to the pull that moves the load point by `_MOST_M`; 1
    if its file states neither payload nor stiffness.

    Args:
        robot: The robot.
        load_point: Point of application, flange frame [m], shape (3,).
    """
    found = relative(robot)
    if all(joint.stiffness or joint.stiffness_range for joint in robot.joints):
        found = min(found, _MOST_M / (REFERENCE_PULL_N * _softness(robot, load_point)))
    return found


def _softness(robot: Robot, load_point: Array) -> float:
    """Compliance of the load point in its most compliant direction [m/N], rms over poses.

    Poses are random within the limits; joints without limits make one turn, or slide a metre either
    way.
    """
    free = np.where(robot.prismatic, 1.0, np.pi)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(robot.lower, -free), np.minimum(robot.upper, free), (256, robot.n))
    at = configure(robot, q)
    points = at.points(load_point[None])[:, 0]
    J = np.stack([torque(at.twists, points, np.tile(e, (len(q), 1))) for e in np.eye(3)], axis=1)
    compliance = np.einsum("mik,k,mjk->mij", J, robot.nominal_compliance, J)
    return linear.rms(linear.directions(compliance)[0][:, -1])


def round_pull(value: float) -> float:
    """Round a pull to two significant digits, as people set it."""
    return float(f"{value:.2g}")


def branches(steps: Array) -> Array:
    """Sense in which the turnbuckle is last turned before each step: +1 tightened, -1 slackened.

    Args:
        steps: Load steps [N]; negative if the first step is reached from above by slackening.
    """
    out = np.sign(steps)
    for k in range(1, len(steps)):
        if steps[k] > 0:
            out[k] = np.sign(steps[k] - abs(steps[k - 1])) or out[k - 1]
    return out
