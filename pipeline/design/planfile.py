"""A proposal as the plan that `pipeline simulate` rehearses and `pipeline init` prepares."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.base import toml
from pipeline.base.shown import typed
from pipeline.design.finished import figures, printed
from pipeline.design.propose import BoundedPlan
from pipeline.design.spec import ProblemFile
from pipeline.machine.surroundings import tooled

MADE_BY = "# Made by `pipeline design"
"""First words of a plan that a new design may replace."""

_HEADER = """\
{made_by} {problem}{by}`: {figure}.
# Rehearse it:        pipeline simulate {file} --name {rehearsal}
# Prepare its folder: pipeline init {typed} --plan {file}
"""


def plan_text(proposal: BoundedPlan, file: str, by: str = "") -> str:
    """The plan as TOML, joint values in m and degrees.

    Args:
        proposal: The design.
        file: Path of the plan, for the commands in its header.
        by: Options with which the problem file next to it gives this plan again.
    """
    name = proposal.problem.spec.name
    words = {"typed": typed(name), "file": typed(file), "by": by}
    words |= {"problem": typed(problem_file(file)), "rehearsal": typed(f"{name}-rehearsal")}
    header = _HEADER.format(made_by=MADE_BY, figure=figures(proposal), **words)
    return header + toml.dumps(plan_content(proposal))


def problem_file(plan: str) -> str:
    """Path of the problem file of a plan, as it was solved: to be run again, or changed."""
    return f"{plan.removesuffix('.toml')}.problem.toml"


def problem_text(spec: ProblemFile) -> str:
    """A problem as it was solved, including the effects of options, robot and time."""
    apart = {"design", "cell", "tool_acceptance", "tool_capsules"}
    content = spec.model_dump(exclude_unset=True, exclude_none=True, exclude=apart)
    content["robot"] = _file_name(spec.robot)
    return toml.dumps({**content, **tooled(content["tool"], spec)})


def _file_name(robot: str) -> str:
    """A robot's name; for a robot file, its name in the folder of the plan."""
    return robot.replace("\\", "/").rpartition("/")[2]


def plan_content(proposal: BoundedPlan) -> dict[str, Any]:
    """The entries of the plan; what the problem does not state keeps the simulator's default."""
    spec, (every, approach) = proposal.problem.spec, proposal.stands()
    q = printed(proposal.problem, every)
    content: dict[str, Any] = {
        "name": spec.name,
        "robot": _file_name(spec.robot),
        "seed": 1,
        "poses": {"q": q.tolist(), "approach": approach.astype(int).tolist()},
        "pulls": _pulls(proposal),
        **tooled({name: list(at) for name, at in spec.tool.items()}, spec),
        "tracker": _tracker(proposal),
        "scale": _scale(proposal),
    }
    if spec.test_pose:
        first = spec.test_pose[0]
        content["test_pose"] = {first.key: first.said, "force_n": list(first.force_n)}
    return content


def _pulls(proposal: BoundedPlan) -> dict[str, Any]:
    problem, measurement = proposal.problem, proposal.measurement
    steps: dict[str, Any]
    more = 0 if proposal.unpulled is None else len(proposal.unpulled.q)
    if proposal.mixed is None and not more:
        steps = {"steps_n": problem.spec.pull.steps_n, "repeats": problem.repeats}
    else:
        steps = {"pose_steps_n": [own.tolist() for own in measurement.steps] + [[]] * more}
    return steps | {
        "zero": problem.spec.noise.zero,
        "anchors": [measurement.anchor.tolist()],
        "anchor": [0] * (len(measurement.q) + more),
    }


def _scale(proposal: BoundedPlan) -> dict[str, float]:
    """Noise of the scale where the problem states one; no real scale has none."""
    noise = proposal.problem.spec.noise
    entries = {"sigma_n": noise.scale_sigma_n, "sigma_rel": noise.scale_sigma_rel}
    return entries if any(entries.values()) else {}


def _tracker(proposal: BoundedPlan) -> dict[str, Any]:
    """The instrument; a sigma of a displacement is divided among its readings."""
    noise = proposal.problem.spec.noise
    sigma_m = noise.reading_sigma_m
    if noise.displacement_sigma_m is not None:
        readings = 1.5 if noise.zero == "before_after" else 2.0
        sigma_m = noise.displacement_sigma_m / np.sqrt(readings)
    position, beam = list(noise.tracker_position_m), noise.model_dump()["tracker"]
    return toml.given({"position": position, "sigma_m": sigma_m, "noise": beam})
