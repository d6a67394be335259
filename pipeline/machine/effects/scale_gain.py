"""The spring scale reads a constant fraction wrong: the true force is f (1 + g)."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench


def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Load point and force that act."""
    return loaded.load_point, loaded.force * (1 + loaded.pulls.pulled * values[0])


effects = Wrench(
    name="scale_gain",
    noun="wrong gain of the spring scale",
    place="force",
    parameters=(Parameter("g_scale", "1", 0.01, -0.2, 0.2),),
    signature="all stiffnesses shift by the same percentage; nothing else shows",
    needs="a known dead weight on the scale",
    source="calibration: crane scales 0.1 % of full scale, mechanical ones 1 %",
    wrench=wrench,
    of=(PULLED,),
).everywhere
