"""The carriage turns about the vertical: the same axis as joint 2."""

from functools import partial

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._carriage import UP, rotation, spring

effects = spring(
    name="rail_yaw",
    noun="yaw of the carriage",
    parameter=Parameter("c_yaw", "rad/(N m)", 7e-09, 0.0, 5e-07),
    screw=partial(rotation, axis=UP),
    signature="cannot be distinguished from the compliance of joint 2, whose axis it shares",
)
