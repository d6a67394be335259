"""Trade-off between the criterion and the number of identifiable causes, for sixteen readings.

A cause counts if the plan distinguishes it at its typical size from every rival by 4.6 standard
uncertainties; its forms count once, and so do twins, which no pull at the tip can separate. The
number of causes without a twin is stated as well.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from pipeline.design.discriminate import cause_tests
from pipeline.design.library import problem_of
from pipeline.design.measurement import of_plan, seen_by
from pipeline.design.problem import Problem
from pipeline.design.propose import propose
from pipeline.design.search import Effort, Plan, rounded, search
from pipeline.design.trade import trade
from pipeline.report.svg import BLUE, GREEN, MUTED, STYLE

SEEDS = (1, 2)
ALLOWED = (1.05, 1.1, 1.25, 1.5, 2.0)
READINGS = (8, 16, 32)
PICTURE = Path(__file__).parents[1] / "docs" / "figures" / "design-tradeoff.svg"
Counts = tuple[int, int]
"""Causes identified at typical size, twins counted as one; those among them without a twin."""


def run() -> Iterable[tuple[str, float, str]]:
    """The shipped problem from several seeds, then the price of naming, then more readings."""
    for seed in SEEDS:
        problem = problem_of("diagnosis_reference", {})
        *_, last = propose(problem, seed)
        named, alone = _counted(problem, [sight.named_from for sight in last.sights()])
        ratio = last.figure / last.plan.figure
        comment = f"aim >= 25; {alone} without twins; epsilon {ratio:.3f} of the optimum"
        yield f"16 readings, seed {seed}: causes named", named, comment
    plan = _optimum(problem)
    sights = seen_by(cause_tests(problem), of_plan(problem, plan))
    named, alone = _counted(problem, [sight.named_from for sight in sights])
    yield "16 readings, pure optimum: causes named", named, f"{alone} without twins"
    price = [_traded(problem, plan, allowed) for allowed in ALLOWED]
    for allowed, (named, alone) in zip(ALLOWED, price, strict=True):
        yield f"  epsilon up to {allowed:g} times", named, f"{alone} without twins"
    more = []
    for readings in READINGS:
        changes = {
            "plan": {"poses": readings, "readings": readings},
            "diagnosis": {"poses": readings - 1},
        }
        sized = problem_of("diagnosis_reference", changes)
        more.append(_traded(sized, _optimum(sized), 1.25))
        comment = f"{more[-1][1]} without twins; {readings - 1} poses"
        yield f"  {readings} readings, epsilon up to 1.25 times", more[-1][0], comment
    _draw(price, more)


def _counted(problem: Problem, named_from: list[float]) -> Counts:
    """Counts from sizes in the order of the lens; causes that no pull can show do not count."""
    names = cause_tests(problem).names
    good = [size <= 1 for size in named_from[: len(names)]]
    return sum(good), sum(g and " = " not in name for g, name in zip(good, names, strict=True))


def _optimum(problem: Problem) -> Plan:
    *_, last = search(problem, np.random.default_rng(SEEDS[0]), Effort(first=0, rounds=1))
    assert last.best is not None
    return rounded(problem, last.best)


def _traded(problem: Problem, plan: Plan, allowed: float) -> Counts:
    assert problem.spec.diagnosis is not None
    asked = problem.spec.diagnosis.model_copy(update={"allowed": allowed})
    *_, best = trade(cause_tests(problem), plan, asked, np.random.default_rng(SEEDS[0]), restarts=1)
    return _counted(problem, list(best.named_from))


def _draw(price: list[Counts], more: list[Counts]) -> None:
    with rc_context(STYLE):
        canvas = Figure(figsize=(6.4, 2.9))
        left, right = canvas.subplots(1, 2, sharey=True)
        views = (
            (left, ALLOWED, price, "Epsilon allowed over the optimum's, 16 readings"),
            (right, READINGS, more, "Readings, epsilon up to 1.25 times"),
        )
        for axes, x, counts, label in views:
            named, alone = np.array(counts).T
            axes.plot(x, named, color=BLUE, marker="o", markersize=4, label="twins as one")
            axes.plot(x, alone, color=GREEN, marker="s", markersize=4, label="without twins")
            axes.axhline(25, color=MUTED, linewidth=0.8, linestyle="--")
            axes.set_xlabel(label)
        left.set_xscale("log")
        left.set_xticks(ALLOWED, [f"{x:g}" for x in ALLOWED], fontsize=7)
        left.set_xticks([], [], minor=True)
        left.set_ylim(0)
        left.set_ylabel("Causes named at typical size")
        left.legend(loc="lower right")
        PICTURE.parent.mkdir(exist_ok=True)
        canvas.savefig(PICTURE, metadata={"Date": None})
