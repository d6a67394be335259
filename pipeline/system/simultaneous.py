"""Find which of many suspects are at work together: each is tested given all that are held.

Testing one suspect after the other fails where several are at work: those not yet held widen the
scatter that each is judged by. Here the scatter is a median, which up to half of the readings
cannot move (Hampel, J. Am. Stat. Assoc. 69, 1974); significant suspects join block by block, and
after each round every held one is tested again given the others: it stays, is dropped, or is
exchanged for a better one of its block (forward search with deletion; Atkinson and Riani, Robust
Diagnostic Regression Analysis, 2000).
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
from pipeline.system.blocks import Blocks
from pipeline.system.odds import DECIDES
from pipeline.system.score_tests import Base, ScoreTests

_TOLD = 0.37
"""Efficiency of a variance from a median of squares, as a fraction of the degrees of freedom [1]:
that of the median absolute deviation for normal errors (Rousseeuw and Croux, J. Am. Stat. Assoc.
88, 1993)."""

_AS_FAR = 0.25
"""Minimum drop, relative to the largest of all, for a suspect to join in the same round [1]: a
small one next to a large one may be an artefact of it."""

_MOST = 0.5
"""Maximum fraction of a base's degrees of freedom that suspects may take [1]; beyond it the search
stops."""

_PART = 0.01
"""Prior fraction of suspects at work [1]: the largest but one of `family._MISTAKES`."""

_EFOLDS = 10.0
"""Width of the prior of the logarithm of a size in standard deviations, in e-folds [1]."""

_SETS = 600
"""Maximum number of sets of suspects of one block that are compared; more take too long."""

_SAME = 1e-6
"""Difference of minus twice a log likelihood that counts as none [1]."""

_ROUNDS = 100
"""Maximum number of rounds of the search; each but the last changes which suspects are held."""


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
        """Columns of the chosen suspects as rows of a base, shape (M, k m)."""
        shape, k = base.blocks.shape, self.D.shape[3]
        out = np.zeros((*shape, len(chosen) * k))
        for column, one in enumerate(chosen.tolist()):
            block, place = self.blocks.index[one], self.blocks.place[one]
            out[block, : self.D.shape[1], column * k : (column + 1) * k] = self.D[block, :, place]
        return base.blocks.rows(out)

    def as_one(self, base: Base, chosen: Ints) -> ScoreTests:
        """The chosen suspects as one of m k columns beside a base, by products of their blocks."""
        m, block, (_, s, _, k) = len(chosen), self.blocks.index[chosen], self.D.shape
        D = np.moveaxis(self.D[block, :, self.blocks.place[chosen]], 1, 2)  # (m, k, s)
        g = (D @ base.left[block, :s, None]).reshape(m * k)
        QD = (D @ base.Q[block, :s]).reshape(m * k, -1)
        D = D.reshape(m * k, s)
        same = np.kron(block[:, None] == block, np.ones((k, k)))
        N = (D @ D.T) * same - (QD @ QD.T) * (same if base.own else 1.0)
        return ScoreTests(N, g, np.einsum("ms,ms->m", D, D), base.rest, base.dof)

    def beside(self, base: Base, active: Ints) -> tuple[Base, ScoreTests]:
        """The base extended by the held suspects, and every suspect tested in addition to it."""
        wider = base.more(self.rows(base, active)) if len(active) else base
        return wider, wider.beside(self.D).rows(self.blocks)

    def farthest(self, drop: Array) -> Ints:
        """The suspect of largest drop in each block, unless it may be an artefact of another."""
        best = np.zeros(self.blocks.shape[0])
        np.maximum.at(best, self.blocks.index, drop)
        least = np.maximum(best[self.blocks.index], _AS_FAR * drop.max(initial=0.0))
        return np.flatnonzero((drop > 0) & (drop >= least))

    def rivals(self, active: ActiveSuspects) -> list[Ints]:
        """For each held suspect, those that would do nearly as well in its place.

        A rival must explain nothing in addition to it; otherwise both may be at work.
        """
        left = active.others.drop < DECIDES * active.variance
        out = []
        for one in active.which:
            found = self.beside(active.given, active.which[active.which != one])[1]
            told = found.drop / active.variance
            told = np.where(found.rank > 0, told - cost(told, found.rank), -np.inf)
            near = np.flatnonzero(left & (told > told[one] - DECIDES))
            out.append(np.setdiff1d(near, active.which))
        return out


@dataclass(frozen=True, eq=False)
class ActiveSuspects(Locked):
    """Suspects that are at work together.

    Attributes:
        which: Their numbers, ascending, shape (m,).
        size: Their sizes, estimated together, shape (m, k).
        drop: Drop of the sum of squares by each given all others, shape (m,).
        rank: Number of determined directions of each, shape (m,).
        variance: Of the rows, from the median drop of all suspects that are not held.
        given: The base without them.
        base: The same with all of them.
        tests: Number of suspects that were tested.
        others: Every suspect in addition to all of them.
    """

    which: Ints
    size: Array
    drop: Array
    rank: Ints
    variance: float
    given: Base
    base: Base
    tests: int
    others: ScoreTests

    def loss(self, least: float) -> float:
        """Minus twice the log of likelihood and priors, up to a constant.

        M log v + rest / v + sum of 2 ln(1 / pi) + k ln(drop / v), v the variance of the M rows: a
        suspect is at work with probability pi, and the logarithm of its size has a flat prior.
        """
        v = max(self.base.rest / max(self.base.dof, 1), least)
        rows = self.base.dof + int(self.rank.sum())
        held = np.sum(cost(self.drop / v, self.rank))
        return float(rows * np.log(v) + self.base.rest / v + held)

    def p(self) -> Array:
        """Probability that chance makes any suspect look this large, shape (m,)."""
        return self.tests * chance(self.drop, self.rank, self.variance, self.base.dof)


def cost(drop: Array | float, rank: Array | Ints | float) -> Array:
    """Penalty of the prior on minus twice the log likelihood, Laplace's approximation.

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
    """Probability of this drop of the sum of squares by chance, with the variance from a median."""
    told = max(_TOLD * dof, 1.0)
    known = np.maximum(rank, 1)
    return np.where(rank > 0, special.fdtrc(known, told, drop / known / variance), 1.0)


def active_suspects(base: Base, suspects: Suspects, least: float) -> ActiveSuspects:
    """All suspects that are at work in addition to a base.

    The search has two starts: the scatter of the rows from their median, and the smallest possible
    scatter. The likelier end is returned: few suspects with much noise, or more with less.

    Args:
        base: Columns that are estimated in any case.
        suspects: Suspects, each within one block of the base's rows.
        least: Lower limit of the variance of the rows.
    """
    wide = _end(base, suspects, least, np.inf)
    if not len(_joining(wide.others, suspects, least)):
        return wide  # none is significant in the smallest scatter either
    return min((wide, _end(base, suspects, least, least)), key=lambda one: one.loss(least))


def _end(base: Base, suspects: Suspects, least: float, most: float) -> ActiveSuspects:
    """End of the search: none joins, leaves or is exchanged; variance at most `most` until then."""
    active, tried = np.zeros(0, np.int64), set[bytes]()
    wider, found = suspects.beside(base, active)
    for _ in range(_ROUNDS):
        variance = min(_variance(found, active, least), most)
        joined = np.union1d(active, _joining(found, suspects, variance))
        joined = _staying(base, suspects, joined, variance)
        if joined.tobytes() == active.tobytes():  # costly, seldom needed before all have joined
            joined = _exchanged(base, suspects, joined, variance)
        if joined.tobytes() in tried or joined.size * suspects.D.shape[3] > _MOST * base.dof:
            break
        tried.add(joined.tobytes())
        if joined.tobytes() != active.tobytes():
            wider, found = suspects.beside(base, joined)
        active = joined
    while True:  # held suspects that are significant in the scatter of all others, without the cap
        variance = _variance(found, active, least)
        stay = _staying(base, suspects, active, variance)
        if len(stay) == len(active):
            break
        active = stay
        wider, found = suspects.beside(base, active)
    size, drop, rank = _each(base, suspects, active)
    tests = int((found.rank > 0).sum()) + len(active)
    return ActiveSuspects(active, size, drop, rank, variance, base, wider, tests, found)


def _variance(found: ScoreTests, active: Ints, least: float) -> float:
    """Median drop of the suspects that are not held, over that of chi-square."""
    there = found.rank > 0
    there[active] = False
    if not there.any():
        return max(least, found.rest / max(found.dof, 1))
    expected = special.chdtri(found.rank[there], 0.5)
    return max(float(np.median(found.drop[there] / expected)), least)


def _joining(found: ScoreTests, suspects: Suspects, variance: float) -> Ints:
    """The most significant suspect of each block, where chance does not explain it."""
    tests = int((found.rank > 0).sum())
    p = tests * chance(found.drop, found.rank, variance, found.dof)
    return suspects.farthest(np.where(p < alarms.READING, found.drop, 0.0))


def _each(base: Base, suspects: Suspects, active: Ints) -> tuple[Array, Array, Ints]:
    """Size, drop and rank of each held suspect given all others."""
    k = suspects.D.shape[3]
    if not len(active):
        return np.zeros((0, k)), np.zeros(0), np.zeros(0, np.int64)
    found = suspects.as_one(base, active)
    return _members(found.size, found.cov, len(active))


def _members(size: Array, cov: Array, m: int) -> tuple[Array, Array, Ints]:
    """Size, drop and rank of each of the m members of a suspect given the others, (..., m)."""
    size = size.reshape(*size.shape[:-1], m, -1)
    k = size.shape[-1]
    cov = cov.reshape(*size.shape[:-2], m, k, m, k)
    own = np.einsum("...aiaj->...aij", cov)
    drop = np.einsum("...i,...ij,...j->...", size, linear.shortest(own), size)
    return size, drop, linear.ranks(own)


def sizes(base: Base, suspects: Suspects, active: Ints) -> Array:
    """Sizes of some suspects, estimated together with a base, shape (m, k)."""
    return _each(base, suspects, active)[0]


def _staying(base: Base, suspects: Suspects, active: Ints, variance: float) -> Ints:
    """Those that are significant given all others; the least significant is dropped first."""
    tests, k, anew = len(suspects.blocks.index), suspects.D.shape[3], True
    while len(active):
        if anew:  # and wherever the readings do not determine all of them
            found = suspects.as_one(base, active)
            size, cov, anew = found.size, found.cov, bool(found.rank < len(found.g))
        _, drop, rank = _members(size, cov, len(active))
        p = tests * chance(drop, rank, variance, base.dof)
        if not (p >= alarms.READING).any():
            break
        least = int(np.argmax(p))
        active = np.delete(active, least)
        if not anew:
            size, cov = linear.without(size, cov, k * least + np.arange(k))
    return active


def _exchanged(base: Base, suspects: Suspects, active: Ints, variance: float) -> Ints:
    """The likeliest set of each block, as large as what is held there or smaller."""
    k = suspects.D.shape[3]
    for block in np.unique(suspects.blocks.index[active]):
        mine = suspects.blocks.index[active] == block
        others = np.setdiff1d(active, active[mine])
        among = np.flatnonzero(suspects.blocks.index == block)
        beside = suspects.as_one(base, np.append(others, among)).without(len(others) * k)
        best = _likeliest(beside, k, among, active[mine], variance)
        active = np.union1d(others, best)
    return active


def _likeliest(found: ScoreTests, k: int, among: Ints, active: Ints, variance: float) -> Ints:
    """The suspects of a block with the smallest loss; those that are held, if none is smaller.

    The loss is -T / v plus the cost of each, T the drop of the set. All sets as large as what is
    held or smaller are compared, if they are no more than `_SETS`; otherwise those with one member
    exchanged or dropped.

    Args:
        found: All suspects of the block, of k columns each, as one.
        k: Columns of a suspect.
        among: Their numbers, shape (n,).
        active: Numbers of those that are held.
        variance: Variance of the rows.
    """

    def losses(places: Ints) -> Array:
        own = found.parts((places[:, :, None] * k + np.arange(k)).reshape(len(places), -1))
        _, drop, rank = _members(own.size, own.cov, places.shape[1])
        return np.asarray(cost(drop / variance, rank).sum(axis=-1) - own.drop / variance)

    mine = np.searchsorted(among, active)
    tried = [(losses(sets), sets) for sets in _sets(len(among), mine)]
    loss, sets = min(tried, key=lambda one: float(one[0].min()))
    least = int(np.argmin(loss))
    return active if loss[least] > losses(mine[None])[0] - _SAME else among[sets[least]]


def _sets(n: int, active: Ints) -> list[Ints]:
    """Candidate sets of n suspects to replace those that are held, by their size."""
    sizes = range(1, len(active) + 1)
    if sum(comb(n, m) for m in sizes) <= _SETS:
        return [np.array(list(combinations(range(n), m))) for m in sizes]
    fewer = [np.delete(active, place) for place in range(len(active))]
    free = np.setdiff1d(np.arange(n), active)
    swapped = [np.append(rest, one) for rest in fewer for one in free]
    return [np.array(sets) for sets in (fewer, swapped) if len(sets) and sets[0].size]
