"""The carriage rocks about the rail: a rotation missing from Eq. (3)."""

from functools import partial

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._carriage import ALONG, rotation, spring

effects = spring(
    name="rail_roll",
    noun="roll of the carriage about the rail",
    parameter=Parameter("c_roll", "rad/(N m)", 1e-08, 0.0, 5e-07),
    screw=partial(rotation, axis=ALONG),
    signature="all reflectors turn together about the rail, whatever the arm does; tilt "
    "of joint 2 turns with the arm",
    needs="one arm pose pulled across the rail at several heights, or three reflectors "
    "on the carriage",
)
