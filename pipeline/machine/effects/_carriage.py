"""The carriage on its rail yields: one spring about or along each of the rail's three axes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import carriage, rail, rail_axes
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import rotation_about, translation_along

ALONG, ACROSS, UP = range(3)
"""Axes of the rail, as `rail_axes` gives them."""

_SOURCE = {
    "m/N": "translation column a (a . f); size of loaded guide rollers, an estimate",
    "rad/(N m)": "rotation column (a x (p - o)) (a . ((l - o) x f)); size an estimate for "
    "roller carriages",
}
"""Where the formula comes from, by the unit of the compliance."""


def rotation(loaded: Loaded, axis: int) -> Array:
    """Screw of a carriage that turns about an axis of the rail, shape (m, 1, 6)."""
    return rotation_about(carriage(loaded), rail_axes(loaded)[axis])[:, None]


def translation(loaded: Loaded, axis: int) -> Array:
    """Screw of a carriage that shifts along an axis of the rail, shape (m, 1, 6)."""
    return translation_along(rail_axes(loaded)[axis])[:, None]


def spring(
    name: str,
    noun: str,
    parameter: Parameter,
    screw: Callable[[Loaded], Array],
    signature: str,
    needs: str = "three reflectors on the carriage",
) -> Callable[[Robot], tuple[Elastic, ...]]:
    """What gives one linear spring at the carriage; nothing on a robot without a rail."""
    effect = Elastic(
        name=name,
        noun=noun,
        place="rail",
        parameters=(parameter,),
        signature=signature,
        needs=needs,
        source=_SOURCE[parameter.unit],
        carrier=(1,),
        twists=screw,
    )
    return partial(_on_a_rail, effect)


def _on_a_rail(effect: Elastic, robot: Robot) -> tuple[Elastic, ...]:
    return (effect,) if rail(robot) else ()
