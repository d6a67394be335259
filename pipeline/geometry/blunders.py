"""Readings of positions that contradict all others, beside the whole model.

A reading that is off is a suspect with a column for each of its coordinates, beside all parameters
and what is known of them before: T = g' N^+ g as in `system.beside`, chi-square over its directions
by chance. The scatter of the estimate may hold what the suspects do, so a median of all T says how
large it is, which up to half of them cannot move (Hampel, J. Am. Stat. Assoc. 69, 1974). Whoever
calls this leaves them out, estimates again, and asks all again until the same ones are out: forward
search with deletion, as in `system.together`, one of each pose at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.estimate import ReadRows, rows, solved
from pipeline.geometry.identify import Identified
from pipeline.geometry.leftout import distances
from pipeline.geometry.mechanism import ArmWeights, Linear, linearised
from pipeline.geometry.readings import PositionReadings
from pipeline.system import alarms
from pipeline.system.together import chance

_TAILS = 3.0
"""Sums of squares so many times beyond chance are no tail of what is always there."""

_LEAST = 1e-4
"""Variance below which whitened rows do not scatter [1]: a scatter may hold a hundred times what is
without the readings that are off."""


class Off(NamedTuple):
    """Readings that are off.

    Attributes:
        which: Of all readings, shape (m, t).
        size_m: How far each is from where all others put it [m], NaN where not read, shape (m, t).
        p: Probability that chance makes any reading as far off, shape (m, t).
    """

    which: Bools
    size_m: Array
    p: Array


def off(found: Identified, readings: PositionReadings, weights: ArmWeights, held: Bools) -> Off:
    """What is off among readings, each asked beside those that are held to be off.

    In each pose the one joins that is farthest off: beside it others of the pose may be where they
    should. One that is held is asked beside the rest of its pose, and may leave.

    Args:
        found: The model that was estimated without those that are held.
        readings: All readings.
        weights: What pulled at the arm.
        held: Readings that are held to be off, shape (m, t).
    """
    free = _Asked.of(found, readings, weights, held)
    which, p = _farthest(free), free.p(free.variance)
    for layer in range(int(held.sum(axis=1).max(initial=0))):
        back = held & (np.cumsum(held, axis=1) == layer + 1)
        one = _Asked.of(found, readings, weights, held & ~back)
        which = np.where(back, one.far(free.variance), which)
        p = np.where(back, one.p(free.variance), p)
    here = linearised(readings, found.mechanism, weights)
    return Off(which, distances(here.y, readings.read), np.minimum(p, 1.0))


@dataclass(frozen=True, eq=False)
class _Asked(Locked):
    """What each reading would add by itself.

    Attributes:
        drop: How far the sum of squares falls by it, shape (m, t).
        rank: In how many directions, 0 where it is not asked, shape (m, t).
        dof: Rows minus parameters.
    """

    drop: Array
    rank: Ints
    dof: int

    @classmethod
    def of(
        cls, found: Identified, readings: PositionReadings, weights: ArmWeights, without: Bools
    ) -> _Asked:
        at = np.where(without[..., None], np.nan, readings.at)
        readings = replace(readings, at=at)
        here = linearised(readings, found.mechanism, weights)
        white = rows(here, found.mechanism, found.scatter)
        drop, rank = _each(white, _columns(white.W, here, readings.six), found)
        return cls(drop, rank, int(readings.read.sum()) - white.D.shape[2])

    @property
    def variance(self) -> float:
        """Of the whitened rows, as half of the readings show it."""
        there = self.rank > 0
        ratio = self.drop[there] / special.chdtri(self.rank[there], 0.5)
        return max(float(np.median(ratio)), _LEAST) if there.any() else 1.0

    def far(self, variance: float) -> Bools:
        """Readings that are `_TAILS` times farther off than chance throws any, shape (m, t)."""
        tests = max(int((self.rank > 0).sum()), 1)
        limit = special.chdtri(np.maximum(self.rank, 1), alarms.READING / tests)
        return np.asarray((self.rank > 0) & (self.drop > _TAILS * limit * variance))

    def p(self, variance: float) -> Array:
        """Chance that any is as far off, shape (m, t)."""
        tests = int((self.rank > 0).sum())
        return tests * chance(self.drop, self.rank, variance, self.dof)


def _farthest(asked: _Asked) -> Bools:
    """In each pose the reading that is farthest off, where it is."""
    far = asked.far(asked.variance)
    best = np.argmax(np.where(far, asked.drop, -1.0), axis=1)
    return far & (np.arange(far.shape[1]) == best[:, None])


def _columns(W: Array, here: Linear, six: Bools) -> Array:
    """Whitened columns of the coordinates that were read, (m, r, t, 3), or 6 where any is 6D."""
    every = np.zeros((*W.shape[:2], here.read.shape[1]))
    every[..., here.used] = W
    each = (every * here.read[:, None, :]).reshape(*W.shape[:2], -1, 6)
    return each if six.any() else each[..., :3]


def _each(white: ReadRows, D: Array, found: Identified) -> tuple[Array, Ints]:
    """How far the sum of squares falls by each suspect alone, and its directions, (m, t)."""
    solution = solved(white, found.mechanism, found.known)
    e = white.y - white.along(solution.x)
    whole = np.einsum("mrti,mrtj->mtij", D, D)
    held = np.einsum("mrti,mrs,mstj->mtij", D, white.variance(solution.cov), D, optimize=True)
    cov, rank = linear.left(whole - held, np.einsum("mtii->mti", whole))
    g = np.einsum("mrti,mr->mti", D, e)
    return np.einsum("mti,mtij,mtj->mt", g, cov, g), rank
