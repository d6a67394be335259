"""The robot as a `pin.Model`, with frames for flange, tool, load point and targets.

Pinocchio computes what needs link masses (gravity torques) and serves as independent check of the
batched kinematics; importing it takes half a second, so it is imported only within functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot.mdh import Robot

if TYPE_CHECKING:
    import pinocchio as pin


def model(robot: Robot, points: dict[str, Array] | None = None) -> pin.Model:
    """Build the Pinocchio model.

    Args:
        robot: The robot.
        points: Tool points by name in the flange frame [m], each shape (3,).

    Returns:
        A model whose joints carry the names of the robot's joints, with operational frames
        `flange`, and one per name in `points`.
    """
    import pinocchio as pin

    built = pin.Model()
    built.name = robot.name
    parent = 0
    for j, joint in enumerate(robot.joints):
        motion = pin.JointModelPZ() if joint.prismatic else pin.JointModelRZ()
        parent = built.addJoint(parent, motion, pin.SE3(robot.placement[j].copy()), joint.name)
        if joint.mass_kg:
            lever = np.array(joint.centre_of_mass_m or (0.0, 0.0, 0.0))
            built.appendBodyToJoint(
                parent, pin.Inertia(joint.mass_kg, lever, np.zeros((3, 3))), pin.SE3.Identity()
            )
    flange = pin.SE3(robot.flange.copy())
    built.addFrame(pin.Frame("flange", parent, 0, flange, pin.FrameType.OP_FRAME))
    for name, at in (points or {}).items():
        here = flange * pin.SE3(np.eye(3), np.asarray(at, dtype=float))
        built.addFrame(pin.Frame(name, parent, 0, here, pin.FrameType.OP_FRAME))
    return built
