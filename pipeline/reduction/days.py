"""Day-to-day scatter: how the deflection of a pose differs when it is measured on another day.

What changes from day to day (clamping of the chain, temperature of gears, the set-up of the
instrument) is common to all pulls of a day and shows in no repeat within it. It is modelled as a
relative error s e_k of all displacements of day k, e_k independent with unit variance. For a pose
measured on days i and j

    g = sum delta_i . (f delta_j - delta_i) / sum |delta_i|^2,       var g = u^2 + 2 s^2,

over its targets and pulls of similar force, f the ratio of the forces and u^2 the variance due to
the readings; pulls of a pose share the error of their zero. s is estimated by moments (DerSimonian
and Laird, Controlled Clinical Trials 7 (1986) 177). Homogeneity is tested by sum w g^2 / u^2: the
differences between n days of a pose have n - 1 degrees of freedom, w that number over their pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import special
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.reduction.measured import Measured

_GAP_S = 6 * 3600.0
"""Minimum pause between two pulls that begins another day [s]: shifts are shorter, nights
longer."""

_SAME_POSE = 2e-3
"""Maximum difference of joint values of one pose [m or rad]: controllers repeat far better."""

_SAME_FORCE, _SAME_WAY = 0.03, 5e-3
"""Maximum relative difference [1] and angle [rad] between the forces of similar pulls."""


@dataclass(frozen=True, eq=False)
class _Days(Locked):
    """Day-to-day scatter from repeated poses.

    Attributes:
        day: Day of each pull, counted from 0, shape (m,).
        poses: Number of pairs of poses measured on two days.
        relative: Standard uncertainty of the displacements of a day, relative [1].
        p_value: Probability of differences this large from the noise of the readings alone.
    """

    day: Ints
    poses: int
    relative: float
    p_value: float


def days(data: Measured) -> _Days | None:
    """The day-to-day scatter; None where no pose was repeated on another day, or no noise is known.

    Args:
        data: The campaign; its noise in metres.
    """
    if not (data.noise_stated or data.found_m) or not np.isfinite(data.pulls.time).all():
        return None
    day = _numbered(data.pulls.time)
    if not day.any():
        return None
    found = {pair: one for pair in _pairs(data, day) if (one := _gain(data, *pair)) is not None}
    if not found:
        return None
    g, variance = np.array(list(found.values())).T
    square = g**2 / variance
    excess = float(square.sum() - len(g)) / float(np.sum(1 / variance))
    relative = float(np.sqrt(max(excess, 0.0) / 2))
    share = _independent(np.array(list(found)))
    return _Days(day, len(g), relative, float(special.chdtrc(share.sum(), share @ square)))


def _independent(pairs: Ints) -> Array:
    """Degrees of freedom of each pair, (n - 1) / pairs of the n days of its pose, shape (p,)."""
    poses, index = np.unique(pairs, return_inverse=True)
    one, other = index.reshape(pairs.shape).T
    graph = coo_array((np.ones(len(pairs)), (one, other)), shape=(len(poses), len(poses)))
    count, group = connected_components(graph, directed=False)
    days_of, pairs_of = np.bincount(group, minlength=count), np.bincount(group[one])
    return np.asarray(((days_of - 1) / pairs_of)[group[one]])


def with_days(data: Measured) -> Measured:
    """The campaign with its day-to-day scatter as a source of error, where it can be estimated."""
    found = days(data)
    return data if found is None else replace(data, day=found.day, day_rel=found.relative)


def _numbered(time: Array) -> Ints:
    """Day of each pull, from the pauses between them."""
    order = np.argsort(time, kind="stable")
    later = np.concatenate([[False], np.diff(time[order]) > _GAP_S])
    day = np.empty(len(time), np.int64)
    day[order] = np.cumsum(later)
    return day


def _pairs(data: Measured, day: Ints) -> Iterator[tuple[int, int]]:
    """Pairs of pose numbers with equal joint values on different days."""
    poses, first = np.unique(data.pulls.pose, return_index=True)
    near = cKDTree(data.pulls.q[first]).query_pairs(_SAME_POSE, p=np.inf)
    for a, b in sorted(near):
        if day[first[a]] != day[first[b]]:
            yield int(poses[a]), int(poses[b])


def _gain(data: Measured, one: int, other: int) -> tuple[float, float] | None:
    """The g of a pose on two days and its variance u^2; None without pulls of similar force."""
    above = below = variance = 0.0
    shared: dict[tuple[int, int], tuple[Array, Array]] = {}  # by zero and target
    for i, j in _alike(data, one, other):
        ratio = float(np.linalg.norm(data.pulls.force[i]) / np.linalg.norm(data.pulls.force[j]))
        mine, theirs = (_by_target(data, pull) for pull in (i, j))
        scale = 0.0
        for target in mine.keys() & theirs.keys():
            row, other = mine[target], theirs[target]
            a, b = data.delta[row], data.delta[other]
            above += float(a @ (ratio * b - a))
            scale += float(a @ a)
            variance += float(a @ (data.loaded_cov[row] + ratio**2 * data.loaded_cov[other]) @ a)
            for k, factor in ((row, 1.0), (other, ratio)):  # pulls of a pose share their zero
                key = int(data.zero[k]), target
                moved = shared.get(key, (np.zeros(3), data.zero_cov[k]))[0] + factor * a
                shared[key] = moved, data.zero_cov[k]
        below += scale
        read = sum((data.reading_std[k] / np.linalg.norm(data.pulls.force[k])) ** 2 for k in (i, j))
        variance += scale**2 * float(read)
    variance += sum(float(moved @ cov @ moved) for moved, cov in shared.values())
    return None if below <= 0 or variance <= 0 else (above / below, variance / below**2)


def _alike(data: Measured, one: int, other: int) -> Iterator[tuple[int, int]]:
    """Pairs of pulls of two poses with similar force and direction."""
    force = data.pulls.force
    for i in np.flatnonzero(data.pulls.pose == one).tolist():
        for j in np.flatnonzero(data.pulls.pose == other).tolist():
            sizes = np.linalg.norm(force[[i, j]], axis=1)
            turn = np.linalg.norm(force[i] / sizes[0] - force[j] / sizes[1])
            if abs(sizes[0] / sizes[1] - 1) < _SAME_FORCE and turn < _SAME_WAY:
                yield i, j
                break


def _by_target(data: Measured, pull: int) -> dict[int, int]:
    """Row of each target of a pull."""
    return {int(data.target[row]): int(row) for row in np.flatnonzero(data.pull == pull)}
