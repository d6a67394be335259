"""The chain pulls at another point of the tool than campaign.toml says: l + R_7 d."""

from pipeline.effects._effect import Loaded, Wrench
from pipeline.results import Array, Parameter
from pipeline.robot import Robot


def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """The load point that is true, the force as read."""
    return loaded.load_point + loaded.configuration.flange_axes @ values, loaded.force


def effects(robot: Robot) -> tuple[Wrench, ...]:
    """One effect, on any robot."""
    return (
        Wrench(
            name="load_point_offset",
            where=None,
            parameters=tuple(Parameter(f"dl_{axis}", "m", 5e-3, -0.5, 0.5) for axis in "xyz"),
            signature="torques of the wrist are off by the force times a lever fixed in the tool",
            needs="the load point measured with a reflector on the hook",
            source="moment d x f; 5 mm is an estimate",
            wrench=wrench,
        ),
    )
