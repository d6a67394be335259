"""What `pipeline design` does: problem in, plan out, the best so far when it is interrupted."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.design import problem as problems
from pipeline.design.problem import Problem
from pipeline.design.propose import Proposal, propose
from pipeline.design.search import Effort
from pipeline.errors import InputError, listed
from pipeline.report.numbers import percent, plain
from pipeline.robot import load as load_robot

MM = 1e3


@dataclass(frozen=True, eq=False)
class Made:
    """A finished or interrupted design.

    Attributes:
        proposal: The best plan, with its certificate where that was reached.
        seconds: Wall time.
        interrupted: The search did not run to its end.
    """

    proposal: Proposal
    seconds: float
    interrupted: bool

    def content(self) -> dict[str, Any]:
        """What --json prints; figures of a criterion without unit have no `_mm`."""
        problem, plan = self.proposal.problem, self.proposal.plan
        steps = problem.spec.pull.steps_n
        factor, unit = (MM, "_mm") if problem.criterion.unit == "m" else (1.0, "")
        certificate = self.proposal.certificate
        content = {
            "poses": printed(problem, plan.q).tolist(),
            "repeats": problem.repeats,
            "anchor": plan.anchor.tolist(),
            "pull_n": max(steps),
            f"epsilon{unit}": factor * plan.figure,
            f"bound{unit}": None if certificate is None else factor * certificate.figure,
            "efficiency": self.proposal.efficiency,
            "seconds": round(self.seconds, 3),
        }
        return content | ({"steps_n": steps} if len(steps) > 1 else {})

    def as_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.content(), ensure_ascii=False, allow_nan=False)

    def as_text(self) -> str:
        """For people: figure, bound, poses and what they determine."""
        return "\n".join([*_summary(self), "", *_poses(self.proposal), "", *_joints(self.proposal)])


def run(
    name: str, changes: dict[str, Any], seed: int, rounds: int, say: Callable[[str], None]
) -> Made:
    """Design a plan.

    Args:
        name: A problem that ships, or a problem file.
        changes: What the command line says otherwise, as in the file; None is no change.
        seed: Determines the plan.
        rounds: Rounds of new starts.
        say: Takes one line of progress at a time.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
        KeyboardInterrupt: Stopped before there was any plan.
    """
    began = time.perf_counter()
    best: Proposal | None = None
    interrupted = False
    try:
        for best in propose(find(name, changes), seed, Effort(rounds=rounds)):
            say(f"{best.done}: {_figures(best)}")
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
    assert best is not None  # propose gives a plan or raises
    return Made(best, time.perf_counter() - began, interrupted)


def find(name: str, changes: dict[str, Any]) -> Problem:
    """A problem that ships, or from a file, with what the command line says otherwise.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
    """
    if name in problems.SHIPPED:
        text, folder = problems.shipped(name), None
    else:
        path = Path(name)
        if path.suffix != ".toml" or not path.is_file():
            raise InputError(
                f'there is no design problem "{name}"',
                f"use {listed(problems.SHIPPED)}, or the path of a problem file ending in .toml",
            )
        text, folder = path.read_text("utf-8-sig"), path.parent
    spec = problems.revised(problems.parse(text, Path(name).name), given(changes))
    return problems.build(spec, load_robot(spec.robot, folder))


def given(changes: dict[str, Any]) -> dict[str, Any]:
    """The changes without what was not said."""
    inner = {k: given(v) if isinstance(v, dict) else v for k, v in changes.items()}
    return {key: value for key, value in inner.items() if value not in (None, {})}


def printed(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Joint values as people read them: m and degrees, six decimals."""
    return np.where(problem.robot.prismatic, q, np.rad2deg(q)).round(6)


def _figures(proposal: Proposal) -> str:
    criterion, plan = proposal.problem.criterion, proposal.plan
    mm = criterion.unit == "m"
    text = f"{plain(plan.figure * (MM if mm else 1), 4)}{' mm' if mm else ''}"
    if proposal.certificate is None or proposal.efficiency is None:
        return text
    bound = plain(proposal.certificate.figure * (MM if mm else 1), 4)
    return f"{text}, no plan can be below {bound}: efficiency {percent(proposal.efficiency, 4)}"


def _summary(made: Made) -> list[str]:
    problem, proposal = made.proposal.problem, made.proposal
    steps = ", ".join(f"{step:g}" for step in problem.spec.pull.steps_n)
    anchor = ", ".join(f"{x:.3f}" for x in proposal.plan.anchor)
    lines = [
        f"{problem.spec.name}: {problem.readings} readings in {problem.poses} poses, "
        f"{problem.repeats} x ({steps} N), anchor at ({anchor}) m, {made.seconds:.1f} s",
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
    joints = proposal.problem.robot.joints
    head = ["pose", *(f"{j.name} {'m' if j.prismatic else 'deg'}" for j in joints)]
    rows = [
        [f"{number:4d}", *(f"{value:.3f}" for value in row)]
        for number, row in enumerate(printed(proposal.problem, proposal.plan.q), 1)
    ]
    return [" ".join(f"{cell:>11}" for cell in row) for row in [head, *rows]]


def _joints(proposal: Proposal) -> list[str]:
    said = [
        f"{joint.name} {percent(std)}"
        for joint, std in zip(
            proposal.problem.robot.joints, proposal.plan.relative_std, strict=True
        )
    ]
    return [f"standard uncertainty of the compliances: {', '.join(said)}"]
