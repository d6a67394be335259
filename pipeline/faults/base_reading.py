"""Bad readings of the base reflectors, independent of the robot: of any size, and several at once.

The model is linearised at the pose of the tracker according to the readings that are not grossly
off (`register.agreed`). Then readings are freed one after the other, each time the one that reduces
the sum of squares most given the others (see `system.score_tests`), and exchanged while another one
does better. Between two rounds the tracker may have drifted, shifted, or shifted and rotated;
otherwise a real drift would be attributed to readings. Of these courses the one with the least
penalised sum of squares is accepted: every reading and every motion costs the threshold of its own
test.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import pandas as pd
from scipy import special

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import bad_reading, smallest
from pipeline.machine.effects.tracker_drift import LAWS
from pipeline.reduction.register import XYZ, Registration, agreed
from pipeline.system import alarms, odds
from pipeline.system.score_tests import Base, ScoreTests

_AGREES = 0.01
"""Minimum p-value of the remaining readings for them to agree [1]."""

_ROUNDS = 100
"""Maximum number of rounds for which motions of the tracker are distinguished from bad readings;
with more, one round determines less than a hundredth of the tracker's pose, and motions are a
drift."""

_REFLECTORS = 3
"""Minimum number of reflectors that determine the pose of the tracker."""


@dataclass(frozen=True, eq=False)
class _Readings(Locked):
    """Whitened base readings with the parameters that are estimated in any case; m readings.

    Attributes:
        X: Columns of the tracker's pose, and of its motions between rounds, shape (m, 3, k).
        y: Residuals, shape (m, 3).
        white: Whitening matrices, shape (m, 3, 3).
        cost: Threshold of the test for these motions, as a chi-square.
    """

    X: Array
    y: Array
    white: Array
    cost: float

    def base(self, used: Bools, key: Ints | None = None) -> Base:
        """The base, from some of the readings, `key` the block of each row."""
        return Base.of(self.X[used].reshape(-1, self.X.shape[2]), self.y[used].ravel(), key)

    def each(self, used: Bools) -> ScoreTests:
        """Shift of every used reading by itself [m], given the base."""
        white = self.white[used]
        base = self.base(used, np.repeat(np.arange(len(white)), 3))
        return base.beside(white[:, :, None, :]).arranged(lambda one: one[:, 0])


@dataclass(frozen=True, eq=False)
class _Free:
    """Result of freeing some readings.

    Attributes:
        rest: Residual sum of squares of the others.
        dof: Its degrees of freedom.
        drop: Reduction by each freed reading alone, by index.
        size: Shift of each [m], by index.
        cost: Thresholds of all hypotheses together, as a chi-square.
        near: Of each other one of its round, squared error in standard uncertainties, and number
            of coordinates that the fit does not absorb, by index.
        decided: Whether no other reading would do nearly as well in the place of one of them.
    """

    rest: float
    dof: int
    drop: dict[int, float]
    size: dict[int, float]
    cost: float
    near: dict[int, tuple[tuple[float, float], ...]]
    decided: bool

    @property
    def score(self) -> float:
        """Penalised sum of squares."""
        return self.rest + self.cost

    @property
    def certain(self) -> bool:
        """Whether the others agree, and each freed reading is identified."""
        agree = self.dof >= _REFLECTORS and chi2_beyond(self.rest, self.dof) > _AGREES
        return bool(agree and self.decided)


def base_outlier(registration: Registration, scale: float) -> list[Mistake]:
    """The base readings that contradict the others, if these agree without them.

    Args:
        registration: Pose of the tracker.
        scale: Scatter of the readings over the stated one; where none is stated, only gross errors
            are named.
    """
    if registration.dof < 6:
        return []
    count = len(registration.table)
    seen, near = agreed(registration)
    if registration.chi2 is None:
        if near.all():
            return []
        scale = _scatter(seen, near)
    limit = float(special.chdtri(3, alarms.READING / count))
    if near.all() and not _stands_out(next(_courses(seen, scale)), limit):
        return []
    if seen.table["group"].nunique() > _ROUNDS:
        return []
    every = [_freed(one, seen.table, near, limit) for one in _courses(seen, scale)]
    best = min(filter(None, every), key=lambda free: free.score, default=None)
    if best is None or not best.certain or _whole_reflector(seen.table, best):
        return []
    return list(_findings(best, seen.table, scale))


def _stands_out(one: _Readings, limit: float) -> bool:
    """Whether any reading reduces the sum of squares by more than `limit`.

    With H = Q Q' of its rows and r its residual, the reduction is
    r' (1 - H)^-1 r <= r'r / (1 - tr H); if this bound is below the limit for all readings, no
    further test is needed.
    """
    every = np.ones(len(one.y), dtype=bool)
    base = one.base(every)
    held = np.sum(base.Q[0] ** 2, axis=1).reshape(-1, 3).sum(axis=1)
    left = np.sum(base.left[0].reshape(-1, 3) ** 2, axis=1)
    if (left <= limit * (1 - held)).all():
        return False
    return bool(one.each(every).drop.max() > limit)


def _whole_reflector(table: pd.DataFrame, free: _Free) -> bool:
    """Whether all of several readings of a reflector are off, which `base_reflector` tests."""
    off = np.isin(np.arange(len(table)), list(free.drop))
    of = pd.Series(off).groupby(table["target"].astype(str).to_numpy())
    return bool((of.all() & (of.count() > 1)).any())


def _findings(free: _Free, table: pd.DataFrame, scale: float) -> Iterator[Mistake]:
    for k in sorted(free.drop, key=lambda k: -free.drop[k]):
        p = len(table) * float(chi2_beyond(free.drop[k], 3))
        if free.size[k] >= smallest(table, scale):
            sigmas = float(np.sqrt(free.drop[k]))
            others = "the other base reflectors"
            found = bad_reading(table.iloc[k], others, free.size[k], sigmas, p)
            yield replace(found, near=free.near[k])


def shifts(registration: Registration, scale: float, which: Ints) -> ScoreTests:
    """Base readings shifted in groups [m], F_b, given the pose of the tracker.

    Args:
        registration: Pose of the tracker.
        scale: Scatter of the readings over the stated one.
        which: Index of the suspect that each reading belongs to, shape (m,).
    """
    still = next(_courses(registration, scale))
    D = still.white[:, :, None, :] * np.eye(which.max() + 1)[which][:, None, :, None]
    base = still.base(np.ones(len(which), dtype=bool))
    return base.beside(D.reshape(1, -1, *D.shape[2:])).of_block(0)


def astray(registration: Registration, scale: float, far: float) -> tuple[int, int]:
    """Minimum number of base readings off by more than `far` standard deviations, and the total.

    It holds for any motion of the tracker between rounds, either growth of the base frame, and any
    positions of the reflectors: readings are freed one by one, the worst first, until the residual
    is explained by chance and one such reading. It does not identify them.

    Args:
        registration: Pose of the tracker.
        scale: Scatter of the readings over the stated one.
        far: Number of standard deviations [1].
    """
    table = registration.table
    if table["group"].nunique() < 2 or table["group"].nunique() > _ROUNDS:
        return 0, 0
    places = np.eye(table["target"].nunique())[pd.factorize(table["target"])[0]]
    *_, whole, along = _courses(registration, scale)
    return min(_astray(one, places, far) for one in (whole, along)), len(table)


def _astray(one: _Readings, places: Array, far: float) -> int:
    """Minimum number of readings astray, for one way of motion and growth; places (m, targets)."""
    own = one.white[:, :, None, :] * places[:, None, :, None]
    freest = replace(one, X=np.concatenate([one.X, own.reshape(len(own), 3, -1)], axis=2))
    used = np.ones(len(places), dtype=bool)
    while (base := freest.base(used)).dof > 0:
        if base.rest <= far**2 + special.chdtri(base.dof, alarms.READING):
            break
        worst = np.flatnonzero(used)[int(np.argmax(freest.each(used).drop))]
        used[worst] = False
    return int((~used).sum())


def _courses(registration: Registration, scale: float) -> Iterator[_Readings]:
    """Courses of the tracker: at rest, drifting, shifted between rounds, shifted and rotated.

    y_k = v + w x p_k + a(t_k) (v' + w' x p_k) + e_k [m], F_b: with a a law of `LAWS`, normalised to
    1 at the end; or v', or v' and w', of each round; or in addition the growth g' p_k of the base
    frame, as in a hall that warms (`reduction.growth`), or g' u u'p_k along the rail alone, u its
    longest extent.
    """
    table = registration.table
    C, R = registration.weighing, registration.R
    white = covariance.alike(C, lambda own: linear.whitening(R @ own @ R.T * scale**2))
    off = table[["dx_m", "dy_m", "dz_m"]].to_numpy(float)
    lever = table[XYZ].to_numpy(float) - off - registration.centre  # of the nominal positions
    rigid = white @ linear.motions(lever)
    y = (white @ off[..., None])[..., 0]
    yield _Readings(rigid, y, white, 0.0)
    for much in _drifts(table):
        X = np.concatenate([rigid, rigid * much[:, None, None]], axis=2)
        yield _Readings(X, y, white, float(special.chdtri(6, alarms.DRIFT)))
    rounds = pd.factorize(table["group"])[0]
    later = np.eye(rounds.max() + 1)[rounds][:, 1:]
    rail = linear.principal(lever.T @ lever)[2][0]
    grown = (white @ part[..., None] for part in (lever, np.outer(lever @ rail, rail)))
    ways = [rigid[:, :, :3], rigid, *(np.concatenate([rigid, one], axis=2) for one in grown)]
    for way in ways if later.shape[1] else ():
        some = way.shape[2]
        moved = way[:, :, None, :] * later[:, None, :, None]
        X = np.concatenate([rigid, moved.reshape(len(y), 3, -1)], axis=2)
        dof = some * later.shape[1]
        yield _Readings(X, y, white, float(special.chdtri(dof, alarms.DRIFT)))


def _drifts(table: pd.DataFrame) -> list[Array]:
    """Each form of a drift at the readings, shape (m,), over its maximum."""
    since = table["time_s"].to_numpy(float) - table["time_s"].min()
    if not (np.isfinite(since).all() and since.max() > 0):
        return []
    return [law(since) / law(since).max() for law in LAWS.values()]


def _scatter(registration: Registration, near: Bools) -> float:
    """Rms residual of the readings that agree [m]."""
    left = next(_courses(registration, 1.0)).base(near)
    return float(np.sqrt(left.rest / left.dof)) if left.dof > 0 else np.inf


def _freed(one: _Readings, table: pd.DataFrame, near: Bools, limit: float) -> _Free | None:
    """Readings freed until no further one is significant; insignificant ones are used again.

    None where too few readings or reflectors would be left.
    """
    free = set(np.flatnonzero(~near).tolist())
    most = (len(near) - _REFLECTORS) // 2
    while len(free) <= most:
        drop = _drops(one, free)[0]
        best = int(np.argmax(drop))
        if drop[best] <= limit:
            break
        free = _exchanged(one, free | {best})
    return _told(one, table, free, _lost(table, near), limit) if len(free) <= most else None


def _exchanged(one: _Readings, free: set[int]) -> set[int]:
    """The set after exchanging each reading for the one that reduces the sum of squares most."""
    for k in sorted(free):
        rest = free - {k}
        free = rest | {int(np.argmax(_drops(one, rest)[0]))}
    return free


def _drops(one: _Readings, free: set[int]) -> tuple[Array, ScoreTests]:
    """Reduction by every reading given those that are free, -1 for these, shape (m,)."""
    used = ~np.isin(np.arange(len(one.y)), [*free])
    found = one.each(used)
    drop = np.full(len(used), -1.0)
    drop[used] = found.drop
    return drop, found


def _lost(table: pd.DataFrame, near: Bools) -> Bools:
    """Readings that are grossly off while most others of their round are not, shape (m,).

    A motion of the tracker between rounds cannot explain them: it would affect the others, too.
    """
    by = pd.Series(near).groupby(table["group"].astype(str).to_numpy())
    return np.asarray(~near & (by.transform("sum") > 0.5 * (by.transform("size") - 1)))


def _told(
    one: _Readings, table: pd.DataFrame, free: set[int], lost: Bools, limit: float
) -> _Free | None:
    """The freed readings, each tested given the others; insignificant ones are used again."""
    drops, sizes, decided = {}, {}, True
    for k in sorted(free):
        drop, found = _drops(one, free - {k})
        if drop[k] <= limit:
            return _told(one, table, free - {k}, lost, limit)
        at = int(np.sum([i not in free for i in range(k)]))
        drops[k], sizes[k] = float(drop[k]), float(np.linalg.norm(found.size[at]))
        decided &= lost[k] or bool(np.delete(drop, k).max() < drop[k] - odds.DECIDES)
    used = ~np.isin(np.arange(len(table)), [*free])
    if table["target"][used].nunique() < _REFLECTORS:
        return None
    base, group = one.base(used), table["group"].to_numpy()
    known = 3 - np.sum(base.Q[0].reshape(-1, 3 * base.Q.shape[2]) ** 2, axis=1)
    off = [*zip(np.sum(base.left[0].reshape(-1, 3) ** 2, axis=1), known, strict=True)]
    near = {k: tuple(off[i] for i in np.flatnonzero(group[used] == group[k])) for k in free}
    return _Free(base.rest, base.dof, drops, sizes, one.cost + limit * len(free), near, decided)


_off = lru_cache(maxsize=1)(base_outlier)
"""Result kept for the second of the two tests, which has the same arguments."""


def _found(single: bool, asked: Screening) -> list[Mistake]:
    """One bad reading, or several."""
    found = _off(asked.reduced.registration, asked.spread[0])
    return found if (len(found) == 1) is single else []


ONE_READING = Fault("outlier", partial(_found, True))

SEVERAL_READINGS = Fault("outlier", partial(_found, False))
"""Tested after a reflector that is off in every round, which is one mistake and not several."""
