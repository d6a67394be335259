"""Compliance of the effector or its flange joint: rotations about the flange's x and y axes."""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import compliance
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import rotation_about


def _screws(loaded: Loaded) -> Array:
    """Rotations about x and y of the flange, shape (m, 2, 6)."""
    axes, origin = loaded.configuration.flange_axes, loaded.configuration.flange_origin
    return np.stack([rotation_about(origin, axes[:, :, axis]) for axis in (0, 1)], axis=1)


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect, after the last joint."""
    c = compliance(robot, robot.n)
    return (
        Elastic(
            name="tool_flex",
            noun="compliance of the tool or its flange",
            place="tool",
            parameters=tuple(
                Parameter(
                    *(f"c_tool_{axis}", "rad/(N m)", c / 6, 0.0, np.inf),
                    f"tilt compliance of the tool on its flange about {axis}",
                )
                for axis in "xy"
            ),
            signature="the effector turns against the flange, about axes fixed in the tool; "
            "the same as a tilt of the last joint",
            needs="three reflectors on the flange",
            source="rotation column at the flange; 3e6 N m/rad is an estimate",
            carrier=(robot.n, robot.n),
            twists=_screws,
        ),
    )
