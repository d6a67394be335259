"""The spring scale is not linear: the true force is f (1 + e |f| / 1 kN)."""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench


def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Load point and force that act."""
    size = np.linalg.norm(loaded.force, axis=1, keepdims=True)
    return loaded.load_point, loaded.force * (1 + loaded.pulls.pulled * values[0] * size / 1000.0)


effects = Wrench(
    name="scale_curvature",
    noun="curvature of the spring scale",
    place="force",
    parameters=(Parameter("e_scale", "1", 0.005, -0.1, 0.1),),
    signature="displacement over force changes with the force alike at every pose, "
    "whichever joint turns",
    needs="two known dead weights on the scale",
    source="1 % of full scale at 2 kN, data sheets of mechanical dynamometers",
    wrench=wrench,
    of=(PULLED,),
).everywhere
