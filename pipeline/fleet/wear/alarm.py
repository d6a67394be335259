"""Alarms: one test of all joints at each campaign, with a limited false-alarm rate per year.

Alternatives are trends in one joint, in several alike or in all, and steps between two campaigns;
levels are estimated together with each. Each alternative d is tested by its own score, with the
other joints unchanged,

    z_d = d's / (d' I d)^(1/2),

which uses the campaigns' covariances along d: errors that joints share cancel. The p-values of
softening and stiffening are combined by their weighted harmonic mean (Wilson, PNAS 116 (2019)
1195), which requires no independence in the tail. Which joints changed, and whether by a trend or a
step, follows from the likelihoods exp(z_d^2 / 2), each weighted by its alternative.

A look at a campaign may raise a false alarm with the fraction of `A_YEAR` that has passed since the
previous look (Lan and DeMets, Biometrika 70 (1983) 659), so that more frequent looks do not raise
the rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.fleet.wear.elimination import Eliminated, eliminated, gaps, steps
from pipeline.fleet.wear.machine import FEWEST, Machine
from pipeline.fleet.wear.scatter import DayToDayVariances

A_YEAR = 0.01
"""Probability of a false alarm per year and robot [1]."""

_ONE, _ALL = 0.5, 0.25
"""Prior weights of a trend in one joint and in all [1]; the remainder is that of several."""

_TREND = 0.8
"""Prior weight of a trend [1], as opposed to a step between any two campaigns."""

_SOFTENS = 0.9
"""Prior weight of a softening joint [1], as worn ones soften."""

_MANY = 8
"""Number of joints above which groups of more than two, except all, are not tried."""


class ChangeKind(StrEnum):
    """How a robot has changed."""

    TREND = "trend"
    STEP = "step"


@dataclass(frozen=True)
class InterimTest:
    """Test of the campaigns up to one of them.

    Attributes:
        campaign: The last of them.
        p_value: Probability of at least this change by chance.
        allowed: Limit of p below which an alarm is raised.
        kind: A trend, or a step.
        joints: Indices of joints that changed with more than 50 % probability; may be empty.
        after: The campaign after which a step occurred; None for a trend.
    """

    campaign: str
    p_value: float
    allowed: float
    kind: ChangeKind
    joints: tuple[int, ...]
    after: str | None = None

    @property
    def alarm(self) -> bool:
        """Whether an alarm is raised."""
        return self.p_value < self.allowed


@dataclass(frozen=True, eq=False)
class _Tried:
    """Alternatives: directions in the columns of trends and steps.

    Attributes:
        along: Directions, shape (m, D).
        weight: Prior weights, shape (D,).
        joints: Which joints each moves, shape (D, n).
        gap: Index of the campaign after which a step occurs, -1 for a trend, shape (D,).
    """

    along: Array
    weight: Array
    joints: Bools
    gap: Ints


def interim_tests(machine: Machine, scatter: DayToDayVariances) -> tuple[InterimTest, ...]:
    """One look per day with campaigns since the last repair, from the second day on."""
    t, W = machine.t, machine.weights(scatter.variance)
    begin = int(np.argmax(machine.present.all(axis=1))) if machine.present[-1].all() else len(t)
    out, before = [], float(t[begin - 1]) if begin >= FEWEST else 0.0
    for k in range(max(FEWEST, begin + 1), len(t) + 1):
        if k < len(t) and t[k] == t[k - 1]:
            continue  # one look at all campaigns of a day
        if t[k - 1] == t[0]:
            continue  # all of one day: no time for wear
        allowed = A_YEAR * min(float(t[k - 1]) - before, 1.0)
        out.append(_look(machine, scatter, W, k, allowed))
        before = float(t[k - 1])
    return tuple(out)


def _look(
    machine: Machine, scatter: DayToDayVariances, W: Array, k: int, allowed: float
) -> InterimTest:
    """Test the first k campaigns."""
    after = gaps(machine, k)
    Z = np.concatenate([machine.trend, steps(machine, after)], axis=-1)
    found = eliminated(machine, W, Z, k)
    tried = _tried(found.told.reshape(-1, machine.joints), after)
    name = machine.visits[k - 1].campaign
    if not tried.weight.size:
        return InterimTest(name, 1.0, allowed, ChangeKind.TREND, ())
    z, p = _p_values(found, tried, scatter)
    odds = np.array([_SOFTENS, 1 - _SOFTENS])[:, None] * tried.weight / p
    share = special.softmax(z**2 / 2 + np.log(tried.weight))
    concerned = np.flatnonzero(share @ tried.joints > 0.5)
    by_gap = {g: float(share[tried.gap == g].sum()) for g in (-1, *after)}
    stepped = by_gap[-1] < 0.5
    last = max(after, key=lambda g: by_gap[g]) if stepped else -1
    return InterimTest(
        name,
        _together(float(odds.sum()), odds.size),
        allowed,
        ChangeKind.STEP if stepped else ChangeKind.TREND,
        tuple(concerned.tolist()),
        machine.visits[last].campaign if stepped else None,
    )


def _tried(told: Bools, after: list[int]) -> _Tried:
    """All alternatives; `told` marks the columns with information, trends first, (1 + steps, n)."""
    rows = (-1, *after)
    blocks = [_groups(tuple(mine.tolist()), at < 0) for mine, at in zip(told, rows, strict=True)]
    share = [_TREND, *[(1 - _TREND) / max(len(after), 1)] * len(after)]
    weight = np.concatenate([part * one for (_, part), one in zip(blocks, share, strict=True)])
    joints = np.concatenate([moved for moved, _ in blocks])
    counts = [len(part) for _, part in blocks]
    block = np.repeat(np.arange(len(rows)), counts)
    along = (block[:, None] == np.arange(len(rows)))[:, :, None] * joints[:, None, :]
    whole = weight.sum() or 1.0
    return _Tried(
        along.reshape(len(block), told.size).T.astype(float),
        weight / whole,
        joints,
        np.repeat(np.array(rows), counts),
    )


@lru_cache(maxsize=256)
def _groups(told: tuple[bool, ...], trend: bool) -> tuple[Bools, Array]:
    """Joints that change together, (D, n), and weights, (D,); for steps only one or all joints."""
    use, n = np.flatnonzero(told).tolist(), len(told)
    m = len(use)
    part = _parts(m, trend)
    found = [
        (one, part[size] / math.comb(m, size)) for size in part for one in combinations(use, size)
    ]
    joints = np.array([np.isin(np.arange(n), one) for one, _ in found], bool).reshape(-1, n)
    return joints, np.array([weight for _, weight in found])


def _parts(m: int, trend: bool) -> dict[int, float]:
    """Total weight of the groups of each size, of `m` joints: of one, of all, of those between."""
    if m == 0:
        return {}
    between = range(2, m) if m <= _MANY else range(2, 3)
    sizes = [*between] if trend else []
    part = {1: _ONE, m: _ALL if m > 1 else 1.0}
    return part | {size: (1 - _ONE - _ALL) / len(sizes) for size in sizes}


def _p_values(found: Eliminated, tried: _Tried, scatter: DayToDayVariances) -> tuple[Array, Array]:
    """Scores z, (D,), and p of softening and of stiffening along each alternative, (2, D).

    By Student's t, since the day-to-day scatter is itself estimated.
    """
    along = tried.along
    size = np.sum(along * (found.N @ along), axis=0)
    z = (found.g @ along) / np.sqrt(size)
    dof = 2 * size**2 / found.variance_of_variance(along, scatter.uncertainty)
    p = np.stack([special.stdtr(dof, -z), special.stdtr(dof, z)])
    return z, np.asarray(np.maximum(p, 1e-300))


def _together(odds: float, count: int) -> float:
    """p-value of a weighted mean of 1/p over `count` tests, which has a Landau distribution.

    It has that for independent tests. Its tail beyond x is 1 / (x - ln count - 1), to first order.
    """
    return 1 / max(odds - math.log(count) - 1, 1.0)
