"""The carriage yields vertically: a spring missing from Eq. (3)."""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded, linear
from pipeline.machine.effects._anatomy import rail, rail_axes
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import translation_along


def screw(loaded: Loaded) -> Array:
    """Screw of the virtual joint, shape (m, 1, 6)."""
    _, _, up = rail_axes(loaded)
    return translation_along(up)[:, None]


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One spring at the carriage; nothing on a robot without a rail."""
    if not rail(robot):
        return ()
    return (
        Elastic(
            name="rail_vertical",
            noun="vertical give of the carriage",
            place="rail",
            where=None,
            parameters=(Parameter("c_vertical", "m/N", 2.5e-09, 0.0, 2e-07),),
            signature="all reflectors move alike up or down in proportion to the vertical "
            "force, with no lever arm",
            needs="three reflectors on the carriage",
            source="translation column a (a . f); size of loaded guide rollers, an estimate",
            carrier=(1,),
            twists=screw,
            response=linear,
        ),
    )
