"""From a problem to a plan with its certificate; the best so far is available at any moment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.design.bound import LowerBound, certify
from pipeline.design.cost import Cost, cost
from pipeline.design.discriminate import Detectability, cause_tests
from pipeline.design.driven import in_order, unwound
from pipeline.design.measurement import Measurement, of_mixed, of_plan, seen_by
from pipeline.design.problem import Problem
from pipeline.design.search import Effort, Plan, rounded, search, undetermined
from pipeline.design.trade import CompromisePlan, trade
from pipeline.design.unpulled import Unpulled, unpulled


@dataclass(frozen=True, eq=False)
class BoundedPlan:
    """A plan and its distance from the optimum.

    Attributes:
        problem: The problem it solves.
        plan: The pure optimum: poses and anchor, rounded as they are printed.
        certificate: Lower bound of the figure; None while it is not yet computed.
        done: What has been done, for a line of progress.
        mixed: The plan with diagnostic power, where the problem asks for one.
        cost: Cost of the limits of the cell; None without a cell, or while not yet computed.
        unpulled: Additional poses at which only reflectors are read; None where none are requested,
            or while not yet chosen.
    """

    problem: Problem
    plan: Plan
    certificate: LowerBound | None
    done: str
    mixed: CompromisePlan | None = None
    cost: Cost | None = None
    unpulled: Unpulled | None = None

    @property
    def figure(self) -> float:
        """The criterion of the planned measurement, in its unit."""
        return (self.mixed or self.plan).figure

    @property
    def relative_std(self) -> Array:
        """Standard uncertainty of each compliance over its nominal size, shape (n,)."""
        return (self.mixed or self.plan).relative_std

    @property
    def efficiency(self) -> float | None:
        """Lower bound over figure: at most one; None while there is no bound."""
        return None if self.certificate is None else self.certificate.figure / self.figure

    @property
    def measurement(self) -> Measurement:
        """The planned measurement."""
        if self.mixed is None:
            return of_plan(self.problem, self.plan)
        return of_mixed(self.problem, self.mixed)

    def stands(self) -> tuple[Array, Array]:
        """Joint values (m, n) and approach (m,) of every pose, also of those without a pull."""
        q, way = self.measurement.q, self.measurement.approach
        if self.unpulled is None:
            return q, way
        more = np.resize([1, -1], len(self.unpulled.q))
        return np.concatenate([q, self.unpulled.q]), np.append(way, more)

    def sights(self) -> list[Detectability]:
        """Detectability of every cause with this plan."""
        return seen_by(cause_tests(self.problem), self.measurement)


def propose(problem: Problem, seed: int, effort: Effort | None = None) -> Iterator[BoundedPlan]:
    """Search a plan, then bound the figure of any plan; each proposal replaces the last.

    Args:
        problem: The problem.
        seed: Determines the plan.
        effort: Search effort.

    Raises:
        InputError: No plan meets the request; says why and what to change.
    """
    effort = effort or Effort()
    for_search, for_bound, for_trade, for_cost, for_table = np.random.default_rng(seed).spawn(5)
    plan: Plan | None = None
    for progress in search(problem, for_search, effort):
        if progress.best is not None:
            plan = rounded(problem, progress.best)
            yield BoundedPlan(problem, plan, None, f"round {progress.round} of {progress.rounds}")
    if plan is None:
        raise undetermined(problem, progress.nearest)
    q = unwound(problem, plan.q)
    plan = replace(plan, q=q[in_order(problem, q, plan.anchor)])
    proposal = BoundedPlan(problem, plan, None, "search")
    rounds, starts = effort.bounds, effort.directions
    for certificate in certify(problem, progress.pool, for_bound, rounds, starts):
        done = f"bound, search {certificate.rounds}"
        proposal = replace(proposal, certificate=certificate, done=done)
        yield proposal
    if problem.spec.cell is not None:
        proposal = replace(proposal, cost=cost(problem, plan, for_cost), done="without the cell")
        yield proposal
    if (asked := problem.spec.diagnosis) is not None:
        for mixed in trade(cause_tests(problem), plan, asked, for_trade):
            proposal = replace(proposal, mixed=mixed, done=f"exchange, {mixed.named} causes named")
            yield proposal
    if problem.spec.plan.unloaded:
        beside = unpulled(problem, proposal.measurement.q, for_table)
        yield replace(proposal, unpulled=beside, done="unloaded poses")
