"""Drift of the tracker (or its tripod): readings move with time, or settle during warm-up.

steady:  p + v t
warm-up: p + a (1 - exp(-t / tau)), tau of `WARM_UP_H`
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import Effect, Loaded, Observation
from pipeline.machine.robot import Robot

_NAME = "tracker_drift"

NEEDS = "times in the export, and base reflectors measured again and again"
FURTHER = "the same pulls with a tracker that has been warm for two hours"
"""What would settle it, and what would where that is in the files."""

HOUR_S = 3600.0
"""Seconds in an hour: the unit of time for drift rates and for time constants."""

GROUP_S = 100.0
"""Assumed time between groups of readings if an export has no times and the order of its rows
serves as the clock [s]: tightening a turnbuckle takes 60 s, and five readings 8 s each
(design/schedule.py). It only sets the typical size of a drift and cancels from reported values."""

PER_GROUP = "m/group"
"""Unit of a drift rate per group of readings (one state of a pose), if the order of rows is the
clock."""

_Law = Callable[[Array], Array]

WARM_UP_H: Mapping[str, float] = {
    "warm-up": 1.0,
    "warm-up in a quarter of an hour": 0.25,
    "warm-up in half an hour": 0.5,
    "warm-up in two hours": 2.0,
}
"""Time constant of each form of a warm-up [h]; physics: instruments are specified to need half an
hour to two hours until they are warm, and with a factor of two between trials at most a sixth of
any course between them is left, rms."""


def _settling(hours: float) -> _Law:
    return lambda t: -np.expm1(-t / (hours * HOUR_S))


LAWS: Mapping[str, _Law] = {
    "steady": lambda t: t,
    **{form: _settling(hours) for form, hours in WARM_UP_H.items()},
}
"""Drift of each form relative to its parameter, as a function of time [s]."""


def effects(robot: Robot) -> tuple[Observation, ...]:
    """One effect in several forms, on any robot."""
    warming = (_effect(form, "a", "m", 6e-5, 1e-3) for form in WARM_UP_H)
    return _effect("steady", "v", "m/s", 4e-5 / HOUR_S, 3e-7), *warming


def by_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects for an export without times: a steady drift per group of readings, no warm-up.

    Without times, settling within an hour cannot be identified.
    """
    kept = [effect for effect in effects if effect.name != _NAME or effect.form == "steady"]
    return tuple(_per_group(one) if one.name == _NAME else one for one in kept)


def amount(effect: Effect, time: Array) -> Array:
    """Drift at a time [s], in the units of its parameters."""
    by_order = effect.parameters[0].unit == PER_GROUP
    return np.asarray(LAWS[effect.form](time / GROUP_S if by_order else time))


def _per_group(effect: Effect) -> Observation:
    first = effect.parameters[0]
    typical, most = first.typical * GROUP_S, first.upper * GROUP_S
    needs = "times in the export: by the order of its rows nobody knows how long a pause was"
    return replace(_effect("steady", "v", PER_GROUP, typical, most), needs=needs)


def _effect(form: str, letter: str, unit: str, typical: float, most: float) -> Observation:
    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        much = np.where(np.isfinite(time), amount(effect, np.nan_to_num(time)), 0.0)
        return points + much[:, None, None] * values

    effect = Observation(
        name=_NAME,
        noun="drift of the tracker",
        place="metrology",
        form=form,
        tolerance=0.2,
        parameters=vector(
            *(f"{letter}_{{}}", unit, typical, -most, most),
            meaning="drift of the tracker along {}" + " until it is warm" * (letter == "a"),
        ),
        signature="what is read late after its zero is off more; base_start and base_end disagree",
        needs=NEEDS,
        source="20 to 60 um/h; a cold tracker settles over two hours",
        observe=observe,
        instrument=True,
    )
    return effect
