"""The tracker scatters more than stated: its standard uncertainty times 1 + s."""

from pipeline.base.arrays import Parameter
from pipeline.machine.effect import Noise

effects = Noise(
    name="tracker_noise",
    noun="tracker noise larger than stated",
    place="noise",
    parameters=(Parameter("s_tracker", "1", 0.3, 0.0, 20.0),),
    signature="all residuals are larger than stated, without a pattern",
    needs="repeated readings of one state",
    source="laser trackers in a warm hall against their certificate; 30 % is an estimate",
    source_scaled=("tracker", "zero", "direction"),
).everywhere
