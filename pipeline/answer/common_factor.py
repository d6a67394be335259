"""One factor on all stiffnesses against those of the robot file: the fact, and the sentence.

A factor common to all forces is one on all stiffnesses and on nothing else, so no residual shows
it: only what is known of the robot can. With y_j = log(k_j / k_nominal,j), of a range counted from
its nearer end,

    y_j = g + d_j + e_j,    d_j ~ N(0, tau^2),    e_j ~ N(0, u_j^2),

g the common factor, d_j what one joint has of its own as delivered, u_j = u(k_j) / k_j. How large
tau is the joints say, and `_OWN` beforehand; g given all of it is Student's t about the weighed
mean (Gelman et al., Bayesian Data Analysis, 2013, 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from pipeline.answer.contract import CommonFactor, Stiffness
from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.machine.robot import Joint, Robot

_SPECIMENS = 1.5
"""Robots of one type differ by less than this in all joints alike [1], a scale read in another unit
by 2.2 (lb and kg) or more: halfway between 1 and 2.2, by ratios."""

_OWN = 0.25
"""Logarithm by which single joints scatter about the file's stiffness as delivered [1], and the
number of joints that this assumption counts as."""
_OWN_JOINTS = 4.0

_SURE = 0.95
"""Probability from which a factor beyond `_SPECIMENS` is told [1]: that of a 95 % interval."""

_FEWEST = 2
"""One joint alone may be another one than the file has."""


def common_factor(robot: Robot, joints: Sequence[Stiffness]) -> CommonFactor | None:
    """The factor that all stiffnesses have in common, where it is more than a specimen's.

    Args:
        robot: What its file says of each joint.
        joints: The stiffnesses that the answer gives.
    """
    both = [
        (_off(float(one.value), joint), (one.std or 0.0) / float(one.value))
        for one, joint in zip(joints, robot.joints, strict=True)
        if one.identifiable and one.value and (joint.stiffness or joint.stiffness_range)
    ]
    if len(both) < _FEWEST:
        return None
    g, std, dof = _posterior(*np.array(both).T)
    beyond = float(special.stdtr(dof, (abs(g) - np.log(_SPECIMENS)) / std))
    if beyond < _SURE:
        return None
    low, high = np.exp(g + np.array([-1, 1]) * special.stdtrit(dof, 0.975) * std).tolist()
    return CommonFactor(
        value=float(np.exp(g)), ci95=(low, high), joints=len(both), probability=beyond
    )


def _off(value: float, joint: Joint) -> float:
    """Logarithm of a stiffness over what the file states, 0 within a range."""
    low, high = joint.stiffness_range or (joint.typical_stiffness, joint.typical_stiffness)
    return float(np.log(value / np.clip(value, low, high)))


def _posterior(y: Array, u: Array) -> tuple[float, float, float]:
    """Mean, scale and degrees of freedom of g, from y_j and u_j, shape (n,)."""
    weight = 1 / (1 + (u / _OWN) ** 2)
    g = float(weight @ y / weight.sum())
    dof = _OWN_JOINTS + len(y) - 1
    variance = (_OWN_JOINTS * _OWN**2 + float(weight @ (y - g) ** 2)) / dof
    return g, float(np.sqrt(variance / weight.sum())), dof


def told_factor(fact: CommonFactor | None) -> list[str]:
    """A sentence where the stiffnesses are as many times those of the file."""
    if fact is None:
        return []
    low, high = (plain(end, 2) for end in fact.ci95)
    return [
        f"The stiffnesses are about {plain(fact.value, 2)} times ({low} to {high}) those of the "
        "robot file, all of them alike: check the unit of the force column and the scale, or the "
        "stiffnesses in the file; a factor common to all forces shows in no residual."
    ]
