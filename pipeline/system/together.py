"""Which of many suspects are at work together: all are asked beside all that are held.

Tests of one suspect after the other fail where several are at work: those that are not yet held
widen the scatter that each is judged by. Here the scatter is a median, which up to half of the
readings cannot move (Hampel, J. Am. Stat. Assoc. 69, 1974), those that stand out join block by
block, and after each round everyone that is held is asked again beside the others: it stays, goes,
or gives its place to a better one of its block (forward search with deletion; Atkinson and Riani,
Robust Diagnostic Regression Analysis, 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.system import alarms
from pipeline.system.beside import Base, Beside
from pipeline.system.blocks import Blocks
from pipeline.system.odds import DECIDES

_TOLD = 0.37
"""Part of the degrees of freedom that a median of squares tells of a variance [1]: the efficiency
of the median absolute deviation for normal errors (Rousseeuw and Croux, J. Am. Stat. Assoc. 88,
1993)."""

_AS_FAR = 0.25
"""Drop, over the largest of all, from which a suspect joins in the same round [1]: a small one
beside a large one may be its shadow."""

_MOST = 0.5
"""Part of a base's degrees of freedom that suspects may take [1]; beyond it nothing is the rule."""

_PART = 0.01
"""Part of the suspects that is at work beforehand [1]: the largest but one of `family.MISTAKES`."""

_EFOLDS = 10.0
"""Over so many e-folds the logarithm of a size in standard deviations is spread beforehand [1]."""

_SETS = 600
"""Sets of suspects of one block that are compared at most; more take too long."""

_SAME = 1e-6
"""Minus twice a log likelihood that is no difference [1]."""

_ROUNDS = 100
"""Rounds after which the search ends; each but the last changes who is held."""


@dataclass(frozen=True, eq=False)
class Suspects(Locked):
    """Many suspects of k columns, each within one block of the rows.

    Attributes:
        D: Whitened columns by block, shape (p, s, q, k).
        blocks: Suspects by block, n in all.
    """

    D: Array
    blocks: Blocks

    def rows(self, base: Base, chosen: Ints) -> Array:
        """Columns of some of them as rows of a base, shape (M, k m)."""
        shape, k = base.blocks.shape, self.D.shape[3]
        out = np.zeros((*shape, len(chosen) * k))
        for column, one in enumerate(chosen.tolist()):
            block, place = self.blocks.index[one], self.blocks.place[one]
            out[block, : self.D.shape[1], column * k : (column + 1) * k] = self.D[block, :, place]
        return base.blocks.rows(out)

    def beside(self, base: Base, held: Ints) -> tuple[Base, Beside]:
        """The base with some of them, and each of all beside it."""
        wider = base.more(self.rows(base, held)) if len(held) else base
        return wider, wider.beside(self.D).rows(self.blocks)

    def farthest(self, drop: Array) -> Ints:
        """In each block the one of the largest drop, unless it may be a larger one's shadow."""
        best = np.zeros(self.blocks.shape[0])
        np.maximum.at(best, self.blocks.index, drop)
        least = np.maximum(best[self.blocks.index], _AS_FAR * drop.max(initial=0.0))
        return np.flatnonzero((drop > 0) & (drop >= least))

    def rivals(self, held: Held) -> list[Ints]:
        """For each that is held who would do nearly as well in its place, beside all others.

        And who is nobody beside it: else both may be at work.
        """
        left = self.beside(held.given, held.which)[1].drop < DECIDES * held.variance
        out = []
        for one in held.which:
            found = self.beside(held.given, held.which[held.which != one])[1]
            told = found.drop / held.variance
            told = np.where(found.rank > 0, told - cost(told, found.rank), -np.inf)
            near = np.flatnonzero(left & (told > told[one] - DECIDES))
            out.append(np.setdiff1d(near, held.which))
        return out


@dataclass(frozen=True, eq=False)
class Held(Locked):
    """Suspects that are at work together.

    Attributes:
        which: Their numbers, ascending, shape (m,).
        size: Their sizes, estimated together, shape (m, k).
        drop: How far the sum of squares falls by each beside all others, shape (m,).
        rank: Directions in which each is determined, shape (m,).
        variance: Of the rows, from the median of what all others would add.
        given: The base beside which they are held.
        base: The same with all of them.
        tests: Suspects that were asked.
    """

    which: Ints
    size: Array
    drop: Array
    rank: Ints
    variance: float
    given: Base
    base: Base
    tests: int

    def loss(self, least: float) -> float:
        """Minus twice the log of likelihood and priors, up to a constant.

        M log v + rest / v + sum of 2 ln(1 / pi) + k ln(drop / v), v the variance of the M rows: a
        suspect is at work with probability pi, and the logarithm of its size is anything.
        """
        v = max(self.base.rest / max(self.base.dof, 1), least)
        rows = self.base.dof + int(self.rank.sum())
        held = np.sum(cost(self.drop / v, self.rank))
        return float(rows * np.log(v) + self.base.rest / v + held)

    def p(self) -> Array:
        """Probability that chance makes any suspect look as large, shape (m,)."""
        return self.tests * chance(self.drop, self.rank, self.variance, self.base.dof)


def cost(drop: Array | float, rank: Array | Ints | float) -> Array:
    """What the prior takes from minus twice the log likelihood, Laplace's approximation.

    2 ln(L S_k drop^(k/2) / (pi (2 pi)^(k/2))), S_k = 2 pi^(k/2) / Gamma(k/2) the sphere of all
    directions, L = `_EFOLDS`, pi = `_PART`.

    Args:
        drop: Of the sum of squares over the variance.
        rank: Directions k of the suspect.
    """
    k = np.maximum(rank, 1)
    fixed = 2 * np.log(2 * _EFOLDS / _PART) - k * np.log(2) - 2 * special.gammaln(k / 2)
    return np.asarray(fixed + k * np.log(np.maximum(drop, np.e)))


def chance(drop: Array, rank: Ints, variance: float, dof: int) -> Array:
    """Probability of a drop of the sum of squares by chance, the variance known from a median."""
    told = max(_TOLD * dof, 1.0)
    known = np.maximum(rank, 1)
    return np.where(rank > 0, special.fdtrc(known, told, drop / known / variance), 1.0)


def together(base: Base, suspects: Suspects, least: float) -> Held:
    """All suspects that are at work beside a base.

    From two starts: rows that scatter as their median says, and rows that scatter no more than
    they must. The end that is likelier stands: few suspects beside much noise, or more beside less.

    Args:
        base: Columns that are estimated in any case.
        suspects: Suspects, each within one block of the base's rows.
        least: Variance below which the rows do not scatter.
    """
    wide = _end(base, suspects, least, np.inf)
    if not len(_joining(suspects.beside(base, wide.which)[1], suspects, least)):
        return wide  # nobody stands out of the stated scatter either
    return min((wide, _end(base, suspects, least, least)), key=lambda one: one.loss(least))


def _end(base: Base, suspects: Suspects, least: float, most: float) -> Held:
    """Where nobody joins, leaves or gives way, rows scattering `most` at most while it lasts."""
    held, tried = np.zeros(0, np.int64), set[bytes]()
    for _ in range(_ROUNDS):
        wider, found = suspects.beside(base, held)
        variance = min(_variance(found, held, least), most)
        joined = np.union1d(held, _joining(found, suspects, variance))
        joined = _staying(base, suspects, joined, variance)
        if joined.tobytes() == held.tobytes():  # dear, and seldom needed before all have joined
            joined = _exchanged(base, suspects, joined, variance)
        if joined.tobytes() in tried or joined.size * suspects.D.shape[3] > _MOST * base.dof:
            break
        tried.add(joined.tobytes())
        held = joined
    held, variance, found, wider = _seen_from_all(base, suspects, held, least)
    size, drop, rank = _each(base, suspects, held)
    tests = int((found.rank > 0).sum()) + len(held)
    return Held(held, size, drop, rank, variance, base, wider, tests)


def _seen_from_all(
    base: Base, suspects: Suspects, held: Ints, least: float
) -> tuple[Ints, float, Beside, Base]:
    """Those of an end that stand out in the scatter of all others, whatever it was judged by."""
    while True:
        wider, found = suspects.beside(base, held)
        variance = _variance(found, held, least)
        stay = _staying(base, suspects, held, variance)
        if len(stay) == len(held):
            return held, variance, found, wider
        held = stay


def _variance(found: Beside, held: Ints, least: float) -> float:
    """Median of what suspects that are not held would add, over that of chi-square."""
    there = found.rank > 0
    there[held] = False
    if not there.any():
        return max(least, found.rest / max(found.dof, 1))
    expected = special.chdtri(found.rank[there], 0.5)
    return max(float(np.median(found.drop[there] / expected)), least)


def _joining(found: Beside, suspects: Suspects, variance: float) -> Ints:
    """In each block the suspect that stands out most, where chance does not explain it."""
    tests = int((found.rank > 0).sum())
    p = tests * chance(found.drop, found.rank, variance, found.dof)
    return suspects.farthest(np.where(p < alarms.READING, found.drop, 0.0))


def _each(base: Base, suspects: Suspects, held: Ints) -> tuple[Array, Array, Ints]:
    """Size, drop and rank of each that is held beside all others."""
    k = suspects.D.shape[3]
    if not len(held):
        return np.zeros((0, k)), np.zeros(0), np.zeros(0, np.int64)
    found = base.beside_all(suspects.rows(base, held))
    size = found.size.reshape(-1, k)
    m = len(held)
    own = found.cov.reshape(m, k, m, k)[np.arange(m), :, np.arange(m)]
    drop = np.einsum("ni,nij,nj->n", size, linear.shortest(own), size)
    return size, drop, np.array([linear.rank(one) for one in own], np.int64)


def sizes(base: Base, suspects: Suspects, held: Ints) -> Array:
    """Sizes of some suspects, estimated together beside a base, shape (m, k)."""
    return _each(base, suspects, held)[0]


def _staying(base: Base, suspects: Suspects, held: Ints, variance: float) -> Ints:
    """Those that stand out beside all others; the least goes first."""
    tests = len(suspects.blocks.index)
    while len(held):
        _, drop, rank = _each(base, suspects, held)
        p = tests * chance(drop, rank, variance, base.dof)
        if not (p >= alarms.READING).any():
            break
        held = np.delete(held, int(np.argmax(p)))
    return held


def _exchanged(base: Base, suspects: Suspects, held: Ints, variance: float) -> Ints:
    """In each block those that are likeliest together, as many as are held there or fewer."""
    for block in np.unique(suspects.blocks.index[held]):
        mine = suspects.blocks.index[held] == block
        others = np.setdiff1d(held, held[mine])
        rest = base.more(suspects.rows(base, others)) if len(others) else base
        among = np.flatnonzero(suspects.blocks.index == block)
        best = _likeliest(rest, suspects, among, held[mine], variance)
        held = np.union1d(others, best)
    return held


def _likeliest(base: Base, suspects: Suspects, among: Ints, held: Ints, variance: float) -> Ints:
    """Of a block's suspects those with the smallest loss; the ones that are held, if none is less.

    -T / v and the cost of each, T the drop of all of them together: all sets as large as what is
    held or smaller, where they are no more than `_SETS`; else the same with one of them exchanged
    or without it.
    """
    k = suspects.D.shape[3]
    found = base.beside_all(suspects.rows(base, among))

    def losses(places: Ints) -> Array:
        m = places.shape[1]
        own = found.parts((places[:, :, None] * k + np.arange(k)).reshape(len(places), -1))
        drop = own.drop / variance
        return np.asarray(m * cost(drop / m, own.rank / m) - drop)

    mine = np.searchsorted(among, held)
    tried = [(losses(sets), sets) for sets in _sets(len(among), mine)]
    loss, sets = min(tried, key=lambda one: float(one[0].min()))
    least = int(np.argmin(loss))
    return held if loss[least] > losses(mine[None])[0] - _SAME else among[sets[least]]


def _sets(n: int, held: Ints) -> list[Ints]:
    """Sets of n suspects that may stand in the place of those that are held, by their size."""
    sizes = range(1, len(held) + 1)
    if sum(comb(n, m) for m in sizes) <= _SETS:
        return [np.array(list(combinations(range(n), m))) for m in sizes]
    fewer = [np.delete(held, place) for place in range(len(held))]
    free = np.setdiff1d(np.arange(n), held)
    swapped = [np.append(rest, one) for rest in fewer for one in free]
    return [np.array(sets) for sets in (fewer, swapped) if len(sets) and sets[0].size]
