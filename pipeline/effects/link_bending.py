"""A link of the arm bends: two rotations at its middle, as a slender beam with a load far away.

A beam's end turns by (L / EI) times the moment at its middle, whatever the load (Euler and
Bernoulli, without the L^3 / 12 EI of the end's own displacement).
"""

import numpy as np

from pipeline.effects._anatomy import arm, compliance
from pipeline.effects._effect import Elastic, Loaded, linear
from pipeline.results import Array, Parameter
from pipeline.robot import Robot
from pipeline.robot.configuration import rotation_about


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """Upper arm (shoulder to elbow) and forearm (elbow to wrist centre) of a six-axis arm."""
    joints = arm(robot)
    if joints is None:
        return ()
    shoulder, elbow, wrist = joints
    return (
        _effect(robot, "upper_arm", "upper", shoulder, elbow),
        _effect(robot, "forearm", "fore", elbow, wrist),
    )


def _effect(robot: Robot, where: str, short: str, near: int, far: int) -> Elastic:
    c = compliance(robot, near)

    def screws(loaded: Loaded) -> Array:
        axes, start = loaded.configuration.frame(near)
        _, end = loaded.configuration.frame(far)
        axis = axes[:, :, 2]
        link = end - start - np.sum((end - start) * axis, axis=1, keepdims=True) * axis
        side = np.cross(axis, link / np.linalg.norm(link, axis=1, keepdims=True))
        middle = (start + end) / 2
        return np.stack([rotation_about(middle, axis), rotation_about(middle, side)], axis=1)

    return Elastic(
        name="link_bending",
        where=where,
        parameters=(
            Parameter(f"c_{short}_in_plane", "rad/(N m)", c / 5, 0.0, 5 * c),
            Parameter(f"c_{short}_out_of_plane", "rad/(N m)", c / 5, 0.0, 5 * c),
        ),
        signature=f"everything behind the {where.replace('_', ' ')} turns about its middle; "
        "a near twin of the tilt of the joint it hangs on",
        needs="reflectors at the elbow",
        source="beam theory; 2e7 to 4e7 N m/rad per axis is an estimate",
        carrier=(near, near),
        twists=screws,
        response=linear,
    )
