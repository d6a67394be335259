"""The base frame grew between rounds of its reflectors, or what the tracker measures did.

A reading at p_0 + l in the frame of the first round is made at p_0 + (1 + g a(t)) l since, with
a = 1 at the round where it is largest.
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Loaded, Observation

NOUN = "growth of the base frame or scale error of the tracker"


def over(begun: Array, growth: Array) -> Observation:
    """The growth of a course.

    Args:
        begun: Times of its rounds [s], shape (r,).
        growth: Its growth since the first one [1], shape (r,).
    """
    most = growth[np.argmax(np.abs(growth))]

    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        much = np.interp(time, begun, growth / most)
        return np.asarray(points * (1 + much[:, None, None] * values[0]))

    return Observation(
        name="base_growth",
        noun=NOUN,
        place="metrology",
        shows_unloaded=True,
        parameters=(
            Parameter("g", "1", 1e-5, -1e-2, 1e-2, "growth since the first round, at most"),
        ),
        signature="all distances between the base reflectors change by one factor from round to "
        "round, whatever the tracker's pose; the displacements hardly show it",
        needs="a thermometer on the base, and a reference length that the tracker measures at each "
        "round: the base reflectors alone cannot distinguish a frame that grew from lengths that "
        "the tracker measures otherwise",
        source="11.5e-6 per K of steel; 1e-6 per K and 0.3e-6 per hPa of the tracker's beam",
        observe=observe,
        instrument=True,
    )
