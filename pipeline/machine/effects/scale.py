"""Errors of the spring scale: gain, zero, or curvature (error quadratic in the force)."""

from collections.abc import Callable

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction
from pipeline.machine.robot import Robot

NEEDS = "three load levels, or the scale read with nothing on it"
FURTHER = "the scale read with nothing on it"
"""What would settle its zero, and what would where three levels were pulled."""


def _gain(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Acting load point and force: f (1 + g)."""
    return loaded.load_point, loaded.force * (1 + loaded.pulls.pulled * values[0])


def _zero(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Acting load point and force: f + f_0 u, u along f."""
    return loaded.load_point, loaded.force + loaded.pulls.pulled * values[0] * direction(loaded)


def _curvature(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Acting load point and force: f (1 + e |f| / 1 kN)."""
    size = np.linalg.norm(loaded.force, axis=1, keepdims=True)
    return loaded.load_point, loaded.force * (1 + loaded.pulls.pulled * values[0] * size / 1000.0)


def _scale(
    kind: str,
    noun: str,
    parameter: Parameter,
    wrench: Callable[[Loaded, Array], tuple[Array, Array]],
    signature: str,
    needs: str,
    source: str,
) -> Wrench:
    """An error of the measured force of pulls by the chain."""
    return Wrench(
        name=f"scale_{kind}",
        noun=f"{noun} of the spring scale",
        place="force",
        parameters=(parameter,),
        signature=signature,
        needs=needs,
        source=source,
        wrench=wrench,
        of=(PULLED,),
    )


_ALL = (
    _scale(
        "gain",
        "wrong gain",
        Parameter("g_scale", "1", 0.01, -1.0, meaning="correction of the scale's gain"),
        _gain,
        signature="all stiffnesses shift by the same percentage; nothing else shows",
        needs="a known dead weight on the scale",
        source="calibration: crane scales 0.1 % of full scale, mechanical ones 1 %",
    ),
    _scale(
        "zero",
        "wrong zero",
        Parameter("f_zero", "N", 20.0, meaning="correction of the scale's zero"),
        _zero,
        signature="displacement over force has an offset at zero force, the same at every pose",
        needs=NEEDS,
        source="equals a preload that is there when the zero is measured; 20 N is an estimate",
    ),
    _scale(
        "curvature",
        "curvature",
        Parameter("e_scale", "1", 0.005, meaning="curvature of the scale at full load"),
        _curvature,
        signature="displacement over force changes with the force alike at every pose, "
        "whichever joint turns",
        needs="two known dead weights on the scale",
        source="1 % of full scale at 2 kN, data sheets of mechanical dynamometers",
    ),
)


def effects(robot: Robot) -> tuple[Wrench, ...]:
    """All scale effects, the same on any robot."""
    return _ALL
