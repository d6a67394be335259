"""The spring scale does not read zero when nothing pulls: the true force is f + f_0 u."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction


def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Load point and force that act."""
    return loaded.load_point, loaded.force + loaded.pulls.pulled * values[0] * direction(loaded)


effects = Wrench(
    name="scale_zero",
    noun="wrong zero of the spring scale",
    place="force",
    parameters=(Parameter("f_zero", "N", 20.0, -300.0, 300.0),),
    signature="displacement over force has an offset at zero force, the same at every pose",
    needs="three load levels, or the scale read with nothing on it",
    source="equals a preload that is there when the zero is measured; 20 N is an estimate",
    wrench=wrench,
    of=(PULLED,),
).everywhere
