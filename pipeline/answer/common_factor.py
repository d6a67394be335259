"""A common factor of all stiffnesses relative to the robot file: the fact, and the sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.answer.contract import CommonFactor, Stiffness
from pipeline.base.quantities import plain
from pipeline.machine.robot import Robot
from pipeline.system.specimen import SURE, common, has_stated_stiffness

_FEWEST = 2
"""Minimum number of joints for a common factor; the ratio of a single joint may have other
reasons."""


def common_factor(robot: Robot, joints: Sequence[Stiffness]) -> CommonFactor | None:
    """The common factor of all stiffnesses, if it exceeds the variation between specimens.

    Args:
        robot: The robot, with the stiffnesses stated in its file.
        joints: The stiffnesses of the answer.
    """
    both = [
        (float(one.value), one.std or 0.0, joint)
        for one, joint in zip(joints, robot.joints, strict=True)
        if one.identifiable and one.value and has_stated_stiffness(joint)
    ]
    if len(both) < _FEWEST:
        return None
    value, std, known = zip(*both, strict=True)
    found = common(np.array(value), np.array(std), known)
    if found.beyond < SURE:
        return None
    return CommonFactor(
        value=float(np.exp(found.g)), ci95=found.ci95, joints=len(both), probability=found.beyond
    )


def told_factor(fact: CommonFactor | None) -> list[str]:
    """A sentence on the common factor; none without one."""
    if fact is None:
        return []
    low, high = (plain(end, 2) for end in fact.ci95)
    return [
        f"The stiffnesses are about {plain(fact.value, 2)} times ({low} to {high}) those of the "
        "robot file, all of them alike: check the unit of the force column and the scale, or the "
        "stiffnesses in the file; a factor common to all forces shows in no residual."
    ]
