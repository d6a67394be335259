"""The bearing of a joint tilts: it gives way about the two axes across its own, Eq. (3) knows none.

c_tilt_x and c_tilt_y turn about x_j and y_j of the joint's frame, behind its own motion.
"""

import numpy as np

from pipeline.effects._anatomy import compliance, turning
from pipeline.effects._effect import Elastic, Loaded, linear
from pipeline.results import Array, Parameter
from pipeline.robot import Robot
from pipeline.robot.configuration import rotation_about


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect for each revolute joint."""
    return tuple(_effect(robot, joint) for joint in turning(robot))


def _effect(robot: Robot, joint: int) -> Elastic:
    c = compliance(robot, joint)

    def screws(loaded: Loaded) -> Array:
        axes, origin = loaded.configuration.frame(joint)
        return np.stack([rotation_about(origin, axes[:, :, axis]) for axis in (0, 1)], axis=1)

    return Elastic(
        name="joint_tilt",
        where=joint,
        parameters=tuple(
            Parameter(f"c_tilt{joint}_{axis}", "rad/(N m)", c / 6, 0.0, 5 * c) for axis in "xy"
        ),
        signature=f"everything behind joint {joint} turns about axes across it, "
        "that turn with the joint",
        needs="poses that differ in this joint alone; at the wrist three reflectors on the flange",
        source="moment rigidity of RV reducers is five to seven times their torsional stiffness; "
        "full joint compliance after Klimchik et al., Complete stiffness model (2014)",
        carrier=(joint, joint),
        twists=screws,
        response=linear,
    )
