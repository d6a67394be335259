"""Points of the tool are elsewhere than campaign.toml states: p + R_7 d.

- load point:      where the chain pulls
- measuring point: what the tracker follows, all targets by the same d
- both:            one point at which the chain pulls and which the tracker follows
"""

from typing import Any

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import (
    HUNG,
    MOUNTED,
    PULLED,
    Compound,
    Effect,
    Loaded,
    Reflectors,
    Wrench,
)
from pipeline.machine.robot import Robot


def _wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """True load point and measured force; a payload, with its own centre of mass, is unaffected."""
    here = (loaded.pulls.by != MOUNTED)[:, None]
    return loaded.load_point + here * (loaded.configuration.flange_axes @ values), loaded.force


def _points(loaded: Loaded, values: Array) -> Array:
    """True positions of the targets."""
    return np.asarray(loaded.points + (loaded.configuration.flange_axes @ values)[:, None])


def effects(robot: Robot) -> tuple[Effect, ...]:
    """One effect in three forms, on any robot."""
    alone = Wrench(**_said("load point"), wrench=_wrench, of=(PULLED, HUNG))
    followed = Reflectors(**_said("measuring point"), points=_points)
    both = _said("both") | {"of": (PULLED, HUNG)}
    acts = (Wrench(**both, wrench=_wrench), Reflectors(**both, points=_points))
    return (alone, followed, Compound(**both, acts=acts))


def _said(form: str) -> dict[str, Any]:
    return {
        "name": "load_point_offset",
        "noun": "offset of the load point or the targets",
        "place": "force",
        "form": form,
        "parameters": vector(
            "dl_{}", "m", 5e-3, -np.inf, np.inf, meaning="correction of the stated point along {}"
        ),
        "signature": "torques of the wrist are off by the force times a lever fixed in the tool, "
        "or displacements by their rotation times it",
        "needs": "the load point and the targets measured in the flange frame",
        "source": "moment d x f, displacement w x d; 5 mm is an estimate",
    }
