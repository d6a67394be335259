"""How hard to pull a robot: by what it carries, and by how far it would bend."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.machine.robot.configuration import configure, torque
from pipeline.machine.robot.mdh import Robot
from pipeline.machine.robot.rating import relative

REFERENCE_PULL_N = 3000.0
"""The hardest pull of the reference set-up [N], at a KR500 that carries 480 kg."""

_MOST_M = 0.01
"""How far the hardest pull should move the load point [m]. The equations are linear: of a
deflection d of an arm that reaches L they leave out about d^2/L, which for 10 mm at 3 m is the
scatter of one reading of a tracker, 0.03 mm."""


def share(robot: Robot, load_point: Array) -> float:
    """How hard to pull a robot, relative to the reference set-up.

    As much less as it carries less, and no harder than what moves the load point by `_MOST_M`; as
    hard as there where its file says neither payload nor stiffness.

    Args:
        robot: The robot.
        load_point: Where it is pulled, flange frame [m], shape (3,).
    """
    found = relative(robot)
    if all(joint.stiffness or joint.stiffness_range for joint in robot.joints):
        found = min(found, _MOST_M / (REFERENCE_PULL_N * _softness(robot, load_point)))
    return found


def _softness(robot: Robot, load_point: Array) -> float:
    """Deflection of the load point along a pull [m/N], in the direction that bends most, rms.

    Over poses within the limits; joints without them turn once, and slide a metre.
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
    """A pull as people set it: two digits."""
    return float(f"{value:.2g}")
