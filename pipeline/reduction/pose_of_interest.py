"""The pose and force at which the user wants a good prediction, Eqs. (12), (13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot
from pipeline.reduction.settings import AskedPose


@dataclass(frozen=True, eq=False)
class PoseOfInterest:
    """The user's test pose.

    Attributes:
        q: Joint values [m] or [rad], shape (n,).
        force: [N], F_b, shape (3,).
        stated: False when campaign.toml has no [test_pose] and a measured pose stands in.
    """

    q: Array
    force: Array
    stated: bool


def place_of_interest(stated: AskedPose | None, robot: Robot, pulls: Pulls) -> PoseOfInterest:
    """The campaign's test pose, or its strongest pull where campaign.toml has none.

    Raises:
        InputError: The test pose has another number of joints than the robot.
    """
    if stated is None:
        strongest = int(np.argmax(np.linalg.norm(pulls.force, axis=1)))
        return PoseOfInterest(pulls.q[strongest], pulls.force[strongest], stated=False)
    return PoseOfInterest(stated.joint_values(robot), np.array(stated.force_n), stated=True)
