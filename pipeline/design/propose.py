"""From a problem to a plan with its certificate, best so far at any moment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.design.bound import Certificate, certify
from pipeline.design.problem import Problem
from pipeline.design.search import Effort, Plan, Progress, found, rounded, search
from pipeline.results import Array


@dataclass(frozen=True, eq=False)
class Proposal:
    """A plan and how near it is to the best that could be.

    Attributes:
        problem: What it was made for.
        plan: Poses and anchor, rounded as they are printed.
        certificate: Lower bound of the figure; None while it is not yet computed.
        done: What has been done, for a line of progress.
    """

    problem: Problem
    plan: Plan
    certificate: Certificate | None
    done: str

    @property
    def efficiency(self) -> float | None:
        """Lower bound over figure: at most one."""
        return None if self.certificate is None else self.certificate.figure / self.plan.figure


def propose(
    problem: Problem, seed: int, effort: Effort | None = None, known: Array | None = None
) -> Iterator[Proposal]:
    """Search a plan, then bound how good any plan could be; each proposal replaces the last.

    Args:
        problem: What to plan.
        seed: Determines the plan.
        effort: How hard to search.
        known: Information that earlier readings gave, shape (n, n).

    Raises:
        InputError: No plan meets the request; says why and what to change.
    """
    effort = effort or Effort()
    for_search, for_bound = np.random.default_rng(seed).spawn(2)
    progress: Progress | None = None
    plan: Plan | None = None
    for progress in search(problem, for_search, effort, known):
        if progress.best is not None:
            plan = rounded(problem, progress.best, known)
            yield Proposal(problem, plan, None, f"round {progress.round} of {progress.rounds}")
    assert progress is not None  # a search has at least one round
    plan = plan or found(problem, progress)
    pool, rounds, starts = progress.pool, effort.bounds, effort.directions
    for certificate in certify(problem, pool, for_bound, rounds, starts, known):
        yield Proposal(problem, plan, certificate, f"bound, search {certificate.rounds}")
