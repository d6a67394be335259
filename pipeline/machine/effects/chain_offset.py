"""The chain's reflectors are not on its line of action: the direction of Eq. (10) is biased.

A reflector that is off the line by d, fixed to the tool, turns the direction by R_7 d / L, where L
is the distance between the two; only the component across the pull matters.
"""

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction


def _wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """The measured force with its direction corrected and its magnitude unchanged."""
    u = direction(loaded)
    size = np.linalg.norm(loaded.force, axis=1, keepdims=True)
    true = u + loaded.pulls.pulled * (loaded.configuration.flange_axes @ values)
    length = np.linalg.norm(true, axis=1, keepdims=True)
    return loaded.load_point, size * true / np.where(size > 0, length, 1.0)


effects = Wrench(
    name="chain_offset",
    noun="offset of the chain reflectors",
    place="force",
    parameters=vector(
        "d_{}_over_L", "1", 8e-3, -0.2, 0.2, meaning="offset of the chain along {} over its length"
    ),
    signature="the force seems to act aslant, in a direction fixed in the tool; "
    "in proportion to the load",
    needs="one pose repeated with the last joint turned by 180 degrees",
    source="5 mm over 0.6 m of chain, an estimate",
    wrench=_wrench,
    of=(PULLED,),
).everywhere
