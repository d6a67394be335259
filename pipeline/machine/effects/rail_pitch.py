"""The carriage nods about the axis across the rail: a rotation missing from Eq. (3)."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded, linear
from pipeline.machine.effects._anatomy import carriage, rail, rail_axes
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import rotation_about


def screw(loaded: Loaded) -> Array:
    """Screw of the virtual joint, shape (m, 1, 6)."""
    _, across, _ = rail_axes(loaded)
    return rotation_about(carriage(loaded), across)[:, None]


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One spring at the carriage; nothing on a robot without a rail."""
    if not rail(robot):
        return ()
    return (
        Elastic(
            name="rail_pitch",
            noun="pitch of the carriage",
            place="rail",
            where=None,
            parameters=(Parameter("c_pitch", "rad/(N m)", 5e-09, 0.0, 5e-07),),
            signature="all reflectors turn together about the axis across the rail, whatever "
            "the arm does",
            needs="pulls along the rail at several heights, or three reflectors on the carriage",
            source="rotation column (a x (p - o)) (a . ((l - o) x f)); size an estimate for "
            "roller carriages",
            carrier=(1,),
            twists=screw,
            response=linear,
        ),
    )
