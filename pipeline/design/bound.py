"""Lower bound of the figure of any plan, from the continuous design.

Let g be the criterion's information function and Z a support of it at some information M
(see `Criterion.support`). Then for every plan of m_0 poses, whatever its poses and their anchor,

    g(M_plan) <= trace(Z M_plan) <= m_0 max_q trace(Z I(q)),

so that figure >= (m_0 max_q trace(Z I(q)))^(-1/2). At the optimal continuous design the bound is
tight (general equivalence theorem). Every Z gives a valid bound; the maximum over q, the worst
direction, is searched numerically from many starts, and the bound is valid as far as that search
has found the highest peak.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.design.criteria import Criterion
from pipeline.design.descent import descend
from pipeline.design.information import information, value_and_slope
from pipeline.design.limits import penalty
from pipeline.design.problem import Problem
from pipeline.design.space import PlanCoordinates

_WALL = 1e3
"""Weight of violated limits in the search for the worst direction; overshooting only lowers the
bound."""
_GAP = 5e-4
"""Relative distance of the best bound from the continuous design at which to stop [1]."""


@dataclass(frozen=True, eq=False)
class LowerBound:
    """Lower bound of the figure of any plan, and how it was found.

    Attributes:
        figure: Lower bound of the criterion, in its unit.
        continuous: Figure of the best continuous design found; the bound cannot be above it.
        rounds: Number of worst directions that were searched.
        starts: Starts of the deciding search.
        agreeing: Fraction of the starts of the deciding search that ended at its highest peak.
    """

    figure: float
    continuous: float
    rounds: int
    starts: int
    agreeing: float


@dataclass(frozen=True, eq=False)
class WorstDirection(Locked):
    """The result of one search for the worst direction.

    Attributes:
        most: Largest trace(Z I(q)) found.
        informations: I of the best distinct poses, shape (c, n, n).
        starts: Number of starts.
        agreeing: Fraction of the starts that ended at the largest value.
    """

    most: float
    informations: Array
    starts: int
    agreeing: float


_Oracle = Callable[[Array, bool], WorstDirection]
"""From Z (n, n), and whether to search harder than usual: the pose with the largest
trace(Z I(q))."""


def certify(
    problem: Problem, pool: Array, rng: np.random.Generator, rounds: int = 20, starts: int = 128
) -> Iterator[LowerBound]:
    """Lower bounds of the figure of every plan of the problem, each at least as good as the last.

    The limit on the uncertainty of single compliances is dropped, and with a free anchor every pose
    may have its own: both only lower the bound.

    Args:
        problem: The problem.
        pool: Good poses with their anchors, unit coordinates of plans of one pose, (p, d).
        rng: Draws the starts.
        rounds: Maximum number of searches.
        starts: Random starts of each search, in addition to the good poses found so far.
    """
    oracle = _Directions(problem, rng, starts, pool)
    first = information(problem.experiment, PlanCoordinates(problem, 1).stations(pool))
    yield from bounds(problem.criterion, first, problem.poses, oracle, rounds, problem.known)


def bounds(
    criterion: Criterion,
    informations: Array,
    poses: int,
    oracle: _Oracle,
    rounds: int = 20,
    known: Array | float = 0.0,
    steps: int = 3000,
) -> Iterator[LowerBound]:
    """Alternate between the best weights of some poses and the pose that would add most.

    A bound becomes the best one only after a second, harder search for the worst direction.

    Args:
        criterion: The criterion to minimise.
        informations: I of the initial poses, shape (c, n, n).
        poses: m_0.
        oracle: Searches the worst direction.
        rounds: Maximum number of searches.
        known: Prior information, shape (n, n).
        steps: Maximum number of steps for the weights; fewer give a valid but lower bound.
    """
    candidates, highest, continuous = informations, 0.0, np.inf
    deciding = WorstDirection(np.inf, informations[:0], 0, 0.0)
    for done in range(1, rounds + 1):
        weights = _best_weights(criterion, candidates, poses, known, steps)
        M = known + poses * np.einsum("c,cij->ij", weights, candidates)
        continuous = min(continuous, float(criterion.figure(M[None])[0]))
        Z = criterion.support(M[None])[0]
        worst = oracle(Z, False)
        if _bound(Z, known, poses, worst) > highest:
            worst = oracle(Z, True)
        if _bound(Z, known, poses, worst) > highest:
            highest, deciding = _bound(Z, known, poses, worst), worst
        yield LowerBound(highest, continuous, done, deciding.starts, deciding.agreeing)
        if highest >= (1 - _GAP) * continuous:
            return
        candidates = np.concatenate([candidates[weights > 1e-6], worst.informations])


def _bound(Z: Array, known: Array | float, poses: int, worst: WorstDirection) -> float:
    return float((np.sum(Z * known) + poses * worst.most) ** -0.5)


def _best_weights(
    criterion: Criterion, candidates: Array, poses: int, known: Array | float, steps: int
) -> Array:
    """Weights (c,) of candidate poses for the best continuous design; multiplicative steps."""
    weights = np.full(len(candidates), 1 / len(candidates))
    flat = poses * candidates.reshape(len(candidates), -1)
    score = criterion.smooth or criterion.score
    for _ in range(steps):
        M = known + (weights @ flat).reshape(candidates.shape[1:])
        S = score(M[None])[1][0]
        gain = flat @ S.ravel()
        average = weights @ gain
        weights = weights * (gain / average) ** 0.7
        weights /= weights.sum()
        if gain.max() < (1 + _GAP / 5) * average:
            break
    return weights


class _Directions:
    """The numerical search for the worst direction; good starts are kept for the next one."""

    def __init__(
        self, problem: Problem, rng: np.random.Generator, starts: int, pool: Array
    ) -> None:
        self.problem, self.rng, self.starts = problem, rng, starts
        self.box = PlanCoordinates(problem, 1)
        self.kept = pool[:32]

    def __call__(self, Z: Array, hard: bool) -> WorstDirection:
        """Search from random poses and from the good ones of earlier searches."""
        starts = self.starts * (4 if hard else 1)
        start = np.vstack([self.rng.uniform(size=(starts, self.box.size)), self.kept])
        scale = -1 / self._loss(start, Z)[0].min()
        found = descend(lambda x: self._loss(x, Z * scale), start, rounds=250, gain=1e-7)
        most = -float(found.value.min())
        order = np.argsort(found.value)
        self.kept = _distinct(found.x[order])[:48]
        return WorstDirection(
            most=most / scale,
            informations=information(self.problem.experiment, self.box.stations(self.kept)),
            starts=len(start),
            agreeing=float(np.mean(found.value < -most * (1 - 1e-4))),
        )

    def _loss(self, x: Array, Z: Array) -> tuple[Array, Array]:
        """Violated limits minus trace(Z I), (k,), and its gradient (k, d), at poses (k, d)."""
        at = self.box.stations(x)
        gain, by_q, by_anchor = value_and_slope(self.problem.experiment, at, Z)
        broken, q_slope, anchor_slope = penalty(
            self.problem.limits, at, self.problem.room, margin=0.0
        )
        slopes = self.box.slopes(_WALL * q_slope - by_q, _WALL * anchor_slope - by_anchor)
        return _WALL * broken - gain, slopes


def _distinct(x: Array, apart: float = 1e-3) -> Array:
    """Rows that differ from every better row, among the first hundred."""
    chosen: list[Array] = []
    for row in x[:100]:
        if all(np.abs(row - other).max() > apart for other in chosen):
            chosen.append(row)
    return np.array(chosen)
