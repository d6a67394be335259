"""Detectors of wear: the fleet's model, trends per joint, and comparison of two campaigns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from bench.fleet.world import YEAR, Robot
from pipeline.answer.contract import Stiffness
from pipeline.base.arrays import Array
from pipeline.fleet.history import changes
from pipeline.fleet.wear.alarm import A_YEAR, interim_tests
from pipeline.fleet.wear.machine import Machine, Repair, Visit
from pipeline.fleet.wear.scatter import scatter

SCATTER = 0.01
"""Day-to-day scatter assumed by the simple detectors [1]."""

Detector = Callable[[Sequence[Robot], int], list[bool]]
"""Function of the robots and the number of campaigns of each; returns whether each is in alarm."""


def model(robots: Sequence[Robot], count: int) -> list[bool]:
    """The project's own: one model of the whole fleet, which estimates the scatter itself."""
    machines = [machine(one, count, str(k)) for k, one in enumerate(robots)]
    found = scatter(machines)
    return [any(look.alarm for look in interim_tests(one, found)) for one in machines]


def machine(robot: Robot, count: int, name: str) -> Machine:
    """A robot's first campaigns, with the repairs until then."""
    visits = [Visit(f"c{k}", robot.day[k] / YEAR, robot.x[k], robot.cov) for k in range(count)]
    last = robot.day[count - 1]
    return Machine.of(
        name, visits, [Repair(day / YEAR, (joint,)) for day, joint in robot.repairs if day < last]
    )


def trends(robots: Sequence[Robot], count: int) -> list[bool]:
    """A weighted line per joint, Bonferroni over joints, the same error spending over looks."""
    return [_sloped(one, count) for one in robots] if count > 2 else [False] * len(robots)


def _sloped(robot: Robot, count: int) -> bool:
    t, x = robot.day[:count] / YEAR, robot.x[:count]
    since = t[-1] - (t[-2] if count > 3 else t[0])
    limit = stats.norm.isf(A_YEAR * min(since, 1.0) / 2 / x.shape[1])
    return any(abs(_slope(t, x[:, j], robot.cov[j, j])) > limit for j in range(x.shape[1]))


def _slope(t: Array, x: Array, variance: float) -> float:
    """Slope over its standard uncertainty."""
    use = np.isfinite(x)
    if use.sum() < 3:
        return 0.0
    sigma = np.full(int(use.sum()), np.sqrt(variance + (SCATTER * np.nanmean(x)) ** 2))
    (slope, _), cov = np.polyfit(t[use], x[use], 1, w=1 / sigma, cov="unscaled")
    return float(slope / np.sqrt(cov[0, 0]))


def pairs(robots: Sequence[Robot], count: int) -> list[bool]:
    """The newest campaign compared with the previous one, as in reports, with known scatter."""
    return [_changed(one, count, SCATTER) for one in robots]


def pairs_as_they_are(robots: Sequence[Robot], count: int) -> list[bool]:
    """The same, without knowledge of the scatter."""
    return [_changed(one, count, 0.0) for one in robots]


def _changed(robot: Robot, count: int, more: float) -> bool:
    if count < 2:
        return False
    before, after = (_stiffness(robot, k, more) for k in (count - 2, count - 1))
    return any(change.sure for change in changes(before, after))


def _stiffness(robot: Robot, k: int, more: float) -> list[Stiffness]:
    """Stiffnesses as in an answer, with the scatter included in their standard uncertainties."""
    std = np.sqrt(np.diag(robot.cov) + (more * robot.x[k]) ** 2)
    return [
        Stiffness.model_construct(
            name=f"k_{j}", compliance=x, compliance_std=s, value=1 / x, identifiable=True
        )
        for j, (x, s) in enumerate(zip(robot.x[k].tolist(), std.tolist(), strict=True))
        if np.isfinite(x)
    ]


DETECTORS: dict[str, Detector] = {
    "model": model,
    "trends": trends,
    "pairs": pairs,
    "pairs_as_they_are": pairs_as_they_are,
}
