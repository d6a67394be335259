"""The tracker (or its tripod) drifts: readings move with time, p + v t, or settle while warming up.

steady:  p + v t
warm-up: p + a (1 - exp(-t / 1 h))
"""

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Loaded, Observation
from pipeline.machine.robot import Robot

HOUR_S = 3600.0
"""Seconds in an hour: trackers warm up in about one, and drifts are told per hour."""

_Law = Callable[[Array], Array]

LAWS: Mapping[str, _Law] = {"steady": lambda t: t, "warm-up": lambda t: -np.expm1(-t / HOUR_S)}
"""How much of each form there is at a time [s]."""


def effects(robot: Robot) -> tuple[Observation, ...]:
    """One effect in two forms, on any robot."""
    return (
        _effect("steady", "v", "m/s", 4e-5 / HOUR_S, 3e-7),
        _effect("warm-up", "a", "m", 6e-5, 1e-3),
    )


def _effect(form: str, letter: str, unit: str, typical: float, most: float) -> Observation:
    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        amount = np.where(np.isfinite(time), LAWS[form](np.nan_to_num(time)), 0.0)
        return points + amount[:, None, None] * values

    return Observation(
        name="tracker_drift",
        noun="drift of the tracker",
        place="metrology",
        form=form,
        tolerance=0.2,
        parameters=tuple(
            Parameter(f"{letter}_{axis}", unit, typical, -most, most) for axis in "xyz"
        ),
        signature="what is read late after its zero is off more; base_start and base_end disagree",
        needs="times in the export, and base reflectors measured again and again",
        source="20 to 60 um/h; a cold tracker settles over two hours",
        observe=observe,
        instrument=True,
    )
