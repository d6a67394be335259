"""What changed in mid-campaign: a joint mastered anew, a brake that slipped, a foot bumped.

From some pose on joint j stands d_j from where its log has it, before that it does not, or the
other way round; or the whole robot stood where F_b has it, and since then it does not. Of every
joint, of the robot's six motions, and every change in the order of time the columns d of the poses
that are off, -Z_j of a joint, stand beside all that is estimated: with e = y - D x, V its
covariance and C that of x,

    T = g' (N - h' C h)^+ g,   g = sum d' V^-1 e,  N = sum d' V^-1 d,  h = sum D' V^-1 d

over these poses, so that all of them are sums that run along the poses. Nothing changed once where
the whole robot moving steadily, or as an instrument that warms up, has a larger T than every
change. What changed widens the errors of all joints at all poses where nobody looks for it: T is
added to twice the log likelihood of the likeliest cell of each size of these errors, and the
largest sum counts. The table that is estimated beside it is that of the robot as it stands at the
end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, compared
from pipeline.geometry.roughness import ScaleGrid
from pipeline.geometry.slipped import ShapeRows, slips
from pipeline.geometry.unloaded import MidChange, PoseRows, Unloaded
from pipeline.machine.effects.tracker_drift import LAWS

_SIDES = 2
"""Poses on either side of a change, at least [1]: a single one is a wrong row of the log."""

_SEEN = 5.0
"""Standard uncertainties from which on changes are asked about at all [1]."""


def places(zeros: Unloaded) -> int:
    """Places in time of a change, at least one."""
    return max(zeros.poses - 2 * _SIDES + 1, 1)


def changes(zeros: Unloaded, rows: PoseRows, found: ScaleGrid) -> tuple[MidChange, ...]:
    """Of each joint, the robot and each target the likeliest change beside all that was found.

    None where none is seen.
    """
    order = _in_time(zeros)
    if len(order) < 2 * _SIDES:
        return ()
    gains = _gains(zeros, rows, found.unrefined or found, order)
    T, what = gains[_SIDES - 1 : len(order) - _SIDES], _what(zeros)
    freedom = [one.unknowns for one in what]
    if gains[len(order) :, 0].max() >= T.max():
        return ()  # a smooth motion of the instrument, which is no change
    if special.chdtrc(freedom, T.max(axis=0)).min() > special.chdtrc(1, _SEEN**2):
        return ()
    likeliest = dict[tuple[int, int | None], int]()  # of both ways of a joint the likelier one
    for k in np.argsort(compared(T.max(axis=0)), kind="stable").tolist():
        likeliest[what[k].joint, what[k].target] = k
    places_of = T.argmax(axis=0)
    which = sorted(likeliest.values())
    return tuple(_at(zeros, what[k], order, int(places_of[k]) + _SIDES) for k in which)


def slipped(zeros: Unloaded, rows: PoseRows) -> dict[MidChange, float]:
    """Likeliest motion of each target on the effector, with its p-value by the shape alone.

    Empty where the shape is not read.
    """
    order, shape = _in_time(zeros), ShapeRows.of(zeros, rows)
    if shape is None or len(order) < 2 * _SIDES:
        return {}
    found = zip(*slips(shape, order, _SIDES), strict=True)
    return {_at(zeros, MidChange(0, (), 0, k), order, int(n)): p for k, (n, p) in enumerate(found)}


def _at(zeros: Unloaded, one: MidChange, order: Ints, before: int) -> MidChange:
    """A change behind some of the poses in time."""
    number = zeros.pulls.pose[np.unique(zeros.pose, return_index=True)[1]]
    first = tuple(sorted(number[order[:before]].tolist()))
    return replace(one, before=first, since=int(number[order[before]]))


def _what(zeros: Unloaded) -> list[MidChange]:
    """The robot as a whole, its joints, each both ways, and targets measured by themselves."""
    targets = range(len(zeros.tool.points) if zeros.turned is None else 0)
    joints = range(1, zeros.robot.n + 1)
    ways = [MidChange(j, (), 0, slipped=late) for j in joints for late in (True, False)]
    return [MidChange(0, (), 0), *ways, *(MidChange(0, (), 0, t) for t in targets)]


def _gains(zeros: Unloaded, rows: PoseRows, found: ScaleGrid, order: Ints) -> Array:
    """Twice the log of the ratio of likelihoods of a change behind each of the poses.

    Then of each of `_courses`; in the order of `_what`, shape (p + c, k).
    """
    sizes = np.unique(found.transmission)
    best = [np.flatnonzero(found.transmission == size) for size in sizes]
    likeliest = [int(mine[np.argmax(found.log[mine])]) for mine in best]
    each = [2 * found.log[cell] + _drops(zeros, rows, found, cell, order) for cell in likeliest]
    return np.asarray(np.max(each, axis=0) - 2 * found.log.max())


def _drops(zeros: Unloaded, rows: PoseRows, found: ScaleGrid, cell: int, order: Ints) -> Array:
    """T of a change behind each of the poses, in time, then of each course, shape (p + c, k)."""
    W = linear.whitening(rows.cov(found.transmission[cell]))
    Z, D = W @ rows.Z, W @ rows.D
    e = np.einsum("pij,pj->pi", W, rows.y) - D @ found.x[cell]
    where = zeros.columns
    whole = np.concatenate([D[:, :, where.shift], D[:, :, where.loose]], axis=2)
    T, courses = [], _courses(zeros, order)
    for one in _what(zeros):
        d = Z[:, :, [one.joint - 1]] if one.joint else whole
        if one.target is not None:
            d = D[:, :, where.tool][:, :, 3 * one.target : 3 * one.target + 3]
        each = d.swapaxes(1, 2) @ e[..., None], d.swapaxes(1, 2) @ d, d.swapaxes(1, 2) @ D
        sums = [np.cumsum(part[order], axis=0) for part in each]
        since = (part if one.early else part[-1] - part for part in sums)
        smooth = zip(each, (courses, courses**2, courses), strict=True)
        along = (np.tensordot(s, own[order], 1) for own, s in smooth)
        g, N, h = (np.concatenate(both) for both in zip(since, along, strict=True))
        left = N - h @ found.cov[cell] @ np.swapaxes(h, 1, 2)
        inverse = linear.left(left, np.einsum("pii->pi", N))[0]
        T.append((g.swapaxes(1, 2) @ inverse @ g)[:, 0, 0])
    return np.maximum(np.stack(T, axis=1), 0.0)


def _courses(zeros: Unloaded, order: Ints) -> Array:
    """Motions of an instrument at the poses in time, shape (c, p); only a steady one by numbers."""
    when, timed = _when(zeros)
    since = when[order] - when[order[0]]
    return np.array([law(since) for law in LAWS.values()]) if timed else (since / since[-1])[None]


def _in_time(zeros: Unloaded) -> Ints:
    """Poses 0..p-1 as they were read, or as they are numbered where no time is known."""
    return np.argsort(_when(zeros)[0], kind="stable")


def _when(zeros: Unloaded) -> tuple[Array, bool]:
    """Time of each pose's zero [s], or its number where not all are known; and which of both."""
    first = np.unique(zeros.pose, return_index=True)[1]
    time = zeros.pulls.time_zero[first]
    timed = bool(np.isfinite(time).all())
    return (time if timed else zeros.pulls.pose[first].astype(float)), timed
