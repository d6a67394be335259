"""Poses to measure, for a shipped problem, a problem file, or as continuation of a campaign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base import files
from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError, listed
from pipeline.base.toml import LARGEST_TEXT, given, merged
from pipeline.design import spec as specs
from pipeline.design.adapted import suited
from pipeline.design.finished import FinishedDesign, make
from pipeline.design.planfile import plan_text
from pipeline.design.prior_information import continued, information_of
from pipeline.design.problem import Problem, build
from pipeline.design.search import Effort
from pipeline.library.campaign import Campaign
from pipeline.machine.robot import Robot, load
from pipeline.machine.robot.variants import alike
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.system.fit import fit


@dataclass(frozen=True, eq=False)
class Design(Locked):
    """Poses to measure, and their distance from the optimum.

    Attributes:
        q: Joint values of each pose [m] or [rad], shape (p, n).
        anchor_m: Anchor of the chain [m], F_b, shape (3,).
        steps_n: Load steps of each pose [N]; negative where the turnbuckle is slackened to it.
        figure: The criterion, in its unit ([m] for a test pose).
        bound: Lower bound for any plan, same unit; None where it was not reached.
        relative_std: Standard uncertainty of each compliance over its nominal size, shape (n,).
        made: The whole design, for the measurement sheet.
    """

    q: Array
    anchor_m: Array
    steps_n: tuple[Array, ...]
    figure: float
    bound: float | None
    relative_std: Array
    made: FinishedDesign

    @property
    def robot(self) -> Robot:
        """The robot of the plan."""
        return self.made.proposal.problem.robot

    @property
    def plan(self) -> str:
        """The plan file, for `pipeline simulate --plan` and `pipeline init --plan`."""
        name = self.made.proposal.problem.spec.name
        return plan_text(self.made.proposal, f"data/plans/{name}.toml")


def design_poses(
    problem: str = "paper_reference",
    *,
    poses: int | None = None,
    readings: int | None = None,
    steps_n: Sequence[float] | None = None,
    anchor_m: Sequence[float] | None = None,
    robot: str | None = None,
    criterion: str | None = None,
    add_to: Campaign | None = None,
    seed: int = 1,
    rounds: int = 2,
    tell: Callable[[str], object] = str,
) -> Design:
    """Choose the poses to measure, as `pipeline design` does.

    Args:
        problem: One that ships, or the path of a problem file ending in .toml.
        poses: Number of poses, m_0.
        readings: Pulls in total, n.
        steps_n: Load steps [N], in the order of tightening.
        anchor_m: Fixed anchor in F_b [m].
        robot: A robot that ships, or a robot file.
        criterion: test_pose, workspace, D, A or E.
        add_to: Propose further poses for this campaign.
        seed: Determines the plan.
        rounds: Rounds of new starts.
        tell: Receives a line of progress for each better plan.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
    """
    anchor = None if anchor_m is None else dict(zip(("x_m", "y_m", "z_m"), anchor_m, strict=True))
    changes = {
        "robot": robot,
        "plan": {"poses": poses, "readings": readings},
        "pull": {"steps_n": None if steps_n is None else list(steps_n)},
        "anchor": anchor,
        "criterion": {"kind": criterion},
    }
    asked = problem_of(problem, changes)
    if add_to is not None:
        asked = added_to(asked, add_to)
    return _designed(make(asked, seed, Effort(rounds=rounds), tell))


def _designed(made: FinishedDesign) -> Design:
    """The numbers of a finished design."""
    proposal = made.proposal
    measurement, certificate = proposal.measurement, proposal.certificate
    return Design(
        measurement.q,
        np.asarray(measurement.anchor, float),
        measurement.steps,
        proposal.figure,
        None if certificate is None else certificate.figure,
        proposal.relative_std,
        made,
    )


def _text_of(name: str) -> tuple[str, Path | None]:
    """Text of a problem, and the folder of its file where it does not ship."""
    if name in specs.SHIPPED:
        return specs.shipped(name), None
    path = Path(name)
    missing = InputError(
        f'there is no design problem "{name}"',
        f"use {listed(specs.SHIPPED)}, or the path of a problem file ending in .toml",
    )
    if path.suffix != ".toml":
        raise missing
    return files.words(path, path.name, LARGEST_TEXT, missing), path.parent


def problem_of(name: str, changes: dict[str, Any]) -> Problem:
    """A problem that ships, or from a file, with the given changes.

    Raises:
        InputError: There is no such problem, it is wrong, or no plan can meet it.
    """
    text, folder = _text_of(name)
    if changes.get("robot") and name in specs.SHIPPED:  # only the paper's own goes to its limits
        own = {k: specs.Limits.model_fields[k].default for k in specs.MARGINS}
        changes = changes | {"limits": own | (changes.get("limits") or {})}
    if (robot := changes.get("robot")) and Path(robot).is_file():  # relative to the current folder
        changes = changes | {"robot": str(Path(robot).resolve())}
    spec = specs.parse(text, Path(name).name)
    if robot and name == _PAPER and not alike(load(spec.robot), other := load(changes["robot"])):
        changes = merged(suited(spec, other), given(changes))
    spec = specs.revised(spec, given(changes))
    return build(spec, load(spec.robot, folder))


_PAPER = "paper_reference"
"""The problem that other robots start from."""


def added_to(problem: Problem, campaign: Campaign, name: str | None = None) -> Problem:
    """The problem for further readings of a campaign, with the information of its existing ones.

    Args:
        problem: What to measure.
        campaign: What was measured.
        name: Of the plan; that of the campaign with `_next` when not given.

    Raises:
        InputError: The campaign cannot be read, or problem and campaign do not fit together.
    """
    raw = campaign.raw
    further = build(
        continued(problem.spec, raw.settings, name or f"{campaign.name}_next"), raw.robot
    )
    case = ingested(raw)
    found = fit(case, bring(case))
    known = information_of(found.system, found.estimate, further.experiment.scale)
    return replace(further, known=known)
