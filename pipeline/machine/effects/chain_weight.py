"""Weight W of chain and scale, of which the robot carries what hangs on its side.

Let r W hang between the robot and the middle of the reflectors that show the direction u of the
chain, and s W between the robot and the scale. A taut chain is in equilibrium piece by piece: the
tension is H u at the reflectors and |H u + (s - r) W e_z| = S in the scale, and on the robot acts

    H u - r W e_z,    H = sqrt(S^2 - w'w + (u'w)^2) - u'w,    w = (s - r) W e_z.

Only the component across the pull does not depend on the place of the scale.
"""

from functools import partial
from math import inf

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction
from pipeline.machine.robot import Robot

_SHARES = {
    "scale at the robot": (0.5, 0.0),
    "scale amid the chain": (0.5, 0.5),
    "scale at the anchor": (0.5, 1.0),
    "scale at the anchor, reflectors near the robot": (0.2, 1.0),
}
"""r, s: shares of the weight on the robot's side of the reflectors, which are amid the chain unless
said otherwise, and of the scale [1]. With W unknown, pulls show r / s alone: these are some two
times apart, and what lies between is within the tolerance of the law."""


def _wrench(
    loaded: Loaded, values: Array, shares: tuple[float, float], up: Array
) -> tuple[Array, Array]:
    """Acting load point and force."""
    robot, scale = shares
    u, w = direction(loaded), (scale - robot) * values[0] * up
    along = u @ w
    read = np.sum(loaded.force**2, axis=1)
    tension = np.sqrt(np.maximum(read - w @ w + along**2, 0.0)) - along
    acts = np.maximum(tension, 0.0)[:, None] * u - robot * values[0] * up
    return loaded.load_point, loaded.force + loaded.pulls.pulled * (acts - loaded.force)


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
            source="statics of a taut chain; 50 to 100 N is an estimate",
            wrench=partial(_wrench, shares=shares, up=-robot.down),
            of=(PULLED,),
        )
        for form, shares in _SHARES.items()
    )
