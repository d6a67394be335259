"""The catalogue of physical effects: one file per effect or family of effects.

`CATALOGUE` lists those tested in every campaign. `base_moved` and `target_moved` are tested
where readings repeat, `payload` where one is mounted, `table` with unloaded readings, and
`unlisted` and `nameless` once the catalogue leaves something over.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from pipeline.machine.effect import HUNG, MOUNTED, PULLED, Effect, Pulls
from pipeline.machine.effects import (
    base_rotation,
    carriage,
    chain_offset,
    chain_weight,
    compensator,
    gravity_sag,
    joint_asymmetry,
    joint_hardening,
    joint_hysteresis,
    joint_lost_motion,
    joint_offset,
    joint_tilt,
    link_bending,
    load_point_offset,
    noise,
    payload,
    rail_backlash,
    rail_stiffness_varies,
    scale,
    scale_hysteresis,
    tool_flex,
    tracker_drift,
    wrist_coupling,
)
from pipeline.machine.robot import Robot, axes

CATALOGUE: tuple[Callable[[Robot], tuple[Effect, ...]], ...] = (
    carriage.effects,
    rail_backlash.effects,
    rail_stiffness_varies.effects,
    joint_tilt.effects,
    link_bending.effects,
    tool_flex.effects,
    joint_asymmetry.effects,
    joint_hardening.effects,
    joint_lost_motion.effects,
    joint_hysteresis.effects,
    compensator.effects,
    wrist_coupling.effects,
    scale.effects,
    scale_hysteresis.effects,
    chain_weight.effects,
    chain_offset.effects,
    joint_offset.effects,
    base_rotation.effects,
    tracker_drift.effects,
    gravity_sag.effects,
    load_point_offset.effects,
    noise.effects,
)
"""Effects that the paper's model omits; each entry returns one effect per possible place."""


def catalogue(robot: Robot, pulls: Pulls | None = None) -> tuple[Effect, ...]:
    """Every effect that may be missing from the model of this robot.

    Args:
        robot: The robot.
        pulls: Loads of a campaign; effects that act on none of them are left out. By default all
            kinds of load are assumed.
    """
    names = axes.alone(robot)
    every = (_named(effect, names) for entry in CATALOGUE for effect in entry(robot))
    loads = {PULLED, HUNG, MOUNTED} if pulls is None else set(pulls.by.tolist())
    known = tuple(effect for effect in every if loads.intersection(effect.of))
    return known if pulls is None else known + payload.effects(pulls)


def _named(effect: Effect, names: Sequence[str | None]) -> Effect:
    """The effect with the controller's name of its joint, if it acts at a joint."""
    if not isinstance(effect.where, int):
        return effect
    return replace(effect, axis=names[effect.where - 1])
