"""A finished or interrupted design, as JSON and as text."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from typing import Any

from pipeline.base.arrays import Array
from pipeline.base.quantities import percent, plain
from pipeline.base.shown import in_json
from pipeline.design.arm import bodied
from pipeline.design.problem import Problem
from pipeline.design.propose import BoundedPlan, propose
from pipeline.design.room import unchecked
from pipeline.design.search import Effort
from pipeline.design.unpulled import Unpulled
from pipeline.machine.robot import axes
from pipeline.machine.robot.axes import in_log_units

_MM = 1e3
"""Millimetres in a metre."""


@dataclass(frozen=True, eq=False)
class FinishedDesign:
    """A finished or interrupted design.

    Attributes:
        proposal: The best plan, with its certificate where that was reached.
        seconds: Wall time.
        interrupted: Whether the search was stopped before its end.
        written: Files that were made of it.
    """

    proposal: BoundedPlan
    seconds: float
    interrupted: bool
    written: tuple[PathLike[str], ...] = ()

    def content(self) -> dict[str, Any]:
        """Content of the output of --json; figures of a criterion without unit have no `_mm`."""
        proposal = self.proposal
        problem, measurement = proposal.problem, proposal.measurement
        factor, unit = (_MM, "_mm") if problem.criterion.unit == "m" else (1.0, "")
        certificate = proposal.certificate
        content = {
            "poses": printed(problem, measurement.q).tolist(),
            "repeats": problem.repeats if proposal.mixed is None else 1,
            "anchor": measurement.anchor.tolist(),
            "pull_n": measurement.hardest_n,
            f"epsilon{unit}": factor * proposal.figure,
            f"bound{unit}": None if certificate is None else factor * certificate.figure,
            "efficiency": proposal.efficiency,
            "seconds": round(self.seconds, 3),
        }
        content |= _cell(proposal, factor, unit) | _unpulled(proposal)
        if proposal.mixed is not None:
            content[f"pure_epsilon{unit}"] = factor * proposal.plan.figure
            content["named"] = proposal.mixed.named
        if proposal.mixed is not None or len(problem.spec.pull.steps_n) > 1:
            content["steps_n"] = [steps.tolist() for steps in measurement.steps]
            content["approach"] = measurement.approach.astype(int).tolist()
        return content

    def as_json(self) -> str:
        """One line of JSON."""
        return in_json(self.content())

    def as_text(self) -> str:
        """Text for people: figure, bound, poses and the uncertainties they give."""
        parts = [
            _summary(self),
            cell_lines(self.proposal),
            _poses(self.proposal),
            [*_unpulled_lines(self.proposal), *_poses_without_a_pull(self.proposal)],
            _joints(self.proposal),
        ]
        parts += [[str(path) for path in self.written]] if self.written else []
        return "\n\n".join("\n".join(part) for part in parts if part)


def make(
    problem: Problem, seed: int, effort: Effort, say: Callable[[str], object]
) -> FinishedDesign:
    """Search a plan; if stopped by Ctrl-C, return the best so far.

    Args:
        problem: The problem.
        seed: Determines the plan.
        effort: Search effort.
        say: Receives one line of progress at a time.

    Raises:
        InputError: No plan meets the request.
        KeyboardInterrupt: Stopped before there was any plan.
    """
    began = time.perf_counter()
    best: BoundedPlan | None = None
    interrupted = False
    try:
        for best in propose(problem, seed, effort):
            say(f"{best.done}: {figures(best)}")
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
        say("Stopped; this is the best plan so far, it takes a moment to write.")
    assert best is not None  # propose gives a plan or raises
    return FinishedDesign(best, time.perf_counter() - began, interrupted)


def printed(problem: Problem, q: Array) -> Array:
    """Joint values as people read them: m and degrees, six decimals."""
    return in_log_units(problem.robot, q).round(6)


def figures(proposal: BoundedPlan) -> str:
    """The criterion, its lower bound, and the price of separating causes."""
    factor, unit = (_MM, " mm") if proposal.problem.criterion.unit == "m" else (1.0, "")
    text = f"{plain(proposal.figure * factor, 4)}{unit}"
    if proposal.mixed is not None:
        more = proposal.figure / proposal.plan.figure
        text += f" ({plain(more, 3)} times the best plan for this alone)"
    if proposal.certificate is None or proposal.efficiency is None:
        return text
    bound = plain(proposal.certificate.figure * factor, 4)
    return f"{text}, no plan can be below {bound}: efficiency {percent(proposal.efficiency, 4)}"


def _summary(made: FinishedDesign) -> list[str]:
    proposal, measurement = made.proposal, made.proposal.measurement
    spec = proposal.problem.spec
    anchor = ", ".join(f"{x:.3f}" for x in measurement.anchor)
    lines = [
        f"{spec.name}: {spec.plan.readings} readings in {len(measurement.q)} poses at up to "
        f"{measurement.hardest_n:g} N, anchor at ({anchor}) m, {made.seconds:.1f} s",
        f"{proposal.problem.criterion.meaning}: {figures(proposal)}",
    ]
    if (found := proposal.certificate) is not None:
        lines.append(
            f"the bound rests on a numerical search for the worst direction: {found.starts} "
            f"starts, {percent(found.agreeing)} of them ended at its highest peak"
        )
    return lines


def _cell(proposal: BoundedPlan, factor: float, unit: str) -> dict[str, Any]:
    """Cost of the limits of the cell; empty for a problem without a cell."""
    problem, found = proposal.problem, proposal.cost
    if problem.spec.cell is None:
        return {}
    content: dict[str, Any] = {"not_checked": list(_unchecked(problem))}
    if found is not None:
        content |= {
            f"free_epsilon{unit}": factor * found.figure,
            f"free_bound{unit}": factor * found.bound,
            "excluded": dict(found.excluded),
            "left": found.left,
        }
    return {"cell": content}


def _unpulled(proposal: BoundedPlan) -> dict[str, Any]:
    """Poses without a pull and their value for the DH parameters; empty without them."""
    if (found := proposal.unpulled) is None:
        return {}
    return {
        "unloaded": {
            "poses": printed(proposal.problem, found.q).tolist(),
            "table_relative_std": found.figure,
            "table_relative_std_without": found.without,
            "bound": found.bound,
            "offered": found.offered,
        }
    }


def _unpulled_lines(proposal: BoundedPlan) -> list[str]:
    """The same in a sentence."""
    if (found := proposal.unpulled) is None:
        return []
    few = "1 pose" if len(found.q) == 1 else f"{len(found.q)} poses"
    return [f"{few} more, unloaded, to identify the DH parameters: {worth_unpulled(found)}"]


def worth_unpulled(found: Unpulled) -> str:
    """Value of poses without a pull, and its distance from the best possible."""
    return (
        f"with them the standard uncertainty of the DH parameters is {percent(found.figure)} of "
        f"its prior value (geometric mean), and from the loaded poses alone "
        f"{percent(found.without)}; no choice among the {found.offered} candidate poses is below "
        f"{percent(found.bound)}"
    )


def _unchecked(problem: Problem) -> tuple[str, ...]:
    if problem.spec.cell is None and problem.room is not None:
        return ("beams, chain, floor and cables: there is no [cell]",)
    robot = problem.robot
    own = bodied(robot) if problem.spec.limits.clear_of_itself else robot
    return unchecked(own, problem.spec.targets, problem.spec)


def cell_lines(proposal: BoundedPlan) -> list[str]:
    """Cost and excluded poses of the limits of the cell, and what was not checked, in sentences."""
    problem, found = proposal.problem, proposal.cost
    not_checked = f"not checked: {'; '.join(_unchecked(problem))}"
    if found is None:
        return [not_checked]
    factor, unit = (_MM, " mm") if problem.criterion.unit == "m" else (1.0, "")
    free, bound = (f"{plain(factor * one, 4)}{unit}" for one in (found.figure, found.bound))
    more = percent(proposal.plan.figure / found.figure - 1, 2)
    rules = ", ".join(f"{rule} {percent(share, 2)}" for rule, share in found.excluded)
    hulls = [f"the capsules of the robot: {problem.robot.capsules.source}"]
    return [
        f"the limits of the cell cost {more}: without them {free} was found, and no plan can be "
        f"below {bound}",
        f"of random poses {percent(found.left, 2)} keep every limit; excluded by each: {rules}",
        *(hulls if problem.robot.capsules.source else []),
        not_checked,
    ]


def _poses(proposal: BoundedPlan) -> list[str]:
    robot, measurement = proposal.problem.robot, proposal.measurement
    mapped = axes.of(robot)
    units = ["mm" if slides else "deg" for slides in mapped.slides]
    named = [f"{name} {unit}" for name, unit in zip(mapped.names, units, strict=True)]
    head = ["pose", *named, "steps N"]
    shown = axes.displayed(robot, measurement.q)
    rows = [
        [f"{number:4d}", *(f"{value:.3f}" for value in row), ", ".join(f"{s:g}" for s in steps)]
        for number, (row, steps) in enumerate(zip(shown, measurement.steps, strict=True), 1)
    ]
    return [" ".join(f"{cell:>11}" for cell in row) for row in [head, *rows]]


def _poses_without_a_pull(proposal: BoundedPlan) -> list[str]:
    if proposal.unpulled is None:
        return []
    first = len(proposal.measurement.q) + 1
    return [
        " ".join(f"{cell:>11}" for cell in [f"{number:4d}", *(f"{value:.3f}" for value in row)])
        for number, row in enumerate(
            axes.displayed(proposal.problem.robot, proposal.unpulled.q), first
        )
    ]


def _joints(proposal: BoundedPlan) -> list[str]:
    texts = [
        f"{joint.name} {percent(std)}"
        for joint, std in zip(proposal.problem.robot.joints, proposal.relative_std, strict=True)
    ]
    return [f"standard uncertainty of the compliances: {', '.join(texts)}"]
