"""The criterion along one quantity: size of the plan (Fig. 5), position of the anchor (Fig. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError
from pipeline.design.descent import descend
from pipeline.design.problem import Problem, build
from pipeline.design.search import HARD, Effort, Plan, evaluate, objective, search
from pipeline.design.space import PlanCoordinates
from pipeline.design.spec import revised

_QUICK = Effort(first=0, rounds=1, poses=192, settled=16, exchanged=4, gain=1e-6)


@dataclass(frozen=True, eq=False)
class BySize(Locked):
    """Best figures by size of the plan.

    Attributes:
        poses: m_0 of each curve, shape (a,).
        readings: n, shape (b,).
        figure: Best figure found, NaN where n cannot be shared among m_0 poses, shape (a, b).
    """

    poses: Array
    readings: Array
    figure: Array


@dataclass(frozen=True, eq=False)
class ByAnchor(Locked):
    """Best figures by one coordinate of the anchor.

    Attributes:
        axis: 0, 1, 2 for x, y, z.
        at: That coordinate [m], shape (a,).
        figure: Best figure found, NaN where none keeps the limits, shape (a,).
        fixed_poses: Figure of the plan's own poses with the anchor there, shape (a,).
    """

    axis: int
    at: Array
    figure: Array
    fixed_poses: Array


def by_size(
    problem: Problem,
    poses: Sequence[int],
    readings: Sequence[int],
    seed: int,
    own: Plan | None = None,
) -> BySize:
    """Best figure for each m_0 and n; the limit on single compliances is dropped.

    Readings share no error here, so that information is proportional to their number: the best
    poses for one n are those for every n, and one search for each m_0 is enough.

    Args:
        problem: The problem.
        poses: Values of m_0.
        readings: Values of n.
        seed: Determines the searches.
        own: The plan of the problem, if it is the best one also without that limit and with its
            hardest pull alone: its size is then not searched again.
    """
    figure = np.full((len(poses), len(readings)), np.nan)
    for i, m0 in enumerate(poses):
        shared = [j for j, n in enumerate(readings) if n % m0 == 0 and n >= 3]
        sized = {j: _sized(problem, m0, readings[j]) for j in shared}
        if not shared:
            continue
        found = own if m0 == problem.poses else None
        plan = found or _best(sized[shared[-1]], seed)
        if plan is None:
            continue
        for j in shared:
            figure[i, j] = evaluate(sized[j], plan.q[None], plan.anchor[None])[0].figure
    return BySize(np.array(poses), np.array(readings), figure)


def _sized(problem: Problem, poses: int, readings: int) -> Problem:
    changes = {
        "plan": {"poses": poses, "readings": readings},
        "pull": {"steps_n": [max(problem.spec.pull.steps_n)]},
        "limits": {"max_relative_std": 1e3},
    }
    return replace(build(revised(problem.spec, changes), problem.robot), known=problem.known)


def _best(problem: Problem, seed: int) -> Plan | None:
    try:
        *_, last = search(problem, np.random.default_rng(seed), _QUICK)
    except InputError:
        return None
    return last.best


def by_anchor(
    problem: Problem, plan: Plan, at: Array, seed: int, axis: int = 0, starts: int = 6
) -> ByAnchor:
    """Best figure with the anchor held at positions along one axis.

    Args:
        problem: The problem.
        plan: Its plan; every search also starts from its poses.
        at: Positions [m], shape (a,).
        seed: Determines the searches.
        axis: 0, 1, 2 for x, y, z.
        starts: Random starts at each position.
    """
    box, anchor = _held(problem, plan, axis, at)
    fixed, joints = box.problem, box.poses * len(box.problem.lower)
    drawn = np.random.default_rng(seed).uniform(size=(len(at), starts, joints))
    mine = box.closed(np.repeat(plan.q[None], len(at), axis=0), anchor)
    start = np.concatenate([mine[:, None, :joints], drawn], axis=1)
    there = np.broadcast_to(mine[:, None, joints:], (*start.shape[:2], mine.shape[1] - joints))
    start = np.concatenate([start, there], axis=2).reshape(-1, box.size)
    wanted = objective(fixed, HARD)

    def function(x: Array) -> tuple[Array, Array]:
        value, slope = wanted(x)
        slope[:, joints:] = 0.0  # the anchor stays where it is
        return value, slope

    found = descend(function, start, rounds=200, gain=1e-6)
    plans = evaluate(fixed, *box.opened(found.x))
    figure = np.array([p.figure if p.kept else np.inf for p in plans]).reshape(len(at), -1)
    best = figure.min(axis=1)
    own = evaluate(fixed, np.repeat(plan.q[None], len(at), axis=0), anchor)
    best[np.isinf(best)] = np.nan
    return ByAnchor(axis, at, best, np.array([one.figure for one in own]))


def _held(problem: Problem, plan: Plan, axis: int, at: Array) -> tuple[PlanCoordinates, Array]:
    """The search box with the anchor at these positions of one axis, and the anchors, (a, 3)."""
    anchor = np.tile(plan.anchor, (len(at), 1))
    anchor[:, axis] = at
    place: dict[str, Any] = dict(zip(("x_m", "y_m", "z_m"), plan.anchor.tolist(), strict=True))
    ends = sorted({float(at.min()), float(at.max())})
    place["xyz"[axis] + "_m"] = ends if len(ends) > 1 else ends[0]
    anchored = build(revised(problem.spec, {"anchor": place}), problem.robot)
    return PlanCoordinates(replace(anchored, known=problem.known), anchored.poses), anchor
