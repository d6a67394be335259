"""The carriage yields sideways, across the rail: a spring missing from Eq. (3)."""

from functools import partial

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._carriage import ACROSS, spring, translation

effects = spring(
    name="rail_lateral",
    noun="lateral compliance of the carriage",
    parameter=Parameter("c_lateral", "m/N", 5e-09, 0.0, 2e-07),
    screw=partial(translation, axis=ACROSS),
    signature="all reflectors move alike across the rail in proportion to the lateral "
    "force, with no lever arm; rail_roll grows with the height of the load",
)
