"""The pulls of a plan: load steps, branches, approaches and times, as the operator will do them."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.design.information import Experiment, station
from pipeline.design.pull import branches
from pipeline.machine.effect import Pulls

READING_S, TIGHTEN_S, POSE_S = 8.0, 60.0, 120.0
"""Duration of one reading, of tightening or slackening the chain, of driving to the next pose
[s]."""
_FEWEST = 3
"""Minimum number of poses of a plan, as in the paper."""


def starts(pulls: Array, targets: int = 3) -> Array:
    """Time of the first zero of each pose [s], from the number of pulls at each, (m,)."""
    zero, pull = _lasting(targets)
    spent = POSE_S + 2 * zero + TIGHTEN_S + pull * np.asarray(pulls, dtype=float)
    return np.concatenate([[0.0], np.cumsum(spent)[:-1]])


def counts(
    spent_s: float, pose_s: float, pull_s: float, steps: int, zero: float, poses: int | None
) -> tuple[int, int]:
    """Number of poses, and of passes through the load steps at each, in a given time; 0: no pull.

    Pulls of a pose share the error of its zero. With `zero` the variance of that error over that of
    a pull's own reading, k = sqrt(pose_s / (zero pull_s)) pulls at a pose give the most information
    per hour (Cochran, Sampling Techniques, 1977, 10.6); where they share nothing, as many as the
    smallest number of poses leaves time for.

    Args:
        spent_s: Time for everything [s].
        pose_s: Duration of a pose without its pulls [s].
        pull_s: Duration of a pull [s].
        steps: Load steps.
        zero: Variance of the zero over that of a pull's reading.
        poses: Number of poses, where it is given.
    """
    if poses is None:
        best = np.sqrt(pose_s / (zero * pull_s)) if zero else np.inf
        most = (spent_s / _FEWEST - pose_s) / pull_s
        pulls = steps * max(1, round(min(best, max(most, 0.0)) / steps))
        poses = max(_FEWEST, int(spent_s // (pose_s + pulls * pull_s)))
    return poses, max(0, int((spent_s / poses - pose_s) // (steps * pull_s)))


def _lasting(targets: int) -> tuple[float, float]:
    """Duration of a zero, and of a pull with both ends of the chain [s]."""
    return targets * READING_S, TIGHTEN_S + (targets + 2) * READING_S


def pulls_at(
    experiment: Experiment, q: Array, anchor: Array, approach: Array, steps: Array, start_s: Array
) -> Pulls:
    """One row per pull of poses with the same load steps.

    Args:
        experiment: Robot and load point.
        q: Joint values [m] or [rad], shape (m, n).
        anchor: Anchor [m], shape (3,) or (m, 3).
        approach: Direction from which the carriage came, +1 or -1, shape (m,).
        steps: Load steps [N], as in `branches`, shape (s,).
        start_s: Time of each pose's first zero [s], shape (m,).
    """
    m, s = len(q), len(steps)
    zero, pull = _lasting(len(experiment.points))
    after = 0.0 if experiment.scatter.zero == 1 else zero + s * pull + TIGHTEN_S  # a second zero
    direction = station(experiment, q, anchor).direction.T
    return Pulls(
        pose=np.repeat(np.arange(1, m + 1), s),
        repeat=np.tile(np.arange(1, s + 1), m),
        q=np.repeat(q, s, axis=0),
        force=(np.abs(steps)[:, None] * direction[:, None]).reshape(-1, 3),
        branch=np.tile(branches(steps), m),
        approach=np.repeat(approach, s),
        time=(start_s[:, None] + pull * np.arange(1, s + 1)).ravel(),
        time_zero=np.repeat(start_s + (zero - READING_S + after) / 2, s),
    )


def crossed(direction: Array, order: Array) -> Array:
    """Approaches crossed with the pull along the rail: both directions for either sign of u_y.

    Args:
        direction: Of the pull at each pose, shape (m, 3).
        order: Position of each pose along the rail, shape (m,).
    """
    approach = np.ones(len(direction))
    for side in (direction[:, 1] >= 0, direction[:, 1] < 0):
        rows = np.flatnonzero(side)
        rows = rows[np.argsort(order[rows], kind="stable")]
        approach[rows[1::2]] = -1.0
    return approach
