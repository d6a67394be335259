"""Bad readings of the two reflectors on the chain, by their distance and by their direction.

Both set a pull free beside the fit to all (see `system.beside`): deleted residuals, externally
studentised (Cook and Weisberg, Residuals and Influence in Regression, 1982), for the largest of all
pulls. A chain may stretch with the force and be hung differently in every pose; its direction may
change with the force, as the load point yields, with its inverse, as a chain sags, or as the
targets on the effector show that the load point moves, in proportion to the force or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.faults.fault import Fault
from pipeline.faults.labels import unlike
from pipeline.faults.mistake import Mistake, apart, of_group, outlying
from pipeline.readers.known import GROSS_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms
from pipeline.system.beside import Base, Beside
from pipeline.system.blocks import Blocks

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
        give: How far the effector has moved in the pose, as its targets show [m], NaN unknown,
            shape (m,).
    """

    group: Strings
    pose: Ints
    force: Array
    ends: Array
    std: Array
    stated: bool
    give: Array


@dataclass(frozen=True)
class _Off:
    """The pull that stands out most.

    Attributes:
        pull: Its number.
        sigmas: By how many standard deviations.
        axes: Coordinates that these are of.
        size: By how much, in metres or radians.
        p_value: Of that, by chance, among all pulls; None where chance plays no part.
    """

    pull: int
    sigmas: float
    axes: int
    size: float
    p_value: float | None


@dataclass(frozen=True, eq=False)
class _Turned(Locked):
    """Directions against the other pulls of their poses, by the law that accuses each least.

    Attributes:
        pull: Numbers of the pulls, shape (n,).
        p: p-value of each, shape (n,).
        apart: How far off it is over what the other pulls of the pose leave, shape (n,).
        size: How far off it is [rad], shape (n,).
        sigmas: The same in standard deviations, shape (n,).
    """

    pull: Ints
    p: Array
    apart: Array
    size: Array
    sigmas: Array


def chain_outlier(case: Case) -> list[Mistake]:
    """The pull whose chain reflectors are unlike those of the other pulls, and which of the two.

    Distance and direction are tested each by itself; of two pulls the one that chance puts so far
    off less often is told. Once it stands out by its distance, what its direction adds counts, too.
    """
    chain = _read(case)
    if len(chain.group) < _FEWEST:
        return []
    near, away = _distance(chain), _direction(chain)
    if near is not None and (away is None or not _rarer(away, near)):
        off, told = _with_direction(chain, near, case.settings.naming.chain)
    elif away is not None:
        off = replace(away, size=away.size * float(np.median(_length(chain))))
        told = _told_direction(away.size, away.sigmas)
    else:
        return []
    end = _end(chain, off.pull)
    return [_finding(case, chain, off, case.settings.naming.chain, told, off.size, end)]


def _rarer(one: _Off, other: _Off) -> bool:
    """Whether chance puts one pull so far off less often than another."""
    return one.pull != other.pull and (one.p_value, -one.sigmas) < (other.p_value, -other.sigmas)


def _with_direction(chain: _Chain, near: _Off, names: Sequence[str]) -> tuple[_Off, str]:
    """What stands out by its distance, with what its direction adds, and what is told of both.

    |e|^2 = e_u^2 + e_v^2 + e_w^2 in standard deviations, u along the chain, v and w across it.
    """
    told = f"{names[0]} and {names[1]} are {1e3 * near.size:.2f} mm farther apart or nearer than "
    told += f"in the other pulls, {apart(near.sigmas)}"
    turned = _turned(chain)
    at = np.flatnonzero(turned.pull == near.pull)
    if not len(at):
        return near, told
    turn, sigmas = float(turned.size[at[0]]), float(turned.sigmas[at[0]])
    size = float(np.hypot(near.size, turn * np.median(_length(chain))))
    both = replace(near, sigmas=float(np.hypot(near.sigmas, sigmas)), axes=3, size=size)
    return both, f"{told}, and {_told_direction(turn, sigmas)}"


def _told_direction(size: float, sigmas: float) -> str:
    return (
        f"the chain points {1e3 * size:.2f} mrad away from where the other pulls of the pose "
        f"put it, {apart(sigmas)}"
    )


def chain_gross(case: Case) -> list[Mistake]:
    """The pull whose chain reflectors are apart as no chain stretches, nor is hung (`unlike`).

    Found before the scale's readings are judged: such a pull points anywhere.
    """
    chain = _read(case)
    if len(chain.group) < _FEWEST:
        return []
    lengths = unlike(case).reindex(chain.group)
    away, gross = lengths["away"].to_numpy(float), lengths["gross"].to_numpy(bool)
    if not gross.any():
        return []
    best = int(np.argmax(np.where(gross, away, 0.0)))
    names = case.settings.naming.chain
    told = f"{names[0]} and {names[1]} are {1e3 * away[best]:.0f} mm farther apart or nearer than "
    told += "in the other pulls"
    sigmas = float(away[best] / chain.std[best])
    off = _Off(best, sigmas, 1, float(away[best]), None)
    miss = _misses(chain, best) or (0.0, 0.0)
    if min(miss) > GROSS_M:
        return [
            _finding(case, chain, off, names, told, size, (k, size)) for k, size in enumerate(miss)
        ]
    return [_finding(case, chain, off, names, told, off.size, _end(chain, best))]


@lru_cache(maxsize=1)
def _read(case: Case) -> _Chain:
    """The chain of a case: two tests ask, one after the other."""
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
        give=_give(case, both.to_numpy(object), ends[0]["pose"].to_numpy(np.int64)),
    )


def _give(case: Case, group: Strings, pose: Ints) -> Array:
    """How far the effector has moved in each pull of its pose [m], NaN unknown, shape (m,).

    d = v' (x - mean x): x the centre of the targets that were read in all pulls of the pose, v the
    direction along which these lie apart most.
    """
    rows = case.readings[case.readings["state"] == "loaded"]
    rows = rows[rows["target"].isin(case.settings.naming.measured)]
    rows = rows.drop_duplicates(["group", "target"]).set_index(["target", "group"])[XYZ]
    names = rows.index.unique("target")
    at = np.array([rows.loc[name].reindex(group).to_numpy(float) for name in names])
    out = np.full(len(group), np.nan)
    for one in np.unique(pose):
        here = np.flatnonzero(pose == one)
        whole = at[:, here][np.isfinite(at[:, here]).all(axis=(1, 2))] if len(at) else at
        if len(whole):
            centre = whole.mean(axis=0) - whole.mean(axis=(0, 1))
            out[here] = centre @ linear.principal(centre)[2][0]
    return out


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
    every = np.ones((len(y), 1))
    poses = np.unique(chain.pose)[None, :] == chain.pose[:, None]
    common, hung = (np.hstack([one, force[:, None]]) / chain.std[:, None] for one in (every, poses))
    off = _each(common, y)
    best = int(np.argmax(off.drop))
    kept = np.arange(len(y)) != best
    # an F test of the lengths by pose, beside one length
    if Base.of(common[kept], y[kept]).beside_all(hung[kept]).p() < _HUNG:
        among_all, off = off.drop, _each(hung, y)
        level = np.flatnonzero(off.drop >= 0.998 * off.drop.max())
        best = int(level[np.argmax(among_all[level])])  # of two in a pose that unlike all others
    variance = off.variance(1.0) if chain.stated else off.variance()
    p = len(y) * float(off.p(variance)[best])
    size_m = float(np.abs(off.size[best, 0]) * chain.std[best])
    if p > alarms.READING / _TESTS or size_m < _SHORT_M:
        return None
    return _Off(best, float(np.sqrt(off.drop / variance)[best]), 1, size_m, p)


def _each(X: Array, y: Array) -> Beside:
    """Every row free beside the columns X: deleted residuals."""
    return Base.of(X, y).beside(np.eye(len(y))[None, :, :, None]).of_block(0)


def _turned(chain: _Chain) -> _Turned:
    """Directions against the other pulls of the pose, four or more of them.

    The law of the course that accuses a pull less is believed.
    """
    index = np.unique(chain.pose, return_inverse=True)[1]
    known = np.isfinite(chain.force)
    pulls = np.flatnonzero(known & (np.bincount(index, known)[index] >= 4))
    if not len(pulls):
        return _Turned(pulls, *np.zeros((4, 0)))
    seen = np.bincount(index, ~np.isfinite(chain.give))[index] == 0
    courses = (chain.force, 1 / chain.force, np.where(seen, chain.give, chain.force))
    laws = [_turns(chain, pulls, course) for course in courses]
    p, apart, size, sigmas = (np.stack([law[i] for law in laws]) for i in range(4))
    return _Turned(pulls, p.max(axis=0), apart.min(axis=0), size.min(axis=0), sigmas.min(axis=0))


def _direction(chain: _Chain) -> _Off | None:
    """The pull whose direction stands out most."""
    turned = _turned(chain)
    if not len(turned.pull):
        return None
    best = int(np.argmin(turned.p))
    chance = len(turned.pull) * float(turned.p[best])
    sure = chance < alarms.READING / _TESTS and turned.apart[best] > _APART
    if not sure or turned.size[best] < _MATTERS_RAD:
        return None
    sigmas, size = float(turned.sigmas[best]), float(turned.size[best])
    return _Off(int(turned.pull[best]), sigmas, 2, size, chance)


def _turns(chain: _Chain, pulls: Ints, course: Array) -> tuple[Array, Array, Array, Array]:
    """Every pull's direction free beside a straight course in each pose.

    w = a_p + b_p x + e for the two coordinates w [rad] across the mean direction of pose p, in the
    tracker's frame, x the course over its largest.

    Args:
        chain: The chain.
        pulls: Pulls that are tested, of poses with four at least, shape (n,).
        course: What directions are straight in, shape (m,).

    Returns:
        p-values, size over what the other pulls of the pose leave, size [rad], sigmas, all (n,).
    """
    u = (chain.ends[:, 1] - chain.ends[:, 0])[pulls]
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    poses = Blocks.of(chain.pose[pulls])
    mean = poses.padded(u).sum(axis=1)
    across = linear.principal(mean[:, None])[2][:, 1:]
    x = np.abs(poses.padded(course[pulls])).max(axis=1)[poses.index]
    X = np.stack([np.ones(len(pulls)), course[pulls] / x], axis=1)
    w = np.einsum("nij,nj->ni", across[poses.index], u)
    rows = np.einsum("nk,ij->nikj", X, np.eye(2)).reshape(2 * len(pulls), -1)
    base = Base.of(rows, w.ravel(), np.repeat(poses.index, 2), own=True)
    p, s = base.blocks.shape
    one = np.eye(s).reshape(s, s // 2, 2)
    off = base.beside(np.broadcast_to(one, (p, *one.shape)) * base.blocks.there[:, :, None, None])
    own = np.sum(base.left**2, axis=1)[:, None]
    left = 2 * np.maximum(poses.count - 3, 1)[:, None]
    apart = np.sqrt(off.drop / 2 / np.maximum((own - off.drop) / left, 1e-30))
    size = np.linalg.norm(off.size, axis=2)
    sigmas = np.sqrt(off.drop / off.variance())
    p_value = off.p()
    return tuple(poses.rows(one) for one in (p_value, apart, size, sigmas))  # type: ignore[return-value]


def _end(chain: _Chain, pull: int) -> tuple[int, float] | None:
    """Which end is not where the other pulls of the pose put it, and by how much [m].

    None where that is open.
    """
    miss = _misses(chain, pull)
    if miss is None or max(miss) < _DECIDES * min(miss):
        return None
    return int(np.argmax(miss)), max(miss)


def _misses(chain: _Chain, pull: int) -> tuple[float, float] | None:
    """How far both ends are from where the other pulls of the pose put them [m], three at least."""
    same = (chain.pose == chain.pose[pull]) & np.isfinite(chain.force)
    others = same & (np.arange(len(same)) != pull)
    if others.sum() < 3 or not same[pull]:
        return None
    X = np.column_stack([np.ones(len(same)), chain.force])
    near, far = (_unlike(X, chain.ends[:, k], others, pull) for k in (0, 1))
    return near, far


def _unlike(X: Array, at: Array, others: Bools, pull: int) -> float:
    """How far a reading is from the straight course of the others [m]."""
    course = linear.least_squares(X[others], at[others])
    return float(np.linalg.norm(at[pull] - X[pull] @ course))


def _finding(
    case: Case,
    chain: _Chain,
    off: _Off,
    names: Sequence[str],
    told: str,
    size: float,
    end: tuple[int, float] | None,
) -> Mistake:
    group, which = str(chain.group[off.pull]), f"{names[0]}-{names[1]}"
    if end is not None:
        which, size = names[end[0]], end[1]
        told = f"{told}: {which} is {1e3 * size:.2f} mm off"
    at = of_group(case, group, names if end is None else {which})
    return outlying(
        f"{group}/{which}",
        f"in {group} ({', '.join(at)}) {told}",
        f"recomputed without the pull of {group}",
        before=off.sigmas,
        axes=off.axes,
        size=size,
        p_value=off.p_value,
        correct=partial(_without_group, group=group),
        at=at,
    )


def _without_group(case: Case, group: str) -> Case:
    rows = case.readings
    return replace(case, readings=rows[rows["group"] != group])


GROSS = Fault("outlier", "outlying reading", lambda asked: chain_gross(asked.case))

FAULT = Fault("outlier", "outlying reading", lambda asked: chain_outlier(asked.case))
