"""The carriage yields sideways, across the rail: a spring missing from Eq. (3)."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded, linear
from pipeline.machine.effects._anatomy import rail, rail_axes
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import translation_along


def screw(loaded: Loaded) -> Array:
    """Screw of the virtual joint, shape (m, 1, 6)."""
    _, across, _ = rail_axes(loaded)
    return translation_along(across)[:, None]


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One spring at the carriage; nothing on a robot without a rail."""
    if not rail(robot):
        return ()
    return (
        Elastic(
            name="rail_lateral",
            noun="sideways give of the carriage",
            place="rail",
            where=None,
            parameters=(Parameter("c_lateral", "m/N", 5e-09, 0.0, 2e-07),),
            signature="all reflectors move alike across the rail in proportion to the lateral "
            "force, with no lever arm; rail_roll grows with the height of the load",
            needs="three reflectors on the carriage",
            source="translation column a (a . f); size of loaded guide rollers, an estimate",
            carrier=(1,),
            twists=screw,
            response=linear,
        ),
    )
