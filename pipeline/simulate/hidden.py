"""Effects to plant, from the words of the command line: NAME[:where][(form)][=size]."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from pipeline.effects import Effect, catalogue
from pipeline.errors import UsageError
from pipeline.results import Array, Locked
from pipeline.robot import Robot


@dataclass(frozen=True, eq=False)
class Planted(Locked):
    """An effect that acts in a virtual cell.

    Attributes:
        effect: What acts.
        values: Its parameters, SI, shape (k,).
    """

    effect: Effect
    values: Array


def plant(text: str, robot: Robot) -> Planted:
    """The effect that `text` names, at its size.

    Args:
        text: `rail_roll` (typical size), `joint_tilt:2=2x` (twice the typical size),
            `scale_zero=20` (SI), `joint_tilt:2=1e-7,2e-7` (one number per parameter),
            `tracker_drift(warm-up)` (a form of it; the first one where none is named).
        robot: The robot that it acts on.

    Raises:
        UsageError: This robot has no such effect (all are listed), or the size is no number.
    """
    words, _, size = (part.strip() for part in text.partition("="))
    known: dict[str, Effect] = {}
    for effect in catalogue(robot):
        known.setdefault(effect.label, effect)
        known[f"{effect.label}({effect.form})"] = effect
    if words not in known:
        raise UsageError(
            f'there is no effect "{words}" on {robot.name}; choose from '
            f"{', '.join(name for name in known if not name.endswith('()')) or 'none'}."
        )
    return Planted(known[words], _values(known[words], size, text))


def _values(effect: Effect, size: str, text: str) -> Array:
    typical = np.array([parameter.typical for parameter in effect.parameters])
    times = re.fullmatch(r"(.+?)\s*x", size)
    try:
        if not size:
            return typical
        if times:
            return float(times[1]) * typical
        values = np.array([float(number) for number in size.split(",")])
    except ValueError as problem:
        raise UsageError(
            f'"{text}": {size} is no size; write a number in SI, or 2x for twice the typical size.'
        ) from problem
    if len(values) != len(typical) or not np.isfinite(values).all():
        wanted = ", ".join(f"{p.name} [{p.unit}]" for p in effect.parameters)
        raise UsageError(
            f'"{text}": {effect.label} has the parameters {wanted}; give one number each.'
        )
    return values
