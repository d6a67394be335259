"""What `pipeline design` does: problem in, plan out, the best so far when it is interrupted."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base import files
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.base.quantities import percent, plain
from pipeline.design import spec as specs
from pipeline.design.known import continued, information_of
from pipeline.design.planfile import plan_text
from pipeline.design.problem import Problem, build
from pipeline.design.propose import Proposal, propose
from pipeline.design.search import Effort
from pipeline.machine.cell import paper_cell
from pipeline.machine.robot import load as load_robot
from pipeline.run import reduce
from pipeline.store.campaign import Campaign, dump
from pipeline.tables import conform

MM = 1e3
MADE_BY = "# Made by `pipeline design"


@dataclass(frozen=True, eq=False)
class Made:
    """A finished or interrupted design.

    Attributes:
        proposal: The best plan, with its certificate where that was reached.
        seconds: Wall time.
        interrupted: The search did not run to its end.
        written: Files that were made of it.
    """

    proposal: Proposal
    seconds: float
    interrupted: bool
    written: tuple[Path, ...] = ()

    def content(self) -> dict[str, Any]:
        """What --json prints; figures of a criterion without unit have no `_mm`."""
        proposal = self.proposal
        problem, measurement = proposal.problem, proposal.measurement
        factor, unit = (MM, "_mm") if problem.criterion.unit == "m" else (1.0, "")
        certificate = proposal.certificate
        content = {
            "poses": printed(problem, measurement.q).tolist(),
            "repeats": problem.repeats,
            "anchor": measurement.anchor.tolist(),
            "pull_n": max(float(np.abs(steps).max()) for steps in measurement.steps),
            f"epsilon{unit}": factor * proposal.figure,
            f"bound{unit}": None if certificate is None else factor * certificate.figure,
            "efficiency": proposal.efficiency,
            "seconds": round(self.seconds, 3),
        }
        if proposal.mixed is not None:
            content["repeats"] = 1
            content[f"pure_epsilon{unit}"] = factor * proposal.plan.figure
            content["named"] = proposal.mixed.named
        if proposal.mixed is not None or len(problem.spec.pull.steps_n) > 1:
            content["steps_n"] = [steps.tolist() for steps in measurement.steps]
            content["approach"] = measurement.approach.astype(int).tolist()
        return content

    def as_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.content(), ensure_ascii=False, allow_nan=False)

    def as_text(self) -> str:
        """For people: figure, bound, poses and what they determine."""
        parts = [_summary(self), _poses(self.proposal), _joints(self.proposal)]
        parts += [[str(path) for path in self.written]] if self.written else []
        return "\n\n".join("\n".join(part) for part in parts)


def run(
    name: str,
    changes: dict[str, Any],
    seed: int,
    rounds: int,
    say: Callable[[str], None],
    campaign: Campaign | None = None,
) -> Made:
    """Design a plan.

    Args:
        name: A problem that ships, or a problem file.
        changes: What the command line says otherwise, as in the file; None is no change.
        seed: Determines the plan.
        rounds: Rounds of new starts.
        say: Takes one line of progress at a time.
        campaign: Readings that are there already; the plan adds to them.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
        KeyboardInterrupt: Stopped before there was any plan.
    """
    began = time.perf_counter()
    best: Proposal | None = None
    interrupted = False
    try:
        problem, known = find(name, changes), None
        if campaign is not None:
            problem, known = added_to(problem, campaign)
        for best in propose(problem, seed, Effort(rounds=rounds), known):
            say(f"{best.done}: {_figures(best)}")
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
        say("Stopped; this is the best plan so far, it takes a moment to write.")
    assert best is not None  # propose gives a plan or raises
    return Made(best, time.perf_counter() - began, interrupted)


def find(name: str, changes: dict[str, Any]) -> Problem:
    """A problem that ships, or from a file, with what the command line says otherwise.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
    """
    if name in specs.SHIPPED:
        text, folder = specs.shipped(name), None
    else:
        path = Path(name)
        if path.suffix != ".toml" or not path.is_file():
            raise InputError(
                f'there is no design problem "{name}"',
                f"use {listed(specs.SHIPPED)}, or the path of a problem file ending in .toml",
            )
        text, folder = path.read_text("utf-8-sig"), path.parent
    spec = specs.revised(specs.parse(text, Path(name).name), given(changes))
    return build(spec, load_robot(spec.robot, folder))


def added_to(problem: Problem, campaign: Campaign) -> tuple[Problem, Array]:
    """The problem for further readings of a campaign, and the information of those it has.

    Raises:
        InputError: The campaign cannot be read, or problem and campaign do not fit together.
    """
    raw = campaign.read()
    spec = continued(problem.spec, raw.settings, f"{campaign.name}_next")
    further = build(spec, raw.robot)
    data = reduce(raw, lambda _, table, promise: conform(table, promise).to_pandas()).data
    cell = paper_cell(raw.robot, further.tool)
    return further, information_of(cell, data, further.experiment.scale)


def given(changes: dict[str, Any]) -> dict[str, Any]:
    """The changes without what was not said."""
    inner = {k: given(v) if isinstance(v, dict) else v for k, v in changes.items()}
    return {key: value for key, value in inner.items() if value not in (None, {})}


def printed(problem: Problem, q: Array) -> Array:
    """Joint values as people read them: m and degrees, six decimals."""
    return np.asarray(np.where(problem.robot.prismatic, q, np.rad2deg(q)).round(6))


def _figures(proposal: Proposal) -> str:
    factor, unit = (MM, " mm") if proposal.problem.criterion.unit == "m" else (1.0, "")
    text = f"{plain(proposal.figure * factor, 4)}{unit}"
    if proposal.mixed is not None:
        more = proposal.figure / proposal.plan.figure
        text += f" ({plain(more, 3)} times the best plan for this alone)"
    if proposal.certificate is None or proposal.efficiency is None:
        return text
    bound = plain(proposal.certificate.figure * factor, 4)
    return f"{text}, no plan can be below {bound}: efficiency {percent(proposal.efficiency, 4)}"


def _summary(made: Made) -> list[str]:
    problem, proposal = made.proposal.problem, made.proposal
    measurement = proposal.measurement
    anchor = ", ".join(f"{x:.3f}" for x in measurement.anchor)
    lines = [
        f"{problem.spec.name}: {problem.readings} readings in {len(measurement.q)} poses at up to "
        f"{max(float(np.abs(s).max()) for s in measurement.steps):g} N, anchor at ({anchor}) m, "
        f"{made.seconds:.1f} s",
        f"{problem.criterion.meaning}: {_figures(proposal)}",
    ]
    if proposal.certificate is not None:
        certificate = proposal.certificate
        lines.append(
            f"the bound rests on a numerical search for the worst direction: {certificate.starts} "
            f"starts, {percent(certificate.agreeing)} of them ended at its highest peak"
        )
    return lines


def _poses(proposal: Proposal) -> list[str]:
    joints, measurement = proposal.problem.robot.joints, proposal.measurement
    head = ["pose", *(f"{j.name} {'m' if j.prismatic else 'deg'}" for j in joints), "steps N"]
    rows = [
        [f"{number:4d}", *(f"{value:.3f}" for value in row), ", ".join(f"{s:g}" for s in steps)]
        for number, (row, steps) in enumerate(
            zip(printed(proposal.problem, measurement.q), measurement.steps, strict=True), 1
        )
    ]
    return [" ".join(f"{cell:>11}" for cell in row) for row in [head, *rows]]


def _joints(proposal: Proposal) -> list[str]:
    said = [
        f"{joint.name} {percent(std)}"
        for joint, std in zip(proposal.problem.robot.joints, proposal.relative_std, strict=True)
    ]
    return [f"standard uncertainty of the compliances: {', '.join(said)}"]


def write(root: Path, made: Made, seed: int) -> Made:
    """Write plan file, measurement sheet and pictures of a design.

    Args:
        root: The project's root: data/plans/NAME.toml and reports/plans/NAME.
        made: The design.
        seed: Of its searches; the curves use it too.

    Raises:
        UsageError: A plan of that name was written by hand.
    """
    from pipeline.report.plan_files import plan_files  # matplotlib takes half a second to import

    name = made.proposal.problem.spec.name
    plan, folder = root / "data" / "plans" / f"{name}.toml", root / "reports" / "plans" / name
    if plan.exists() and not plan.read_text("utf-8").startswith(MADE_BY):
        raise UsageError(f"{plan} was written by hand: choose another --name")
    text = plan_text(made.proposal, f"data/plans/{name}.toml", _figures(made.proposal))
    files.write(plan, text.encode())
    content = made.content()
    for inner, data in plan_files(made.proposal, made.seconds, seed).items():
        files.write(folder / inner, data)
    files.write(folder / "design.json", dump(content))
    return replace(made, written=(plan, folder / "sheet.html", folder / "sheet.pdf"))
