"""The chain and the scale hang: half their weight pulls down where the scale cannot see it.

The part of the weight across the pull adds to the force, -(e_z - u u_z) w / 2; the part along it
is in the reading.
"""

import numpy as np

from pipeline.effects._anatomy import direction
from pipeline.effects._effect import Loaded, Wrench
from pipeline.results import Array, Parameter
from pipeline.robot import Robot


def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Load point and force that act."""
    u = direction(loaded)
    down = np.array([0.0, 0.0, -1.0])
    across = down + u * u[:, 2:]
    return loaded.load_point, loaded.force + values[0] / 2 * across


def effects(robot: Robot) -> tuple[Wrench, ...]:
    """One effect, on any robot."""
    return (
        Wrench(
            name="chain_weight",
            where=None,
            parameters=(Parameter("w_chain", "N", 50.0, 0.0, 600.0),),
            signature="a constant pull downwards, gone when the chain hangs vertically",
            needs="the weight of chain and scale, from any balance",
            source="catenary to first order; 50 to 100 N is an estimate",
            wrench=wrench,
        ),
    )
