"""A virtual campaign from Python: the files an operator would bring back, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.base import files
from pipeline.base.errors import InputError
from pipeline.base.toml import LARGEST_TEXT, given
from pipeline.library.campaign import Campaign, load_campaign
from pipeline.machine.robot import load as load_robot
from pipeline.simulate import Plan, RawCampaign, parse, revised, simulate, with_noise


@dataclass(frozen=True, eq=False)
class Simulated:
    """A virtual campaign.

    Attributes:
        campaign: Its files, as from a real cell.
        truth: Its true values, as in data/processed/NAME.truth.json.
    """

    campaign: Campaign
    truth: Mapping[str, Any]


def simulate_campaign(
    plan: Path | str | None = None,
    *,
    name: str | None = None,
    robot: str | None = None,
    seed: int | None = None,
    poses: int | None = None,
    load: str | None = None,
    steps_n: Sequence[float] | None = None,
    effects: Sequence[str] | None = None,
    stiffness_spread: float | None = None,
    noise: str | None = None,
    exact: bool = False,
) -> Simulated:
    """Simulate a campaign of a virtual cell in memory, as `pipeline simulate` does.

    Args:
        plan: Path of a plan file; the plan of the demo when not given.
        name: Of the campaign.
        robot: A robot that ships, or a robot file.
        seed: Determines every byte.
        poses: Number of feasible poses to draw.
        load: chain, weights or payloads.
        steps_n: Load steps [N], in the order of tightening.
        effects: Hidden causes and blunders, NAME[:where][=size], size in SI or like 2x.
        stiffness_spread: Maximum relative deviation of the true stiffnesses from nominal.
        noise: paper, instrument, or metres per axis.
        exact: Readings without noise, all digits written.

    Raises:
        InputError: The plan cannot be carried out.
        UsageError: An effect has no such name.
    """
    changes = {
        "name": name,
        "robot": robot,
        "seed": seed,
        "poses": {"count": poses},
        "pulls": {"load": load, "steps_n": None if steps_n is None else list(steps_n)},
        "hidden": {
            "stiffness_spread": stiffness_spread,
            "effects": None if effects is None else list(effects),
        },
    }
    path = None if plan is None else Path(plan)
    made = carried_out(plan_for(path, changes, noise, exact), path)
    return Simulated(load_campaign(made.files, name=made.name), made.truth)


def carried_out(plan: Plan, path: Path | None = None) -> RawCampaign:
    """A virtual campaign of a plan.

    Args:
        plan: The plan.
        path: Its file, in whose folder its own robot file is looked for; None for the default plan.

    Raises:
        InputError: The plan cannot be carried out.
        UsageError: An effect or a dialect has no such name.
    """
    return simulate(plan, robot=load_robot(plan.robot, path.parent if path else None))


def plan_for(
    path: Path | None, changes: Mapping[str, Any], noise: str | None = None, exact: bool = False
) -> Plan:
    """A plan with changes.

    Args:
        path: A plan file, or None for the default plan.
        changes: In the structure of the plan; None is no change.
        noise: `paper`, `instrument`, or a standard uncertainty per axis in m.
        exact: Readings without noise, all digits written.

    Raises:
        InputError: The plan or a change is not valid.
        UsageError: There is no such noise.
    """
    if (robot := changes.get("robot")) and Path(robot).is_file():  # relative to the current folder
        changes = {**changes, "robot": str(Path(robot).resolve())}
    wanted = revised(_plan_of(path), given(changes))
    wanted = with_noise(wanted, noise) if noise else wanted
    return wanted.without_noise() if exact else wanted


def _plan_of(path: Path | None) -> Plan:
    """The plan in a file; that of the demo where none is given.

    Raises:
        InputError: There is no such file, or it is not a plan.
    """
    if path is None:
        return Plan()
    missing = InputError("there is no such plan", "check the path", file=str(path))
    return parse(files.words(path, str(path), LARGEST_TEXT, missing), path.name)
