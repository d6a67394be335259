"""A joint whose zero changed in mid-campaign: mastered anew, a brake that slipped, a gear replaced.

From some pose on joint j stands d_j from where its log has it, before that it does not. Of every
joint and every change in the order of time the column -Z_j of the poses before stands beside all
that is estimated: with e = y - D x, V its covariance and C that of x,

    T = g^2 / (N - h' C h),   g = sum d' V^-1 e,  N = sum d' V^-1 d,  h = sum D' V^-1 d

over the poses before, so that all of them are sums that run along the poses. What changed at one
joint widens the errors of all joints at all poses where nobody looks for it: T is added to twice
the log likelihood of the likeliest cell of each size of these errors, and the largest sum counts.
The table that is estimated beside it is that of the robot as it stands at the end.
"""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.geometry.roughness import Cells
from pipeline.geometry.unloaded import PoseRows, Unloaded, ZeroChange

_SIDES = 3
"""Poses on either side of a change, at least [1]: two poses stand off by themselves too easily."""

_SEEN = 25.0
"""Twice the log of the ratio of likelihoods from which on changes are asked about at all [1]: five
standard uncertainties."""


def places(zeros: Unloaded) -> int:
    """Changes in time that a joint may have, at least one."""
    return max(zeros.poses - 2 * _SIDES + 1, 1)


def changes(zeros: Unloaded, rows: PoseRows, found: Cells) -> tuple[ZeroChange, ...]:
    """Of each joint the likeliest change beside all that was found; none where none is seen."""
    order = _in_time(zeros)
    if len(order) < 2 * _SIDES:
        return ()
    T = _gains(rows, found.unrefined or found, order)[_SIDES - 1 : len(order) - _SIDES]
    if T.max() < _SEEN:
        return ()
    number = zeros.pulls.pose[np.unique(zeros.pose, return_index=True)[1]]
    return tuple(
        ZeroChange(
            joint,
            tuple(sorted(number[order[: k + _SIDES]].tolist())),
            int(number[order[k + _SIDES]]),
        )
        for joint, k in enumerate(T.argmax(axis=0).tolist(), 1)
    )


def _gains(rows: PoseRows, found: Cells, order: Ints) -> Array:
    """Twice the log of the ratio of likelihoods of a change behind each of the poses, (p, n)."""
    sizes = np.unique(found.transmission)
    best = [np.flatnonzero(found.transmission == size) for size in sizes]
    likeliest = [int(mine[np.argmax(found.log[mine])]) for mine in best]
    each = [2 * found.log[cell] + _drops(rows, found, cell, order) for cell in likeliest]
    return np.asarray(np.max(each, axis=0) - 2 * found.log.max())


def _drops(rows: PoseRows, found: Cells, cell: int, order: Ints) -> Array:
    """T of a change behind each of the poses, in time, shape (p, n)."""
    W = linear.whitening(rows.cov(found.transmission[cell]))
    Z, D = W @ rows.Z, W @ rows.D
    e = np.einsum("pij,pj->pi", W, rows.y) - D @ found.x[cell]
    g = np.cumsum(np.einsum("prn,pr->pn", Z, e)[order], axis=0)
    N = np.cumsum(np.einsum("prn,prn->pn", Z, Z)[order], axis=0)
    h = np.cumsum(np.einsum("prn,prk->pnk", Z, D)[order], axis=0)
    left = N - np.einsum("pnk,kl,pnl->pn", h, found.cov[cell], h)
    seen = left > linear.LEFT * np.maximum(N, np.finfo(float).tiny)
    return np.where(seen, g**2 / np.where(seen, left, 1.0), 0.0)


def _in_time(zeros: Unloaded) -> Ints:
    """Poses 0..p-1 as they were read, or as they are numbered where no time is known."""
    first = np.unique(zeros.pose, return_index=True)[1]
    time = zeros.pulls.time_zero[first]
    when = time if np.isfinite(time).all() else zeros.pulls.pose[first]
    return np.argsort(when, kind="stable")
