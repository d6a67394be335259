"""Difference between a robot file and the URDF it was made from, as read by Pinocchio."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.machine.robot.configuration import configure
from pipeline.machine.robot.mdh import Robot

if TYPE_CHECKING:
    import pinocchio as pin

_CONFIGURATIONS = 1000
"""Number of random configurations within the limits [1]; without limits a revolute joint is drawn
over one turn, a prismatic one over +/-1 m."""


@dataclass(frozen=True)
class UrdfAgreement:
    """Largest differences between the flange poses of a robot file and of a URDF.

    Attributes:
        configurations: Number of configurations compared.
        position_m: Largest distance between the origins [m].
        angle_rad: Largest angle between the orientations [rad].
    """

    configurations: int
    position_m: float
    angle_rad: float


def agreement(
    robot: Robot, text: str, base: str, flange: str, file: str, rng: np.random.Generator
) -> UrdfAgreement:
    """Compare a robot with the URDF it was made from, at random joint values.

    Args:
        robot: The robot; its controller's axes are the joints of the URDF.
        text: The URDF.
        base: Link that is F_b.
        flange: Link that is the flange.
        file: Name of the URDF, for messages.
        rng: Generator of the joint values.

    Raises:
        InputError: Pinocchio cannot read the URDF.
    """
    import pinocchio as pin

    try:
        model = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as problem:
        why = " ".join(str(problem).split())
        raise InputError(
            f"Pinocchio does not read it ({why})", "correct the URDF", file=file
        ) from problem
    free = np.where(robot.prismatic, 1.0, np.pi)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -free)
    upper = np.where(np.isfinite(robot.upper), robot.upper, free)
    q = rng.uniform(lower, upper, (_CONFIGURATIONS, robot.n))
    here = configure(robot, q)
    there = list(_flanges(model, robot, q, base, flange))
    R = np.stack([one.rotation for one in there])
    at = np.stack([one.translation for one in there])
    return UrdfAgreement(
        configurations=_CONFIGURATIONS,
        position_m=float(np.linalg.norm(here.flange_origin - at, axis=1).max()),
        angle_rad=float(_angles(here.flange_axes, R).max()),
    )


def _flanges(model: pin.Model, robot: Robot, q: Array, base: str, flange: str) -> Iterator[pin.SE3]:
    """Flange poses of the URDF relative to its base; joints outside the chain are at neutral.

    One `Data` serves all of them: its size grows with the cube of the number of joints.
    """
    import pinocchio as pin

    data, values = model.createData(), pin.neutral(model)
    joints = [model.joints[model.getJointId(name)] for name in robot.controller]
    ends = [model.getFrameId(link, pin.BODY) for link in (base, flange)]
    for one in q:
        for joint, value in zip(joints, one, strict=True):
            turns = joint.nq == 2  # a continuous joint: cosine and sine
            values[joint.idx_q : joint.idx_q + joint.nq] = (
                [np.cos(value), np.sin(value)] if turns else value
            )
        pin.framesForwardKinematics(model, data, values)
        first, last = (data.oMf[end] for end in ends)
        yield first.actInv(last)


def _angles(one: Array, other: Array) -> Array:
    """Angles between rotations (m, 3, 3) [rad], accurate also for small ones, shape (m,)."""
    return 2 * np.arcsin(np.linalg.norm(one - other, axis=(1, 2)) / np.sqrt(8.0))
