"""Cost of the limits of a cell: the figure without them, and the poses that they exclude."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.design.bound import certify
from pipeline.design.descent import descend
from pipeline.design.limits import narrow, slacks
from pipeline.design.problem import Problem, build
from pipeline.design.search import HARD, Effort, Plan, evaluate, objective, search
from pipeline.design.space import PlanCoordinates

_QUICK = Effort(first=0, rounds=1, poses=192, settled=16, exchanged=4, bounds=6, directions=64)
"""Effort of the search without the limits, which starts from scratch, too: within 1 % of a full
one."""

_LOOKED_AT = 4000
"""Number of random poses from which the excluded fraction is estimated."""


@dataclass(frozen=True)
class Cost:
    """Cost of a cell.

    Attributes:
        figure: The criterion of the best plan found without the cell's limits, in its unit: by a
            short search of its own, and by descent from the plan that keeps them.
        bound: Lower bound of the figure of any plan without them.
        excluded: Fraction of random poses, within the robot's own joint limits, that break each
            limit, whatever else they break; in words, the hardest first.
        left: Fraction that keeps all of them.
    """

    figure: float
    bound: float
    excluded: tuple[tuple[str, float], ...]
    left: float


def cost(problem: Problem, plan: Plan, rng: np.random.Generator) -> Cost | None:
    """Cost of the limits of the cell; None for a problem without a cell.

    Args:
        problem: The problem.
        plan: Its best plan, an upper bound for the figure without the limits.
        rng: Draws starts and poses.
    """
    if problem.spec.cell is None:
        return None
    free = _without(problem)
    *_, last = search(free, rng, _QUICK)
    best = min(one.figure for one in (plan, last.best, _relaxed(free, plan)) if one is not None)
    *_, certificate = certify(free, last.pool, rng, _QUICK.bounds, _QUICK.directions)
    excluded, left = _shares(problem, rng)
    return Cost(best, certificate.figure, excluded, left)


def _without(problem: Problem) -> Problem:
    """The problem in an empty cell; the tracker stays where it is."""
    limits = problem.spec.limits.model_copy(update={"clear_of_itself": False})
    spec = problem.spec.model_copy(update={"cell": None, "limits": limits})
    return replace(build(spec, problem.robot), known=problem.known)


def _relaxed(free: Problem, plan: Plan) -> Plan | None:
    """Descend from a plan without the limits of the cell."""
    box = PlanCoordinates(free, free.poses)
    start = np.clip(box.closed(plan.q[None], plan.anchor[None]), 0, 1)
    found = descend(objective(free, HARD), start)
    (best,) = evaluate(free, *box.opened(found.x))
    return best if best.kept else None


def _shares(
    problem: Problem, rng: np.random.Generator
) -> tuple[tuple[tuple[str, float], ...], float]:
    """`Cost.excluded` and `Cost.left`."""
    wide = _without(problem)
    at = PlanCoordinates(wide, 1).stations(
        rng.uniform(size=(_LOOKED_AT, PlanCoordinates(wide, 1).size))
    )
    broken = _turned_too_far(problem, wide, at.configuration.q)
    for slack in slacks(problem.limits, at):
        broken[slack.rule] = broken.get(slack.rule, np.False_) | (slack.value < 0)
    for rule in problem.room.rules if problem.room else ():
        found = [gap.pose for gap in narrow(problem.room and problem.room.only(rule), at)]
        broken[rule] = np.isin(np.arange(_LOOKED_AT), np.concatenate(found))
    every = np.any(list(broken.values()), axis=0)
    selected = [(rule, float(np.mean(which))) for rule, which in broken.items()]
    return tuple(sorted(selected, key=lambda one: -one[1])), 1 - float(every.mean())


def _turned_too_far(problem: Problem, wide: Problem, q: Array) -> dict[str, Bools]:
    """Poses beyond what cables and hoses allow, by joint."""
    limits = zip(problem.robot.joints, problem.lower, problem.upper, strict=True)
    return {
        f"{joint.name} within {np.rad2deg(low):g} to {np.rad2deg(high):g} deg": (
            (q[:, k] < low) | (q[:, k] > high)
        )
        for k, (joint, low, high) in enumerate(limits)
        if low > wide.lower[k] or high < wide.upper[k]
    }
