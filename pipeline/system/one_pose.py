"""Detect targets that were computed from one measured pose where the campaign does not say so.

Such targets keep their mutual distances to rounding, as no instrument reads two points: differences
between them are no repeats and contain no noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Bools
from pipeline.base.linear import rms
from pipeline.machine.robot import configure
from pipeline.machine.six import radius
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.reduction.digits import rounding
from pipeline.reduction.measured import STILL_M, Measured
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import tells_a_pose
from pipeline.system import alarms
from pipeline.system.estimate import identify

_OFF_RAD = 1e-3
"""Maximum angle by which a robot's links may deviate from its table [rad]: as delivered."""

_FEWEST = 12
"""Minimum number of distance changes for a decision."""


@dataclass(frozen=True)
class OnePose:
    """Evidence that targets were computed from one pose.

    Attributes:
        kept_m: Change of their distances between states, rms [m].
        left_m: Residual of their displacements after the joint springs, standard deviation [m].
    """

    kept_m: float
    left_m: float


def as_measured(case: Case, reduced: Reduced) -> tuple[Case, Reduced, OnePose | None]:
    """The campaign with its targets treated as those of one pose where they must be."""
    found = one_pose(case, reduced.data)
    if found is None:
        return case, reduced, None
    instrument = case.settings.instrument.model_copy(update={"measures": "poses"})
    settings = case.settings.model_copy(update={"instrument": instrument})
    case = replace(case, settings=settings)
    return case, bring(case), found


def one_pose(case: Case, data: Measured) -> OnePose | None:
    """Whether the targets of each state come from one measured pose; None where they need not.

    The distances change by less than any reading could, rms s_k / l_k < 1, while the residual r of
    the joint springs is impossibly large relative to the limits, of rms l:
    P[F(n_r, n_s) > (r / l)^2] is below `alarms.READING`, with n_r the residual degrees of freedom
    and n_s the number of changes. Data without any scatter keep both small. The limit l_k of a
    change includes `STILL_M`, the rounding of two readings, the second order of the rotation in its
    pull, and, where the positions of the targets are unknown, the effect of `_OFF_RAD`. An outlier
    does not rotate any other pull.

    Args:
        case: The campaign.
        data: Its measurements, as points.
    """
    if case.tool.six or not tells_a_pose(case.tool.points):
        return None
    change, turned = _changes(case, data)
    if change.size < _FEWEST:
        return None
    lever = _OFF_RAD * turned if np.isnan(data.unloaded).any() else 0.0 * turned
    bow = turned**2 / (2 * radius(case.tool.points))
    digits = 2 * rounding(case.readings[XYZ].to_numpy(float))
    limit = np.sqrt(STILL_M**2 + digits**2 + lever**2 + bow**2)
    if rms(change / limit) > 1:
        return None
    left = identify(case.cell, data, case.robot.nominal_compliance)[1]
    r = left.residual_std_m
    chance = special.fdtrc(left.dof, change.size, (r / rms(limit)) ** 2) if left.dof > 0 else 1.0
    return OnePose(rms(change), r) if chance < alarms.READING else None


def _changes(case: Case, data: Measured) -> tuple[Array, Array]:
    """Change of each distance between two targets in each pull, and the rotation in each pull.

    Returns:
        Changes, shape (pairs, m), and rotations, as rms of the displacements about their mean,
        (m,), both in metres.
    """
    t = len(case.tool.points)
    rows: Bools = (np.bincount(data.pull, minlength=len(data.pulls)) == t)[data.pull]
    moved = data.delta[rows].reshape(-1, t, 3)
    pull = data.pull[rows][::t]
    if not len(pull):
        return np.zeros((0, 0)), np.zeros(0)
    here = configure(case.robot, data.pulls.q[pull])
    seen = data.unloaded[rows].reshape(-1, t, 3)
    at = np.where(np.isnan(seen), here.points(case.tool.points), seen)
    change = [
        np.linalg.norm(at[:, i] + moved[:, i] - at[:, j] - moved[:, j], axis=1)
        - np.linalg.norm(at[:, i] - at[:, j], axis=1)
        for i, j in combinations(range(t), 2)
    ]
    about = moved - moved.mean(axis=1, keepdims=True)
    return np.array(change), np.sqrt(np.mean(about**2, axis=(1, 2)))
