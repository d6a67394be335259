"""The carriage yields vertically: a spring missing from Eq. (3)."""

from functools import partial

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._carriage import UP, spring, translation

effects = spring(
    name="rail_vertical",
    noun="vertical compliance of the carriage",
    parameter=Parameter("c_vertical", "m/N", 2.5e-09, 0.0, 2e-07),
    screw=partial(translation, axis=UP),
    signature="all reflectors move alike up or down in proportion to the vertical "
    "force, with no lever arm",
)
