"""The catalogue of physics: one file per effect, one line each below."""

from collections.abc import Callable

from pipeline.effects import joint_compliance
from pipeline.effects._effect import (
    Effect,
    Elastic,
    Geometry,
    Loaded,
    Noise,
    Observation,
    Pulls,
    Wrench,
)
from pipeline.robot import Robot

CATALOGUE: tuple[Callable[[Robot], tuple[Effect, ...]], ...] = ()
"""What the paper's model does not know; each entry gives an effect for every place it can act."""


def baseline(robot: Robot) -> tuple[Effect, ...]:
    """The effects of the paper's model: its joint springs."""
    return joint_compliance.effects(robot)


def catalogue(robot: Robot) -> tuple[Effect, ...]:
    """Every effect that may be missing from the model of this robot."""
    return tuple(effect for entry in CATALOGUE for effect in entry(robot))


__all__ = [
    "Effect",
    "Elastic",
    "Geometry",
    "Loaded",
    "Noise",
    "Observation",
    "Pulls",
    "Wrench",
    "baseline",
    "catalogue",
]
