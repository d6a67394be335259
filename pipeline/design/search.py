"""Search the poses: descend from many starts together, exchange single poses, descend again.

The same seed gives the same plan; no decision depends on a clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError
from pipeline.base.quantities import plain
from pipeline.design import criteria
from pipeline.design.descent import Function, descend
from pipeline.design.feasible import check_reachable
from pipeline.design.information import information, station, value_and_slope
from pipeline.design.limits import kept, penalty
from pipeline.design.problem import Problem
from pipeline.design.space import PlanCoordinates

_SOFT, HARD = 50.0, 2e4
"""Weight of violated limits during exploration, and for the final descent [1]."""
_QUICKER = 3
"""Factor by which the first round follows fewer plans to their end."""
_ROUNDED = 1e-9
"""Tolerance of limits for rounding of unit coordinates [m or rad]."""
_STD_MARGIN = 0.995
"""Fraction of the largest allowed uncertainty that the search aims at [1]."""


@dataclass(frozen=True, eq=False)
class Effort:
    """Search effort.

    Attributes:
        first: Poses in all starts of a quick round before the others, so that a plan is available
            after seconds; 0 for none.
        rounds: Number of rounds with new starts.
        poses: Poses in all starts of a round together.
        settled: Number of the best starts that are followed to their end.
        exchanged: Number of those in which single poses are exchanged.
        bounds: Number of searches for a worst direction, for the certificate.
        directions: Starts of each of them.
        gain: Minimum gain of a step in the log of the figure, or it counts as none.
    """

    first: int = 192
    rounds: int = 2
    poses: int = 768
    settled: int = 48
    exchanged: int = 8
    bounds: int = 20
    directions: int = 128
    gain: float = 1e-9


@dataclass(frozen=True, eq=False)
class Plan(Locked):
    """Poses, their anchor, and their value.

    Attributes:
        q: Joint values [m] or [rad], shape (m_0, n).
        anchor: Anchor of the chain in F_b [m], shape (3,).
        M: Information about the scaled compliances, shape (n, n).
        figure: The criterion, in its unit.
        relative_std: Standard uncertainty of each compliance over its nominal size, shape (n,).
        kept: Whether it keeps every limit of its problem.
    """

    q: Array
    anchor: Array
    M: Array
    figure: float
    relative_std: Array
    kept: bool


@dataclass(frozen=True, eq=False)
class _Progress(Locked):
    """Progress of a search.

    Attributes:
        round: Rounds done.
        rounds: Rounds in total.
        best: The best plan so far, None when no plan yet keeps all limits.
        pool: Good poses with their anchors in unit coordinates, for the certificate, (p, n + f).
        nearest: The latest plan whose least certain compliance is known best, for when there is no
            `best`.
    """

    round: int
    rounds: int
    best: Plan | None
    pool: Array
    nearest: Plan


def search(
    problem: Problem, rng: np.random.Generator, effort: Effort | None = None
) -> Iterator[_Progress]:
    """Search the plan with the smallest figure; yield the best so far twice per round.

    Args:
        problem: The problem.
        rng: Draws the starts.
        effort: Search effort.

    Raises:
        InputError: No pose keeps the limits; says which limit excludes them.
    """
    effort = effort or Effort()
    box = PlanCoordinates(problem, problem.poses)
    soft, hard = (objective(problem, weight) for weight in (_SOFT, HARD))
    check_reachable(problem, rng)
    best: Plan | None = None
    x = np.empty((0, box.size))
    looks = [(effort.first, _QUICKER)] * bool(effort.first) + [(effort.poses, 1)] * effort.rounds
    for done, (poses, share) in enumerate(looks, 1):
        settled, exchanged = -(-effort.settled // share), -(-effort.exchanged // share)
        start = rng.uniform(size=(max(32, poses // problem.poses), box.size))
        near = descend(soft, start, rounds=160, gain=1e-5)
        x = np.vstack([x, near.x[np.argsort(near.value)[:settled]]])
        best, nearest = _best(evaluate(problem, *box.opened(x)), best)
        yield _Progress(done, len(looks), best, _single(box, x), nearest)
        far = descend(hard, x, rounds=600, gain=effort.gain)
        x = far.x[np.argsort(far.value)][:settled]
        changed = _exchange(box, x[:exchanged])
        x = np.vstack([descend(hard, changed, rounds=600, gain=effort.gain / 100).x, x])
        best, nearest = _best(evaluate(problem, *box.opened(x)), best)
        yield _Progress(done, len(looks), best, _single(box, x), nearest)


def _best(plans: list[Plan], best: Plan | None) -> tuple[Plan | None, Plan]:
    """The best plan that keeps all limits, and the one with the smallest largest uncertainty."""
    kept_ones = [p for p in (best, *plans) if p and p.kept]
    nearest = min(plans, key=lambda plan: float(plan.relative_std.max()))
    return min(kept_ones, key=lambda plan: plan.figure, default=None), nearest


def objective(problem: Problem, weight: float) -> Function:
    """Log of the figure plus penalties, with its gradient, over unit coordinates of whole plans.

    Args:
        problem: The problem.
        weight: Of violated limits.
    """
    box, criterion, experiment = (
        PlanCoordinates(problem, problem.poses),
        problem.criterion,
        problem.experiment,
    )
    poses, n = problem.poses, problem.robot.n

    def function(x: Array) -> tuple[Array, Array]:
        at = box.stations(x)
        M = problem.known + information(experiment, at).reshape(len(x), poses, n, n).sum(axis=1)
        log_g, S = criterion.score(M)
        unseen, slope = _unseen(problem, M)
        W = np.repeat(slope - S / 2, poses, axis=0)
        _, by_q, by_anchor = value_and_slope(experiment, at, W)
        broken, q_slope, anchor_slope = penalty(problem.limits, at, problem.room)
        value = unseen - log_g / 2 + weight * broken.reshape(len(x), poses).sum(axis=1)
        return value, box.slopes(by_q + weight * q_slope, by_anchor + weight * anchor_slope)

    return function


def _unseen(problem: Problem, M: Array) -> tuple[Array, Array]:
    """Penalty on compliances that stay too uncertain, (k,), and its derivative by M, (k, n, n)."""
    most_std = problem.limits.max_relative_std * _STD_MARGIN
    Q = linear.regular_inverse(M)
    variance = np.einsum("kii->ki", Q)
    variance = np.where(variance > 0, variance, np.inf)
    over = np.maximum(np.log(variance) - 2 * np.log(most_std), 0.0)
    pull = 2 * _SOFT * over / variance
    return _SOFT * (over**2).sum(axis=1), -np.einsum("kij,kj,kjl->kil", Q, pull, Q)


def _exchange(box: PlanCoordinates, x: Array, most: int = 600) -> Array:
    """Swap single poses for poses of other plans, as long as a swap improves a plan.

    Args:
        box: That of the plans.
        x: Unit coordinates of plans, best first, shape (k, d).
        most: Maximum number of poses of other plans that are tried.
    """
    q, anchor = box.opened(x)
    problem, pool = box.problem, q.reshape(-1, q.shape[-1])[:most]
    changed = [_swapped(problem, a, b, pool) for a, b in zip(q, anchor, strict=True)]
    return box.closed(np.array(changed), anchor)


def _swapped(problem: Problem, q: Array, anchor: Array, pool: Array, rounds: int = 4) -> Array:
    experiment, limits, room = problem.experiment, problem.limits, problem.room
    at = station(experiment, pool, anchor)
    there, cost = information(experiment, at), _SOFT * penalty(limits, at, room)[0]
    for _ in range(rounds):
        at = station(experiment, q, anchor)
        here, own = information(experiment, at), _SOFT * penalty(limits, at, room)[0]
        total = here.sum(axis=0) + problem.known
        M = total - here[:, None] + there
        tried = _loss(problem, M.reshape(-1, *total.shape)).reshape(M.shape[:2])
        tried = tried + cost + own.sum() - own[:, None]
        out, into = np.unravel_index(np.nanargmin(tried), tried.shape)
        if not tried[out, into] < _loss(problem, total[None])[0] + own.sum() - 1e-9:
            break
        q = q.copy()
        q[out] = pool[into]
    return q


def _loss(problem: Problem, M: Array) -> Array:
    return _unseen(problem, M)[0] - problem.criterion.score(M)[0] / 2


def evaluate(problem: Problem, q: Array, anchor: Array) -> list[Plan]:
    """Evaluate plans.

    Args:
        problem: The problem.
        q: Joint values of each plan [m] or [rad], shape (k, m_0, n).
        anchor: Anchors [m], shape (k, 3).
    """
    k, poses, n = q.shape
    at = station(problem.experiment, q.reshape(-1, n), np.repeat(anchor, poses, axis=0))
    M = information(problem.experiment, at).reshape(k, poses, n, n).sum(axis=1) + problem.known
    figure, std = problem.criterion.figure(M), criteria.relative_std(M)
    inside = ((q > problem.lower - _ROUNDED) & (q < problem.upper + _ROUNDED)).all(axis=(1, 2))
    good = kept(problem.limits, at, problem.room).reshape(k, poses).all(axis=1) & inside
    good &= (std <= problem.limits.max_relative_std).all(axis=1) & np.isfinite(figure)
    return [Plan(q[i], anchor[i], M[i], float(figure[i]), std[i], bool(good[i])) for i in range(k)]


def rounded(problem: Problem, plan: Plan) -> Plan:
    """The plan as it is printed: 1e-6 m and 1e-6 degrees, poses sorted along a rail."""
    q = plan.q[np.argsort(plan.q[:, 0])] if problem.robot.joints[0].prismatic else plan.q
    return evaluate(problem, problem.as_printed(q)[None], plan.anchor.round(6)[None])[0]


def undetermined(problem: Problem, nearest: Plan) -> InputError:
    """The error where even the plan with the smallest uncertainties leaves a joint undetermined."""
    worst = int(np.argmax(nearest.relative_std))
    joint, spec = problem.robot.joints[worst], problem.spec
    return InputError(
        f"no plan of {spec.plan.readings} readings at up to {max(spec.pull.steps_n):g} N "
        f"determines every joint: the best one knows the compliance of {joint.name} to "
        f"{plain(nearest.relative_std[worst], 2)} of its nominal size, "
        f"limits.max_relative_std allows {spec.limits.max_relative_std:g}",
        "pull harder, plan more readings, or allow more",
    )


def _single(box: PlanCoordinates, x: Array) -> Array:
    """The poses of plans, each with its anchor, as plans of one pose."""
    q, anchor = box.opened(x)
    alone = PlanCoordinates(box.problem, 1)
    return alone.closed(q.reshape(-1, 1, q.shape[-1]), np.repeat(anchor, box.poses, axis=0))
