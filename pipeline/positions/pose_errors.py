"""Joints, or a rail, that err from pose to pose by more than usual, which no law explains.

Every estimate includes an error of each joint at each pose. That of joint j over the usual one,
r_j, is compared with robots as they are:

    z_j = ln(r_j / r) / sqrt(w^2 + 1 / (2 d_j)),   d_j = sum over poses of (s_j^2 z' V^-1 z)^2

with r and w the median of r_j and its spread, s_j the estimate, z the motion of the targets by the
joint, V the covariance of a pose, and d_j the degrees of freedom that s_j is known from.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from pipeline.base.arrays import Array
from pipeline.geometry.unloaded import START
from pipeline.machine.robot import configure
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import unwhitened
from pipeline.positions.study import Study
from pipeline.system import alarms

_MEDIAN, _SPREAD = 0.55, 0.41
"""Median of the error of a joint at a pose over the usual one [1], and standard deviation of its
natural logarithm: nine well determined joints of two real arms (`ur10_ipa`, `ur5_tsinghua`: 0.38 to
1.26)."""

_BESIDE = 2.0
"""The same from which on identified causes do not explain the readings, where it counts [1]."""

_SHARE = 0.25
"""Minimum fraction of the squared motion of the targets by errors at a pose that such errors cause
beside identified causes, or those of a carriage beside joints [1]."""

_BED = (1e-4, 2e-4)
"""Initial standard deviations of a carriage's error at a pose, positions [m] and angles [rad]."""


class PoseErrors(NamedTuple):
    """What errs from pose to pose beyond all laws.

    Attributes:
        joints: Joints that err unusually, from 0, the one that moves the targets most first.
        carriage: Standard deviations of errors of a carriage at a pose along and about x, y, z of
            F_b [m], [rad], (6,), that would explain what is left as well; None without a rail, or
            if they explain little of it.
        on_rail: Whether joints cannot explain it, so that it is the carriage.
    """

    joints: tuple[int, ...]
    carriage: Array | None = None
    on_rail: bool = False


def unusual(found: Study) -> PoseErrors | None:
    """What errs from pose to pose by more than usual; None if nothing does."""
    final = found.final
    slides, s = final.mechanism.table.prismatic, final.scatter.joints
    ratio = s / np.where(slides, START[True], START[False])
    far, beside = _chances(final, ratio) < alarms.ERRING, ratio > _BESIDE
    moves = _lever(final)[: len(s)] * s**2
    if (found.causes or found.laws) and moves[beside].sum() >= _SHARE * moves.sum():
        far |= beside
    if not far.any():
        return None
    joints = [j for j in np.argsort(-moves).tolist() if far[j]]
    return PoseErrors(tuple(joints), *_of_carriage(final))


def _chances(found: Calibration, ratio: Array) -> Array:
    """Probability of such an error in any joint of a robot as they are, (n,)."""
    n, rows = len(ratio), found.rows
    Z = rows.W @ found.linear.Z[:, found.linear.used, :n]
    seen = np.sum(Z**2, axis=1) * found.scatter.joints**2
    dof = np.maximum(np.sum(seen**2, axis=0), np.finfo(float).tiny)
    off = np.log(np.maximum(ratio, np.finfo(float).tiny) / _MEDIAN)
    return np.asarray(n * ndtr(-off / np.sqrt(_SPREAD**2 + 0.5 / dof)))


def _lever(found: Calibration) -> Array:
    """Mean squared motion of the targets by each joint, and by a bed, (n,) or (n + 6,)."""
    Z = found.linear.Z
    shifts = Z.reshape(len(Z), -1, 6, Z.shape[2])[:, :, :3]
    return np.asarray(np.mean(np.sum(shifts**2, axis=2), axis=(0, 1)))


def _of_carriage(found: Calibration) -> tuple[Array | None, bool]:
    """Errors of a carriage (6,) beside usual ones of joints, and whether it must be the carriage.

    What moves along the rail may be its drive, and what turns about the axis of joint 1 that joint:
    the other motions decide, if they move the targets more than the joints of the arm do, both as
    estimated beside them and as usual.
    """
    if not found.wanted.bed:
        return None, False
    robot, lever = found.mechanism.table, _lever(found)
    usual = _MEDIAN * np.where(robot.prismatic, START[True], START[False])
    shared = replace(found.scatter, joints=np.append(usual, np.repeat(_BED, 3)))
    rows, e = found.rows, found.rows.y - found.rows.along(found.solution.x)
    shared, _ = shared.better(found.linear, unwhitened(rows, e, rows.variance(found.solution)))
    moves = lever * shared.joints**2
    carriage = moves[robot.n :]
    if carriage.sum() < _SHARE * moves.sum():
        return None, False
    axes = configure(found.mechanism.robot, found.readings.q[:1]).axes[0, :2, :, 2]
    arm = moves[2 : robot.n].sum(), (lever[1 : robot.n] * usual[1:] ** 2).sum()
    own = carriage @ (1 - axes.ravel() ** 2)
    return shared.joints[robot.n :], bool(own > max(arm))
