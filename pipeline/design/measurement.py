"""The operator's actions: poses in order, the carriage's approach and the load steps of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.design.discriminate import CauseTests, Detectability, detectabilities, rows
from pipeline.design.information import station
from pipeline.design.problem import Problem
from pipeline.design.schedule import crossed, starts
from pipeline.design.search import Plan
from pipeline.design.trade import CompromisePlan


@dataclass(frozen=True, eq=False)
class Measurement(Locked):
    """A plan with all actions.

    Attributes:
        q: Joint values [m] or [rad], shape (m, n).
        anchor: Anchor of the chain in F_b [m], shape (3,).
        approach: Direction from which the carriage comes along the rail, +1 or -1, shape (m,).
        steps: Load steps of each pose [N]; negative where the turnbuckle is slackened to the step.
    """

    q: Array
    anchor: Array
    approach: Array
    steps: tuple[Array, ...]

    @property
    def hardest_n(self) -> float:
        """The largest force of all load steps [N]."""
        return max(float(np.abs(steps).max()) for steps in self.steps)


def of_plan(problem: Problem, plan: Plan) -> Measurement:
    """The measurement of a plan: every pose with all steps, approaches crossed with the pull."""
    direction = station(problem.experiment, plan.q, plan.anchor).direction.T
    ways = {"up": np.ones(len(plan.q)), "down": -np.ones(len(plan.q))}
    approach = ways.get(problem.spec.limits.approach, crossed(direction, plan.q[:, 0]))
    steps = np.tile(np.array(problem.spec.pull.steps_n), problem.repeats)
    return Measurement(plan.q, plan.anchor, approach, (steps,) * len(plan.q))


def of_mixed(problem: Problem, mixed: CompromisePlan) -> Measurement:
    """The measurement of a plan with diagnostic power, sorted along the rail."""
    visits = mixed.visits
    if problem.robot.joints[0].prismatic:
        visits = tuple(visits[i] for i in np.argsort([visit.q[0] for visit in visits]))
    q, approach = (np.array([getattr(v, name) for v in visits]) for name in ("q", "approach"))
    steps = tuple(visit.steps for visit in visits)
    return Measurement(problem.as_printed(q), mixed.anchor, approach, steps)


def seen_by(view: CauseTests, measurement: Measurement) -> list[Detectability]:
    """Detectability of every cause with a measurement, each pose at its own time."""
    start_s = starts(np.array([len(own) for own in measurement.steps]), len(view.cell.tool.targets))
    M = np.zeros((view.springs + len(view.typical),) * 2)
    for steps in dict.fromkeys(tuple(own) for own in measurement.steps):
        which = np.array([tuple(own) == steps for own in measurement.steps])
        q, approach = measurement.q[which], measurement.approach[which]
        X = rows(view, q, measurement.anchor, approach, np.array(steps), start_s[which])
        M += np.einsum("mri,mrj->ij", X, X)
    return detectabilities(view, M)
