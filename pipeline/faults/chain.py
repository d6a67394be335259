"""Bad readings of the two reflectors on the chain, by their distance and by their direction.

Both tests free one pull in the fit to all (see `system.score_tests`): deleted residuals, externally
studentised (Cook and Weisberg, Residuals and Influence in Regression, 1982), for the largest of all
pulls. A chain may stretch with the force, and be hung differently in every pose and towards every
anchor. Its direction may change with the force, as the load point yields; with its inverse, as a
chain sags; or with the motion of the load point that the targets on the effector show, whether or
not proportional to the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.sparse.csgraph import connected_components

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.quantities import plain, with_std
from pipeline.faults.exchanged_pulls import odd_forces
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.labels import anchors, unlike
from pipeline.faults.mistake import Mistake, apart, as_read, of_group, outlying
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms
from pipeline.system.blocks import Blocks
from pipeline.system.score_tests import Base, ScoreTests

_TESTS = 2
"""Number of tests that share the false-alarm rate: distance and direction."""

_FEWEST = 8
"""Minimum number of pulls that determine the scatter of a chain."""

_HUNG = 0.05
"""P-value below which lengths differ between poses because the chain was hung differently [1]."""

_MATTERS_RAD = 5e-4
"""Minimum error of a direction that is reported [rad]; a smaller one turns no force by more than
the scatter of a scale."""

_SHORT_M = 1.5e-4
"""Minimum error of a distance that is reported [m]."""

_YIELDS_M = 0.01
"""Motion of the load point between two pulls of a pose that no robot exceeds [m]: if both ends of
the chain moved farther, it was pulled towards another anchor."""

_STANDS = 0.25
"""Motion of a far end that stands, over that of the near one, along the chain [1]: it is none, and
that of a chain which follows is as large."""

_APART = 5.0
"""Minimum ratio of an outlying direction to the residuals of the other pulls of its pose [1]."""

_DECIDES = 3.0
"""Minimum ratio of the errors of the two ends for one to be named alone [1]."""


@dataclass(frozen=True, eq=False)
class _Chain(Locked):
    """Both ends of the chain in every pull, in the tracker's frame.

    Attributes:
        group: Group of each pull, shape (m,).
        pose: Its pose, shape (m,).
        force: Reading of the scale [N], NaN where unknown, shape (m,).
        ends: Readings of both ends [m], shape (m, 2, 3).
        std: Standard uncertainty of their distance [m]; 1 for all where none is stated, shape (m,).
        stated: Whether one is stated.
        give: Motion of the effector in the pose according to its targets [m], NaN where unknown,
            shape (m,).
        free: Whether the length is one of the chain: the far end is no anchor, and in no pull were
            the ends fixed elsewhere along it, shape (m,).
    """

    group: Strings
    pose: Ints
    force: Array
    ends: Array
    std: Array
    stated: bool
    give: Array
    free: Bools

    @cached_property
    def towards(self) -> Ints:
        """Number of the set of each pull, shape (m,): pulls of one pose towards one anchor."""
        out = np.zeros(len(self.pose), np.int64)
        for pose in np.unique(self.pose):
            here = np.flatnonzero(self.pose == pose)
            number = connected_components(~_towards_another(self.ends[here]))[1]
            out[here] = number + out.max(initial=0) + 1
        return out

    @cached_property
    def stands(self) -> Bools:
        """Whether the far end stands in the hall in both pulls of a set, the near one yields, (m,).

        It is fixed elsewhere along the chain then, and two pulls show no course of their length.
        """
        out, away = np.zeros(len(self.pose), dtype=bool), _length(self)
        away = np.abs(away - np.median(away))
        for one in np.flatnonzero(np.bincount(self.towards) == 2):
            here = self.towards == one
            near, far = np.abs(np.diff(self.ends[here], axis=0)[0] @ _along(self.ends[here])[0])
            out |= here & (far < _STANDS * near) & (away[here].min() > _SHORT_M)
        return out


def _along(ends: Array) -> Array:
    """Unit vectors from the near ends to the far ones, (n, 2, 3) -> (n, 3)."""
    return linear.normed(ends[:, 1] - ends[:, 0])


def _towards_another(ends: Array) -> Bools:
    """Whether two pulls of a pose go towards different anchors, (n, 2, 3) -> (n, n).

    Both ends are then elsewhere, the far one by more than `GROSS_DISTANCE_M` and the near one by
    more than a robot yields, and the lines through them meet, at the load point; a bad reading
    moves one end, and two bad ones hardly leave lines that meet.

    distance of the lines = |(b - a) . n|,  n = u x v / |u x v|
    """
    apart = ends[:, None] - ends
    moved = np.linalg.norm(apart, axis=-1) > (_YIELDS_M, GROSS_DISTANCE_M)
    u = ends[:, 1] - ends[:, 0]
    n = np.cross(u[:, None], u)
    off = np.abs(np.sum(apart[:, :, 0] * n, axis=-1))
    return np.asarray(moved.all(axis=-1) & (off < GROSS_DISTANCE_M * np.linalg.norm(n, axis=-1)))


@dataclass(frozen=True)
class _Off:
    """The worst outlier among the pulls.

    Attributes:
        pull: Its index.
        sigmas: Its deviation in standard deviations.
        axes: Number of coordinates that this is computed from.
        size: Its deviation [m] or [rad].
        p_value: Probability of as large a deviation of any pull by chance; None for a gross error.
    """

    pull: int
    sigmas: float
    axes: int
    size: float
    p_value: float | None


def _outlier(asked: Screening) -> list[Mistake]:
    """As `chain_outlier`, of pulls whose displacements agree with their force.

    A chain stretches by its force, not by what was logged.
    """
    return chain_outlier(asked.case, frozenset(k for k, odd in odd_forces(asked).items() if odd))


def chain_outlier(case: Case, unknown: frozenset[tuple[int, int]] = frozenset()) -> list[Mistake]:
    """The pull whose chain reflectors are unlike those of the other pulls, and which of the two.

    Pulls (pose, repeat) of `unknown` forces are not compared.

    Distance and direction are tested separately; of two different pulls the one with the smaller
    p-value is named. If it is named for its distance, the evidence of its direction is added.
    """
    chain = _read(case, unknown)
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
    return [_finding(case, chain, off, told, _end(chain, off.pull))]


def _rarer(one: _Off, other: _Off) -> bool:
    """Whether one pull is another one than `other` and less probable by chance."""
    return one.pull != other.pull and (one.p_value, -one.sigmas) < (other.p_value, -other.sigmas)


def _with_direction(chain: _Chain, near: _Off, names: Sequence[str]) -> tuple[_Off, str]:
    """An outlier by distance with the evidence of its direction, and the description of both.

    |e|^2 = e_u^2 + e_v^2 + e_w^2 in standard deviations, u along the chain, v and w across it.
    """
    text = f"{names[0]} and {names[1]} are {1e3 * near.size:.2f} mm farther apart or nearer than "
    text += f"in the other pulls, {apart(near.sigmas)}"
    turned = _turned(chain)
    if near.pull not in turned.index:
        return near, text
    turn, sigmas = map(float, turned.loc[near.pull, ["size", "sigmas"]])
    size = float(np.hypot(near.size, turn * np.median(_length(chain))))
    both = replace(near, sigmas=float(np.hypot(near.sigmas, sigmas)), axes=3, size=size)
    return both, f"{text}, and {_told_direction(turn, sigmas)}"


def _told_direction(size: float, sigmas: float) -> str:
    off = with_std(1e3 * size, 1e3 * size / sigmas)
    return (
        f"the chain's direction deviates by {off} mrad from that of the other pulls of the pose, "
        f"{apart(sigmas)}"
    )


def chain_gross(case: Case) -> list[Mistake]:
    """The pull whose chain reflectors are at a distance that no chain can have (`unlike`).

    Tested before the scale's readings are judged, since such a pull points anywhere.
    """
    chain = _read(case)
    if len(chain.group) < _FEWEST:
        return []
    lengths = unlike(case).reindex(chain.group)
    away, gross = lengths["away"].to_numpy(float), lengths["gross"].to_numpy(bool) & ~chain.stands
    if not gross.any():
        return []
    best = int(np.argmax(np.where(gross, away, 0.0)))
    names = case.settings.naming.chain
    text = f"{names[0]} and {names[1]} are {1e3 * away[best]:.0f} mm farther apart or nearer than "
    text += "in the other pulls"
    off = _Off(best, float(away[best] / chain.std[best]), 1, float(away[best]), None)
    gone = _misses(chain, best)
    miss = np.zeros(2) if gone is None else np.linalg.norm(gone, axis=1)
    ends = enumerate(miss.tolist()) if miss.min() > GROSS_DISTANCE_M else [_end(chain, best)]
    return [_finding(case, chain, off, text, end) for end in ends]


def _read(case: Case, unknown: frozenset[tuple[int, int]] = frozenset()) -> _Chain:
    """The chain of a case as it was read, without the forces of some pulls, (pose, repeat)."""
    rows = as_read(case)
    rows = rows[rows["state"] == "loaded"].drop_duplicates(["group", "target"])
    ends = [rows[rows["target"] == name].set_index("group") for name in case.settings.naming.chain]
    both = ends[0].index.intersection(ends[1].index)
    ends = [end.loc[both] for end in ends]
    at = np.stack([end[XYZ].to_numpy(float) for end in ends], axis=1)
    loads = case.loads.drop_duplicates(["pose", "repeat"]).set_index(["pose", "repeat"])["force_n"]
    loads = loads[[key not in unknown for key in loads.index]]
    key = pd.MultiIndex.from_frame(ends[0][["pose", "repeat"]].astype("int64"))
    u = _along(at)
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
        free=~(anchors(case)["anchor"][both].to_numpy(bool) | unlike(case)["elsewhere"].any()),
    )


def _give(case: Case, group: Strings, pose: Ints) -> Array:
    """Motion of the effector in each pull of its pose [m], NaN where unknown, shape (m,).

    d = v' (x - mean x), with x the centre of the targets that were read in all pulls of the pose,
    and v the direction of largest variance.
    """
    rows = case.readings[case.readings["state"] == "loaded"]
    rows = rows[rows["target"].isin(case.settings.naming.measured)]
    pull = pd.Index(group).get_indexer(pd.Index(rows["group"]))
    rows, pull = rows[pull >= 0], pull[pull >= 0]
    target, names = pd.factorize(rows["target"])
    at = np.full((len(names), len(group), 3), np.nan)
    at[target[::-1], pull[::-1]] = rows[XYZ].to_numpy(float)[::-1]  # of several readings the first
    out = np.full(len(group), np.nan)
    for one in np.unique(pose):
        here = np.flatnonzero(pose == one)
        whole = at[:, here][np.isfinite(at[:, here]).all(axis=(1, 2))]
        if len(whole):
            centre = whole.mean(axis=0) - whole.mean(axis=(0, 1))
            out[here] = centre @ linear.principal(centre)[2][0]
    return out


def _length(chain: _Chain) -> Array:
    return np.asarray(np.linalg.norm(chain.ends[:, 1] - chain.ends[:, 0], axis=1))


def _distance(chain: _Chain) -> _Off | None:
    """The outlier by distance of the ends, which is constant except for the stretch of the chain.

    Of the pulls with a force whose far end is no anchor and stands nowhere.

    (|Pl2 - Pl1| - median) / u = (a + b f) / u + e, f the force over the largest, u [m] the standard
    uncertainty; one a and one b for all pulls or, if F tests call for it, one a for each pose and
    anchor, and one b: a far end that is fixed in the hall does not follow the robot as it yields.
    The p-value of t is two-sided and multiplied by the number of pulls.
    """
    at = np.flatnonzero(chain.free & ~chain.stands & np.isfinite(chain.force))
    if len(at) < _FEWEST:
        return None
    y, std = _length(chain)[at], chain.std[at]
    y = (y - np.median(y)) / std
    force = chain.force[at] / np.abs(chain.force[at]).max(initial=1.0)
    every = np.ones((len(y), 1))
    sets = chain.towards[at]
    sets = np.where(np.bincount(sets)[sets] > 1, sets, -chain.pose[at])
    alone = pd.Series(sets).groupby(chain.pose[at]).transform("max")  # hung as others of its pose
    sets = np.where(sets < 0, alone, sets)
    poses = np.unique(sets)[None, :] == sets[:, None]
    common, hung = (np.hstack([one, force[:, None]]) / std[:, None] for one in (every, poses))
    laws = common, hung, np.hstack([poses, poses * force[:, None]]) / std[:, None]
    off = among_all = _each(common, y)
    for law, wider in pairwise(laws):
        kept = np.arange(len(y)) != np.argmax(off.drop)
        # F test of the wider law against the other
        if Base.of(law[kept], y[kept]).beside_all(wider[kept]).p() >= _HUNG:
            break
        off = _each(wider, y)
    level = np.flatnonzero(off.drop >= 0.998 * off.drop.max())
    best = int(level[np.argmax(among_all.drop[level])])  # of two in one pose, the one unlike all
    variance = off.variance(1.0) if chain.stated else off.variance()
    p = len(y) * float(off.p(variance)[best])
    size_m = float(np.abs(off.size[best, 0]) * std[best])
    if p > alarms.READING / _TESTS or size_m < _SHORT_M:
        return None
    return _Off(int(at[best]), float(np.sqrt(off.drop / variance)[best]), 1, size_m, p)


def _each(X: Array, y: Array) -> ScoreTests:
    """Every row free given the columns X: deleted residuals."""
    return Base.of(X, y).beside(np.eye(len(y))[None, :, :, None]).of_block(0)


def _turned(chain: _Chain) -> pd.DataFrame:
    """Directions against the other pulls of the set, in sets of four pulls or more, by pull.

    For each pull the law of the course that is most favourable to it is used. Columns as of
    `_turns`: p, apart, size, sigmas.
    """
    index = chain.towards
    known = np.isfinite(chain.force)
    pulls = np.flatnonzero(known & (np.bincount(index, known)[index] >= 4))
    if not len(pulls):
        return pd.DataFrame()
    seen = np.bincount(index, ~np.isfinite(chain.give))[index] == 0
    courses = (chain.force, 1 / chain.force, np.where(seen, chain.give, chain.force))
    laws = [np.stack(_turns(chain, pulls, course), axis=1) for course in courses]
    found = pd.DataFrame(np.min(laws, axis=0), pulls, ["p", "apart", "size", "sigmas"])
    return found.assign(p=np.max(laws, axis=0)[:, 0])


def _direction(chain: _Chain) -> _Off | None:
    """The worst outlier by direction, of pulls whose chain has not swung about the load point."""
    turned = _turned(chain)
    order = turned.sort_values("p").index if len(turned) else turned.index
    at = next((pull for pull in order if not _swung(chain, pull)), None)
    if at is None:
        return None
    p, apart, size, sigmas = turned.loc[at, ["p", "apart", "size", "sigmas"]].tolist()
    if len(turned) * p >= alarms.READING / _TESTS or apart <= _APART or size < _MATTERS_RAD:
        return None
    return _Off(at, sigmas, 2, size, len(turned) * p)


def _swung(chain: _Chain, pull: int) -> bool:
    """Whether both ends deviate as by a turn about a point behind the near one: the load point.

    A chain that goes elsewhere, even by millimetres, does this; a bad reading leaves one end where
    it was, about which the direction turns.
    """
    off = _misses(chain, pull)
    if off is None:
        return False
    near, far = off - np.outer(off @ (u := _along(chain.ends[[pull]])[0]), u)
    turn = far - near
    behind = float(near @ turn / max(turn @ turn, linear.TINY))
    return behind > _BEHIND and bool(
        np.linalg.norm(near - behind * turn) < 0.5 * np.linalg.norm(near)
    )


_BEHIND = 0.1
"""Minimum distance of the point about which a chain turns behind its near end, over the distance of
the ends [1]; that of one bad reading is 0 or -1."""


def _turns(chain: _Chain, pulls: Ints, course: Array) -> tuple[Array, Array, Array, Array]:
    """Every pull's direction freed from a straight course in each set of pulls.

    w = a_p + b_p x + e for the two coordinates w [rad] across the mean direction of set p, in the
    tracker's frame, x the course over its largest value.

    Args:
        chain: The chain.
        pulls: Indices of the tested pulls, of sets of at least four, shape (n,).
        course: Variable in which directions are linear, shape (m,).

    Returns:
        P-values, size over the residuals of the other pulls of the set, size [rad], size in
            standard deviations, all (n,).
    """
    u = _along(chain.ends[pulls])
    sets = Blocks.of(chain.towards[pulls])
    across = linear.principal(sets.padded(u).sum(axis=1)[:, None])[2][:, 1:]
    x = np.abs(sets.padded(course[pulls])).max(axis=1)[sets.index]
    X = np.stack([np.ones(len(pulls)), course[pulls] / x], axis=1)
    w = np.einsum("nij,nj->ni", across[sets.index], u)
    rows = np.einsum("nk,ij->nikj", X, np.eye(2)).reshape(2 * len(pulls), -1)
    base = Base.of(rows, w.ravel(), np.repeat(sets.index, 2), own=True)
    p, s = base.blocks.shape
    one = np.eye(s).reshape(s, s // 2, 2)
    off = base.beside(np.broadcast_to(one, (p, *one.shape)) * base.blocks.there[:, :, None, None])
    own = np.sum(base.left**2, axis=1)[:, None]
    left = 2 * np.maximum(sets.count - 3, 1)[:, None]
    apart = np.sqrt(off.drop / 2 / np.maximum((own - off.drop) / left, 1e-30))
    size = np.linalg.norm(off.size, axis=2)
    sigmas = np.sqrt(off.drop / off.variance())
    return tuple(sets.rows(one) for one in (off.p(), apart, size, sigmas))  # type: ignore[return-value]


def _end(chain: _Chain, pull: int) -> tuple[int, float] | None:
    """Index of the end that deviates from the other pulls of the set, and by how much [m].

    None where neither is clearly the worse one.
    """
    off = _misses(chain, pull)
    miss = np.zeros(2) if off is None else np.linalg.norm(off, axis=1)
    far = int(np.argmax(miss))
    return (far, float(miss[far])) if miss.max() > _DECIDES * miss.min() else None


def _misses(chain: _Chain, pull: int) -> Array | None:
    """Deviation of both ends from the other pulls of the set [m], (2, 3), if these are three."""
    same = (chain.towards == chain.towards[pull]) & np.isfinite(chain.force)
    others = same & (np.arange(len(same)) != pull)
    if others.sum() < 3 or not same[pull]:
        return None
    X, at = np.column_stack([np.ones(len(same)), chain.force]), chain.ends.reshape(-1, 6)
    off = at[pull] - X[pull] @ linear.least_squares(X[others], at[others])  # from a straight course
    return np.asarray(off.reshape(2, 3))


def _finding(
    case: Case, chain: _Chain, off: _Off, told: str, end: tuple[int, float] | None
) -> Mistake:
    names, size = case.settings.naming.chain, off.size
    group, which = str(chain.group[off.pull]), f"{names[0]}-{names[1]}"
    if end is not None:
        which, size = names[end[0]], end[1]
        told = f"{told}: {which} is {plain(1e3 * size, 3)} mm off"
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
    return replace(case, readings=case.readings[case.readings["group"] != group])


GROSS_FAULT = Fault("outlier", lambda asked: chain_gross(asked.case))

FAULT = Fault("outlier", _outlier)
