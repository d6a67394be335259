"""What all campaigns teach about causes, as tables for campaign.toml."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipeline.base.errors import UsageError
from pipeline.fleet.experience import CAMPAIGNS, ROBOTS, Expected, Experience, experience
from pipeline.fleet.history import finished
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load


def learnt(root: Path, robot: str) -> Experience:
    """Experience from all finished campaigns with the causes that a robot can have.

    Simulated campaigns are not counted, since their causes were chosen.

    Raises:
        InputError: There is no such robot.
        UsageError: No campaign is finished.
    """
    everyone = [one.answer for one in finished(root)]
    if not everyone:
        raise UsageError("no campaign is finished: run `pipeline run` first")
    answers = [one for one in everyone if not one.simulated]
    return experience(answers, {effect.name for effect in catalogue(load(robot))})


def toml(said: Experience) -> str:
    """Tables to append to campaign.toml; guesses are stated as such in comments."""
    return "\n".join(_lines(said)) + "\n"


def _lines(said: Experience) -> Iterator[str]:
    yield f"# From {said.campaigns} campaigns of {said.robots} robots by `pipeline priors`."
    if not said.learnt:
        yield (
            f"# Too few to learn how common causes are ({ROBOTS} robots and {CAMPAIGNS} campaigns "
            "are needed): all are guessed to be equally likely."
        )
    for one in said.causes:
        if one.odds_learnt or one.size_learnt:
            yield from _table(one)
    guessed = [one.name for one in said.causes if not one.size_learnt]
    if guessed:
        yield f"# Sizes are guessed, too few robots have them: {', '.join(guessed)}."


def _table(one: Expected) -> Iterator[str]:
    yield f"[priors.{one.name}]  # in {one.robots:.2g} robots"
    if one.odds_learnt:
        yield f"odds = {one.odds:.3g}"
    if one.size_learnt:
        yield f"size = {one.size:.3g}"
