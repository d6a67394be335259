"""Bad readings of the two reflectors on the chain, by their distance and by their direction.

Both use deleted residuals: a pull is tested against the fit to the others, by Student's t (F for
the two coordinates of a direction), for the largest of all pulls. A chain may stretch with
the force and be hung differently in every pose; its direction may change with the force, as the
load point yields, or with its inverse, as a chain sags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy import stats

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms

_TESTS = 2
"""Distance and direction share the probability of a false alarm."""

_FEWEST = 8
"""Fewer pulls do not determine the scatter of a chain."""

_HUNG = 0.05
"""Lengths that differ between poses below this p: the chain was hung differently."""

_MATTERS_RAD = 5e-4
"""A direction off by less turns no force by more than the readings of a scale scatter."""

_SHORT_M = 1.5e-4
"""A distance off by less is not reported."""

_APART = 5.0
"""A direction stands out this much also against the other pulls of its own pose."""

_DECIDES = 3.0
"""One end stands out this much more than the other, or neither is named alone."""


@dataclass(frozen=True, eq=False)
class _Chain(Locked):
    """Both ends of the chain in every pull, in the tracker's frame.

    Attributes:
        group: Group of each pull, shape (m,).
        pose: Its pose, shape (m,).
        force: Reading of the scale [N], NaN unknown, shape (m,).
        ends: Where both ends were read [m], shape (m, 2, 3).
        std: Standard uncertainty of their distance; 1 for all where none is stated, shape (m,).
        stated: Whether one is.
    """

    group: Strings
    pose: Ints
    force: Array
    ends: Array
    std: Array
    stated: bool


@dataclass(frozen=True)
class _Off:
    """The pull that stands out most: its number, by how much in sigma and size, and its p-value."""

    pull: int
    sigmas: float
    size: float
    p_value: float


def chain_outlier(case: Case) -> list[Mistake]:
    """The pull whose chain reflectors are unlike those of the other pulls, and which of the two."""
    chain = _read(case)
    if len(chain.group) < _FEWEST:
        return []
    names = case.settings.naming.chain
    off = _distance(chain)
    if off is not None:
        told = (
            f"{names[0]} and {names[1]} are {1e3 * off.size:.2f} mm farther apart or nearer than "
            f"in the other pulls, {off.sigmas:.1f} standard deviations"
        )
        return [_finding(chain, off, names, told, off.size)]
    off = _direction(chain)
    if off is not None:
        told = (
            f"the chain points {1e3 * off.size:.2f} mrad away from where the other pulls of the "
            f"pose put it, {off.sigmas:.1f} standard deviations"
        )
        return [_finding(chain, off, names, told, off.size * float(np.median(_length(chain))))]
    return []


def _read(case: Case) -> _Chain:
    near, far = case.settings.naming.chain
    rows = case.readings[case.readings["state"] == "loaded"].drop_duplicates(["group", "target"])
    ends = [rows[rows["target"] == name].set_index("group") for name in (near, far)]
    both = ends[0].index.intersection(ends[1].index)
    ends = [end.loc[both] for end in ends]
    at = np.stack([end[XYZ].to_numpy(float) for end in ends], axis=1)
    loads = case.loads.drop_duplicates(["pose", "repeat"]).set_index(["pose", "repeat"])["force_n"]
    key = pd.MultiIndex.from_frame(ends[0][["pose", "repeat"]].astype("int64"))
    u = at[:, 1] - at[:, 0]
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    C = covariance.matrices(ends[0]) + covariance.matrices(ends[1])
    std = np.sqrt(np.einsum("mi,mij,mj->m", u, C, u))
    stated = bool(np.isfinite(std).all())
    return _Chain(
        group=both.to_numpy(object),
        pose=ends[0]["pose"].to_numpy(np.int64),
        force=loads.reindex(key).to_numpy(float),
        ends=at,
        std=std if stated else np.ones(len(std)),
        stated=stated,
    )


def _length(chain: _Chain) -> Array:
    return np.asarray(np.linalg.norm(chain.ends[:, 1] - chain.ends[:, 0], axis=1))


def _distance(chain: _Chain) -> _Off | None:
    """By the distance of the ends, the same in all pulls but for what the chain stretches.

    (|Pl2 - Pl1| - median) / u = (a + b f) / u + e, f the force over the largest, u [m] the standard
    uncertainty; one a for all pulls or, where an F test calls for it, one to a pose. The p-value of
    t is two-sided and multiplied by the number of pulls.
    """
    y = _length(chain)
    y = (y - np.median(y)) / chain.std
    force = np.nan_to_num(chain.force / np.nanmax(np.abs(chain.force), initial=1.0))
    least = 1.0 if chain.stated else 1e-30
    every = np.ones((len(y), 1))
    poses = np.unique(chain.pose)[None, :] == chain.pose[:, None]
    common, hung = (np.hstack([one, force[:, None]]) / chain.std[:, None] for one in (every, poses))
    best = int(np.argmax(_deleted(common, y, least)[0]))
    kept = np.arange(len(y)) != best
    per_pose = _differs(common[kept], hung[kept], y[kept])
    X = hung if per_pose else common
    t, size, dof = _deleted(X, y, least)
    if per_pose:
        best = _of_its_pose(chain, t, _deleted(common, y, least)[0])
    p = 2 * len(y) * float(stats.t.sf(t[best], dof))
    size_m = float(size[best] * chain.std[best])
    if p > alarms.READING / _TESTS or size_m < _SHORT_M:
        return None
    return _Off(best, float(t[best]), size_m, p)


def _of_its_pose(chain: _Chain, t: Array, among_all: Array) -> int:
    """The pull that stands out; where a pose has two, each as much, that unlike all others."""
    level = np.flatnonzero(t > 0.999 * t.max())
    return int(level[np.argmax(among_all[level])])


def _differs(plain: Array, richer: Array, y: Array) -> bool:
    """Whether a richer model fits beyond chance (F test)."""
    (rest, rank), (less, more) = (_rest(X, y) for X in (plain, richer))
    dof = len(y) - more
    if more <= rank or dof < 1:
        return False
    F = (rest - less) / (more - rank) / max(less / dof, 1e-30)
    return bool(stats.f.sf(F, more - rank, dof) < _HUNG)


def _rest(X: Array, y: Array) -> tuple[float, int]:
    Q = linear.orthonormal(X)
    left = y - Q @ (Q.T @ y)
    return float(left @ left), Q.shape[1]


def _deleted(X: Array, y: Array, least: float) -> tuple[Array, Array, int]:
    """Deleted residuals over their standard deviation, their sizes, and degrees of freedom.

    t_i = r_i / (s_(i) sqrt(1 - h_i)), size r_i / (1 - h_i), h_i = (Q Q')_ii the leverage, and
    s_(i)^2 = (r' r - r_i^2 / (1 - h_i)) / (m - k - 1): externally studentised residuals (Cook and
    Weisberg, Residuals and Influence in Regression, 1982), absolute values. A certificate may be
    modest, chance no outlier: the variance is `least` at least.
    """
    Q = linear.orthonormal(X)
    free = 1 - np.sum(Q**2, axis=1)
    left = y - Q @ (Q.T @ y)
    dof = len(y) - Q.shape[1] - 1
    usable = free > 1e-6
    drop = np.where(usable, left**2 / np.where(usable, free, 1.0), 0.0)
    variance = np.maximum((left @ left - drop) / max(dof, 1), least)
    size = np.where(usable, np.abs(left) / np.where(usable, free, 1.0), 0.0)
    return np.sqrt(drop / variance), size, max(dof, 1)


def _direction(chain: _Chain) -> _Off | None:
    """By the direction against the other pulls of the pose, four or more of them."""
    laws = [_turns(chain, course) for course in (chain.force, 1 / chain.force)]
    if any(len(law[0]) == 0 for law in laws):
        return None
    pulls = laws[0][0]
    p = np.max([law[1] for law in laws], axis=0)
    apart = np.min([law[2] for law in laws], axis=0)
    size = np.min([law[3] for law in laws], axis=0)
    sigmas = np.min([law[4] for law in laws], axis=0)
    best = int(np.argmin(p))
    sure = len(pulls) * p[best] < alarms.READING / _TESTS and apart[best] > _APART
    if not sure or size[best] < _MATTERS_RAD:
        return None
    return _Off(
        int(pulls[best]), float(sigmas[best]), float(size[best]), float(len(pulls) * p[best])
    )


def _turns(chain: _Chain, course: Array) -> tuple[Ints, Array, Array, Array, Array]:
    """Deleted residuals of directions beside a straight course in each pose.

    u = a_p + b_p x + e for the unit vectors u of pose p in the tracker's frame, x the course over
    its largest. drop_i = |r_i|^2 / (1 - h_i), F = (drop_i / 2) / ((sum_p |r_p|^2 - drop_i) / dof)
    with 2 and dof = 2 sum_p (m_p - 2) - 2 degrees of freedom: two coordinates to a direction.

    Args:
        chain: The chain.
        course: What directions are straight in, shape (m,).

    Returns:
        Pulls, p-values, size over what the other pulls of the pose leave, size [rad], sigmas.
    """
    d = chain.ends[:, 1] - chain.ends[:, 0]
    u = d / np.linalg.norm(d, axis=1, keepdims=True)
    pulls, drops, rests, sizes = [], [], [], []
    for pose in np.unique(chain.pose):
        rows = np.flatnonzero((chain.pose == pose) & np.isfinite(course))
        if len(rows) < 4:
            continue
        x = course[rows] / np.abs(course[rows]).max()
        Q = linear.orthonormal(np.column_stack([np.ones(len(rows)), x]))
        free = np.maximum(1 - np.sum(Q**2, axis=1), 1e-6)
        left = u[rows] - Q @ (Q.T @ u[rows])
        drop = np.sum(left**2, axis=1) / free
        pulls.append(rows)
        drops.append(drop)
        rests.append((np.sum(left**2) - drop) / (2 * max(len(rows) - Q.shape[1] - 1, 1)))
        sizes.append(np.sqrt(drop / free))
    if not pulls:
        return np.zeros(0, np.int64), *np.zeros((4, 0))
    drop, rest = np.concatenate(drops), np.concatenate(rests)
    dof = 2 * sum(len(rows) - 2 for rows in pulls) - 2
    whole = sum(
        float(rest_[0] * 2 * max(len(rows) - 3, 1) + drop_[0])
        for rows, rest_, drop_ in zip(pulls, rests, drops, strict=True)
    )
    F = drop / 2 / np.maximum((whole - drop) / dof, 1e-30)
    apart = np.sqrt(drop / 2 / np.maximum(rest, 1e-30))
    p = stats.f.sf(F, 2, dof)
    return np.concatenate(pulls), p, apart, np.concatenate(sizes), np.sqrt(2 * F)


def _end(chain: _Chain, pull: int) -> tuple[int, float] | None:
    """Which end is not where the other pulls of the pose put it, and by how much [m].

    None where that is open.
    """
    same = (chain.pose == chain.pose[pull]) & np.isfinite(chain.force)
    others = same & (np.arange(len(same)) != pull)
    if others.sum() < 3 or not same[pull]:
        return None
    X = np.column_stack([np.ones(len(same)), chain.force])
    miss = [_unlike(X, chain.ends[:, k], others, pull) for k in (0, 1)]
    if max(miss) < _DECIDES * min(miss):
        return None
    return int(np.argmax(miss)), max(miss)


def _unlike(X: Array, at: Array, others: Bools, pull: int) -> float:
    """How far a reading is from the straight course of the others [m]."""
    course = linear.least_squares(X[others], at[others])
    return float(np.linalg.norm(at[pull] - X[pull] @ course))


def _finding(chain: _Chain, off: _Off, names: Sequence[str], told: str, size: float) -> Mistake:
    group, end = str(chain.group[off.pull]), _end(chain, off.pull)
    which = f"{names[0]}-{names[1]}"
    if end is not None:
        which, size = names[end[0]], end[1]
        told = f"{told}: {which} is {1e3 * size:.2f} mm off"
    return Mistake(
        name="outlier",
        where=f"{group}/{which}",
        evidence=f"in {group} {told}",
        correction=f"computed again without the pull of {group}",
        before=off.sigmas,
        after=0.0,
        unit="sigma",
        size=size,
        size_unit="m",
        p_value=min(off.p_value, 1.0),
        correct=partial(_without_group, group=group),
    )


def _without_group(case: Case, group: str) -> Case:
    rows = case.readings
    return replace(case, readings=rows[rows["group"] != group])


FAULT = Fault("outlier", "outlying reading", lambda asked: chain_outlier(asked.case))
