"""Check that some pose keeps the limits; if not, find the limit that excludes all."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.base.quantities import plain
from pipeline.design.descent import descend
from pipeline.design.information import station
from pipeline.design.limits import narrow, penalty, slacks
from pipeline.design.problem import Problem
from pipeline.design.room import Room
from pipeline.design.space import PlanCoordinates
from pipeline.design.spec import Limits

_TRIED, _FOLLOWED = 2000, 64
"""Number of random poses, and of those nearest to the limits that are moved inside [1]."""

_ANY_M = (0.0, 1e5)
"""Shortest and longest chain [m] where its length does not matter."""


def check_reachable(problem: Problem, rng: np.random.Generator) -> None:
    """Refuse a problem whose limits exclude every pose.

    Args:
        problem: The problem.
        rng: Draws the poses that are tried.

    Raises:
        InputError: Names the limit that excludes every pose and by how much.
    """
    start = rng.uniform(size=(_TRIED, PlanCoordinates(problem, 1).size))
    room = problem.room
    if _shortfall(problem, problem.limits, room, start) <= 0:
        return
    for alone in _one_by_one(problem.limits):
        short = _shortfall(problem, alone, None, start)
        if short > 0:
            raise _refusal(problem, alone, short)
    for rule in room.rules if room else ():
        short = _shortfall(
            problem, Limits(chain_m=_ANY_M, singular_margin=0), room and room.only(rule), start
        )
        if short > 0:
            raise _misses(rule, short, "correct [cell], [tool] or the capsules of the robot file")
    raise InputError(
        "no pose keeps all limits at once, though each alone can be kept",
        "relax one of them, or let the anchor move",
    )


def _shortfall(problem: Problem, limits: Limits, room: Room | None, start: Array) -> float:
    """Smallest violation of the limits over all poses [m] or [1]; 0 when a pose keeps them."""
    box = PlanCoordinates(problem, 1)

    def worst(x: Array) -> Array:
        at = box.stations(x)
        least: Array = np.min([slack.value for slack in slacks(limits, at)], axis=0)
        for gap in narrow(room, at):
            np.minimum.at(least, gap.pose, gap.value)
        return least

    def function(x: Array) -> tuple[Array, Array]:
        broken, by_q, by_anchor = penalty(limits, box.stations(x), room)
        return broken, box.slopes(by_q, by_anchor)

    left = worst(start)
    if left.max() >= 0:
        return 0.0
    near = start[np.argsort(-left)[:_FOLLOWED]]
    return max(0.0, -float(worst(descend(function, near, rounds=200).x).max()))


def _one_by_one(limits: Limits) -> list[Limits]:
    names = (
        "singular_margin",
        "flange_above_m",
        "effector_above_m",
        "chain_clearance_m",
        "pull_within_deg",
    )
    rules = {name: getattr(limits, name) for name in names}
    alone = [{name: at, "chain_m": _ANY_M} for name, at in rules.items() if at is not None]
    none = {"singular_margin": 0.0}
    return [Limits.model_validate(none | rule) for rule in ({"chain_m": limits.chain_m}, *alone)]


def _refusal(problem: Problem, limits: Limits, short: float) -> InputError:
    shortest, longest = problem.limits.chain_m
    if limits.chain_m == (shortest, longest):
        where = ", ".join(
            f"{a:g}" if a == b else f"{a:g} to {b:g}"
            for a, b in zip(problem.anchor_lower, problem.anchor_upper, strict=True)
        )
        return InputError(
            f"the anchor at ({where}) m is out of reach: a chain of {shortest:g} to {longest:g} m "
            f"misses every pose by {plain(short, 2)} m",
            "move the anchor, or change limits.chain_m",
        )
    q = np.zeros((1, problem.robot.n))
    rule = [slack.rule for slack in slacks(limits, station(problem.experiment, q, np.ones(3)))][-1]
    return _misses(rule, short, "relax that limit or limits.joints, or let the anchor move")


def _misses(rule: str, short: float, way_out: str) -> InputError:
    return InputError(
        f"no pose within the joint limits keeps {rule}: the best one misses it by "
        f"{plain(short, 2)}",
        way_out,
    )
