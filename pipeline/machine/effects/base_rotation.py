"""Tracker and robot do not share F_b: all readings are rotated by a small angle vector e.

Measured are p + e x p and f + e x f; the acting force is the measured one rotated back.
"""

from typing import Any

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import Compound, Loaded, Observation, Wrench


def _observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
    """Points as measured."""
    return points + np.cross(values, points)


def _wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Load point of the robot and the measured force rotated back; weights keep their direction."""
    read = loaded.pulls.pulled * loaded.force
    return loaded.load_point, loaded.force - np.cross(values, read)


_SAID: dict[str, Any] = {
    "name": "base_rotation",
    "noun": "rotation of the base frame",
    "place": "metrology",
    "shows_unloaded": True,
    "parameters": vector(
        "e_{}", "rad", 2e-3, -0.1, 0.1, meaning="rotation of the base frame about {}"
    ),
    "signature": "displacements and forces are rotated together against the robot; lengths do not "
    "change",
    "needs": "more base reflectors, or the unloaded absolute positions with the tool's coordinates "
    "known",
    "source": "e x dp - A(e x f) x; 2 mrad with base reflectors whose nominal coordinates are poor",
}
_ACTS = (Wrench(**_SAID, wrench=_wrench), Observation(**_SAID, observe=_observe))

effects = Compound(**_SAID, acts=_ACTS).everywhere
