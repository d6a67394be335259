"""Has a robot changed? One test of all joints at each campaign, false alarms limited by the year.

Alternatives are trends in one joint, in several alike or in all, all beside their levels, and steps
between two campaigns. Each alternative d is tested by its own score, other joints at rest,

    z_d = d's / (d' I d)^(1/2),

which uses what the campaigns' covariances say of d: errors that joints share cancel. The p-values
of softening and stiffening are put together by their weighted harmonic mean (Wilson, PNAS 116
(2019) 1195), which needs no independence in the tail. Which joints, and whether a trend or a step:
what the likelihoods exp(z_d^2 / 2) say together, each with the weight of its alternative.

A look at a campaign may raise a false alarm with the part of `A_YEAR` that has passed since the
look before (Lan and DeMets, Biometrika 70 (1983) 659), so that looks more often find no more.
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
from pipeline.fleet.wear.beside import Beside, beside, gaps, steps
from pipeline.fleet.wear.machine import FEWEST, Machine
from pipeline.fleet.wear.scatter import Scatter

A_YEAR = 0.01
"""Probability of a false alarm a year, of each robot."""

_ONE, _ALL = 0.5, 0.25
"""Weights of a trend in one joint and in all; the rest is that of several."""

_TREND = 0.8
"""Weight of a trend, against a step between any two campaigns."""

_SOFTENS = 0.9
"""Weight of a joint that grows softer, as worn ones do."""

_MANY = 8
"""Joints from which groups of more than two are no longer tried one by one."""


class Kind(StrEnum):
    """How a robot has changed."""

    TREND = "trend"
    STEP = "step"


@dataclass(frozen=True)
class Look:
    """What the campaigns up to one say.

    Attributes:
        campaign: The last of them.
        p_value: Chance of as much change, or more, if there is none.
        allowed: Raises an alarm below this.
        kind: A trend, or a step.
        joints: Indices of those that rather changed than not; none where that is open.
        after: The campaign after which a step came; None for a trend.
    """

    campaign: str
    p_value: float
    allowed: float
    kind: Kind
    joints: tuple[int, ...]
    after: str | None = None

    @property
    def alarm(self) -> bool:
        """More than chance explains."""
        return self.p_value < self.allowed


@dataclass(frozen=True, eq=False)
class _Tried:
    """Alternatives: directions in the columns of trends and steps.

    Attributes:
        along: Shape (m, D).
        weight: Shape (D,).
        joints: Which joints each moves, shape (D, n).
        gap: Campaign after which a step comes, -1 for a trend, shape (D,).
    """

    along: Array
    weight: Array
    joints: Bools
    gap: Ints


def looks(machine: Machine, scatter: Scatter) -> tuple[Look, ...]:
    """One at each day with a campaign since the last repair, from the second day on."""
    t, W = machine.t, machine.weights(scatter.variance)
    begin = int(np.argmax(machine.present.all(axis=1))) if machine.present[-1].all() else len(t)
    out, before = [], float(t[begin - 1]) if begin >= FEWEST else 0.0
    for k in range(max(FEWEST, begin + 1), len(t) + 1):
        if k < len(t) and t[k] == t[k - 1]:
            continue  # one look at all campaigns of a day
        if t[k - 1] == t[0]:
            continue  # of one day: no time in which anything could have worn
        allowed = A_YEAR * min(float(t[k - 1]) - before, 1.0)
        out.append(_look(machine, scatter, W, k, allowed))
        before = float(t[k - 1])
    return tuple(out)


def _look(machine: Machine, scatter: Scatter, W: Array, k: int, allowed: float) -> Look:
    """At the first k campaigns."""
    after = gaps(machine, k)
    Z = np.concatenate([machine.trend, steps(machine, after)], axis=-1)
    found = beside(machine, W, Z, k)
    tried = _tried(found.told.reshape(-1, machine.joints), after)
    name = machine.visits[k - 1].campaign
    if not tried.weight.size:
        return Look(name, 1.0, allowed, Kind.TREND, ())
    z, p = _p_values(found, tried, scatter)
    odds = np.array([_SOFTENS, 1 - _SOFTENS])[:, None] * tried.weight / p
    share = special.softmax(z**2 / 2 + np.log(tried.weight))
    blamed = np.flatnonzero(share @ tried.joints > 0.5)
    by_gap = {g: float(share[tried.gap == g].sum()) for g in (-1, *after)}
    stepped = by_gap[-1] < 0.5
    last = max(after, key=lambda g: by_gap[g]) if stepped else -1
    return Look(
        name,
        _together(float(odds.sum()), odds.size),
        allowed,
        Kind.STEP if stepped else Kind.TREND,
        tuple(blamed.tolist()),
        machine.visits[last].campaign if stepped else None,
    )


def _tried(told: Bools, after: list[int]) -> _Tried:
    """All alternatives; `told` says which columns tell something, trends first, (1 + steps, n)."""
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
    """Joints that change together, (D, n), and their weights, (D,); of steps one or all."""
    use, n = np.flatnonzero(told).tolist(), len(told)
    m = len(use)
    part = _parts(m, trend)
    found = [
        (one, part[size] / math.comb(m, size)) for size in part for one in combinations(use, size)
    ]
    joints = np.array([np.isin(np.arange(n), one) for one, _ in found], bool).reshape(-1, n)
    return joints, np.array([weight for _, weight in found])


def _parts(m: int, trend: bool) -> dict[int, float]:
    """Weight of all groups of a size by that, of `m` joints: of one, of all, of those between."""
    if m == 0:
        return {}
    between = range(2, m) if m <= _MANY else range(2, 3)
    sizes = [*between] if trend else []
    part = {1: _ONE, m: _ALL if m > 1 else 1.0}
    return part | {size: (1 - _ONE - _ALL) / len(sizes) for size in sizes}


def _p_values(found: Beside, tried: _Tried, scatter: Scatter) -> tuple[Array, Array]:
    """Scores z, (D,), and p of softening and of stiffening along each alternative, (2, D).

    Student's t, for the scatter from day to day is itself estimated.
    """
    along = tried.along
    size = np.sum(along * (found.N @ along), axis=0)
    z = (found.g @ along) / np.sqrt(size)
    dof = 2 * size**2 / found.variance_of_variance(along, scatter.uncertainty)
    p = np.stack([special.stdtr(dof, -z), special.stdtr(dof, z)])
    return z, np.asarray(np.maximum(p, 1e-300))


def _together(odds: float, count: int) -> float:
    """The p of a weighted mean of 1/p over `count` tests, which for independent ones is Landau's.

    Its tail beyond x is 1 / (x - ln count - 1), to first order.
    """
    return 1 / max(odds - math.log(count) - 1, 1.0)
