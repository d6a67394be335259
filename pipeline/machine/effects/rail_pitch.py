"""The carriage nods about the axis across the rail: a rotation missing from Eq. (3)."""

from functools import partial

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._carriage import ACROSS, rotation, spring

effects = spring(
    name="rail_pitch",
    noun="pitch of the carriage",
    parameter=Parameter("c_pitch", "rad/(N m)", 5e-09, 0.0, 5e-07),
    screw=partial(rotation, axis=ACROSS),
    signature="all reflectors turn together about the axis across the rail, whatever the arm does",
    needs="pulls along the rail at several heights, or three reflectors on the carriage",
)
