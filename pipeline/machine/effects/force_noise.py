"""The scale scatters more than stated: its standard uncertainty times 1 + s."""

from pipeline.base.arrays import Parameter
from pipeline.machine.effect import PULLED, Noise

effects = Noise(
    name="force_noise",
    noun="force noise larger than stated",
    place="noise",
    parameters=(Parameter("s_force", "1", 1.0, 0.0, 20.0),),
    signature="all coordinates of one reading are off together, along its displacement",
    needs="repeated pulls at one pose",
    source="0.1 to 0.5 % of the reading",
    source_scaled=("force_reading",),
    of=(PULLED,),
).everywhere
