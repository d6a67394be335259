"""Weight W of chain and scale: half of it acts downwards on the robot, unseen by the scale.

The chain pulls the robot with H u - (W/2) e_z, where H u is the tension at the middle of its
weight. A scale reads the tension at its own place, S = H - s (W/2) u_z, so that
S u - (W/2) (e_z - s u_z u) acts, and only the component of the weight across the pull does not
depend on the place of the scale.
"""

from functools import partial
from math import inf

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction
from pipeline.machine.robot import Robot

_SIDE = {"scale at the robot": 1.0, "scale amid the chain": 0.0, "scale at the anchor": -1.0}
"""s: coefficient of half the weight along the pull in the reading, by the place of the scale
[1]."""


def _wrench(loaded: Loaded, values: Array, side: float, up: Array) -> tuple[Array, Array]:
    """Acting load point and force."""
    u = direction(loaded)
    weight = values[0] / 2 * (up - side * u * (u @ up)[:, None])
    return loaded.load_point, loaded.force - loaded.pulls.pulled * weight


def effects(robot: Robot) -> tuple[Wrench, ...]:
    """One effect in each form, on any robot."""
    return tuple(
        Wrench(
            name="chain_weight",
            noun="weight of the chain",
            place="force",
            form=form,
            parameters=(Parameter("w_chain", "N", 50.0, 0.0, inf, "weight of chain and scale"),),
            signature="a constant pull downwards; along the chain as much of it as hangs between "
            "scale and robot",
            needs="the weight of chain and scale, from any balance, and where the scale sits",
            source="catenary to first order; 50 to 100 N is an estimate",
            wrench=partial(_wrench, side=side, up=-robot.down),
            of=(PULLED,),
        )
        for form, side in _SIDE.items()
    )
