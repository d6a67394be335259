"""Joint offset: the true joint value is q_j + d_j, where q_j is logged."""

from dataclasses import replace

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Geometry, Pulls
from pipeline.machine.effects.table import NEEDS
from pipeline.machine.robot import Robot


def effects(robot: Robot) -> tuple[Geometry, ...]:
    """One effect for each joint."""
    return tuple(_effect(robot, joint) for joint in range(1, robot.n + 1))


def _effect(robot: Robot, joint: int) -> Geometry:
    slides = robot.joints[joint - 1].prismatic

    def geometry(robot: Robot, pulls: Pulls, values: Array) -> Array:
        return np.asarray(pulls.q + values[0] * np.eye(robot.n)[joint - 1])

    return Geometry(
        name="joint_offset",
        noun="wrong joint zero",
        place="metrology",
        shows_unloaded=True,
        where=joint,
        parameters=(
            Parameter(
                *(f"d_{joint}", "m" if slides else "rad", 1e-3, -0.02, 0.02),
                "correction of the zero of {joint}",
            ),
        ),
        signature=f"the unloaded reflectors stand millimetres off as joint {joint} would move "
        "them; "
        "the displacements hardly show it",
        needs=NEEDS,
        source="derivative of Eqs. (2), (4) by q_j; 1 mrad, 1 mm before a geometric calibration",
        geometry=geometry,
    )


def since(
    robot: Robot, joint: int, before: tuple[int, ...], pose: int, slipped: bool = False
) -> Geometry:
    """Joint offset that existed only before a change of the zero in mid-campaign, or only since.

    Args:
        robot: The robot.
        joint: Joint number, from 1.
        before: Numbers of the poses before the change.
        pose: Number of the first pose after it.
        slipped: Whether the log is wrong since, as of a joint that slipped, and not before.
    """
    usual = _effect(robot, joint)

    def geometry(robot: Robot, pulls: Pulls, values: Array) -> Array:
        share = (np.isin(pulls.pose, before) != slipped)[:, None]
        return np.asarray(pulls.q - values[0] * share * np.eye(robot.n)[joint - 1])

    return replace(
        usual,
        noun=f"zero that changed at pose {pose}",
        form=f"since pose {pose}",
        signature=f"{'since' if slipped else 'before'} pose {pose} the unloaded reflectors stand "
        f"off as joint {joint} would move them, {'before' if slipped else 'since'} that they do "
        "not; the displacements hardly show it",
        geometry=geometry,
    )
