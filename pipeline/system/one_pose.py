"""Targets that were computed from one measured pose, found where nobody says so.

Such targets keep their distances to rounding, and no instrument reads two points so: what changes
between them is no repeat of anything and tells no noise.
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
"""How far a robot's links may point from where its table has them [rad]: as delivered."""

_FEWEST = 12
"""Fewer changes of distances show nothing."""


@dataclass(frozen=True)
class OnePose:
    """What shows that targets were computed from one pose.

    Attributes:
        kept_m: How far their distances change between states, rms [m].
        left_m: What the joint springs leave of their displacements, rms [m].
    """

    kept_m: float
    left_m: float


def as_measured(case: Case, reduced: Reduced) -> tuple[Case, Reduced, OnePose | None]:
    """The campaign with its targets taken for those of one pose where they must be."""
    found = one_pose(case, reduced.data)
    if found is None:
        return case, reduced, None
    instrument = case.settings.instrument.model_copy(update={"measures": "poses"})
    settings = case.settings.model_copy(update={"instrument": instrument})
    case = replace(case, settings=settings)
    return case, bring(case), found


def one_pose(case: Case, data: Measured) -> OnePose | None:
    """Whether the targets of each state come from one measured pose; None where they need not.

    Their distances change by less than anything that is read, rms s_k / l_k < 1, and what the joint
    springs leave, r, is impossible beside the limits, of rms l: P[F(n_r, n_s) > (r / l)^2] below
    `alarms.READING`, n_r and n_s the numbers of residuals left and of changes. Data without any
    scatter keep both small. The limit l_k of a change holds `STILL_M`, the rounding of two
    readings, the second order of the turn in its pull, and where it is unknown where the targets
    stand what `_OFF_RAD` does. One reading that is far off turns no other pull.

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
    """How each distance of two targets changes in each pull, and how far they turn there.

    Returns:
        Changes, shape (pairs, m), and turns, the displacements about their mean, rms, (m,) [m].
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
