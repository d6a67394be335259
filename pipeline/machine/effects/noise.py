"""Scatter of the readings larger than stated: standard uncertainty times 1 + s."""

from pipeline.base.arrays import Parameter
from pipeline.machine.effect import PULLED, Noise
from pipeline.machine.robot import Robot

_ALL = (
    Noise(
        name="tracker_noise",
        noun="tracker noise larger than stated",
        place="noise",
        parameters=(
            Parameter("s_tracker", "1", 0.3, 0.0, 20.0, "noise of the tracker beyond that stated"),
        ),
        signature="all residuals are larger than stated, without a pattern",
        needs="repeated readings of one state",
        source="laser trackers in a warm hall against their certificate; 30 % is an estimate",
        source_scaled=("tracker", "zero", "direction"),
    ),
    Noise(
        name="force_noise",
        noun="force noise larger than stated",
        place="noise",
        parameters=(
            Parameter("s_force", "1", 1.0, 0.0, 20.0, "noise of the scale beyond that stated"),
        ),
        signature="all coordinates of one reading are off together, along its displacement",
        needs="repeated pulls at one pose",
        source="0.1 to 0.5 % of the reading",
        source_scaled=("force_reading",),
        of=(PULLED,),
    ),
)


def effects(robot: Robot) -> tuple[Noise, ...]:
    """Both noise effects, the same on any robot."""
    return _ALL
