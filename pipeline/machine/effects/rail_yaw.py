"""The carriage turns about the vertical: the same axis as joint 2."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded, linear
from pipeline.machine.effects._anatomy import carriage, rail, rail_axes
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import rotation_about


def _screw(loaded: Loaded) -> Array:
    """Screw of the virtual joint, shape (m, 1, 6)."""
    _, _, up = rail_axes(loaded)
    return rotation_about(carriage(loaded), up)[:, None]


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One spring at the carriage; nothing on a robot without a rail."""
    if not rail(robot):
        return ()
    return (
        Elastic(
            name="rail_yaw",
            noun="yaw of the carriage",
            place="rail",
            where=None,
            parameters=(Parameter("c_yaw", "rad/(N m)", 7e-09, 0.0, 5e-07),),
            signature="cannot be told from the compliance of joint 2, whose axis it shares",
            needs="three reflectors on the carriage",
            source="rotation column (a x (p - o)) (a . ((l - o) x f)); size an estimate for "
            "roller carriages",
            carrier=(1,),
            twists=_screw,
            response=linear,
        ),
    )
