"""What the arm's own weight, and a payload on its flange, do to its joints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot.configuration import Configuration, torque
from pipeline.machine.robot.mdh import Robot


def weighs(robot: Robot) -> bool:
    """Whether the robot file says what its links weigh."""
    return any(joint.mass_kg for joint in robot.joints)


def gravity_torque(
    robot: Robot, here: Configuration, gravity: Array, mass: Array, centre: Array
) -> Array:
    """Torque (force) of weight on each joint, positive the way the joint moves [N m] or [N].

    tau_j = sum over the masses k carried by joint j of J_j(r_k)' m_k g, F_b.

    Args:
        robot: With masses and centres of its links; links without weigh nothing.
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        mass: Of the payload at each pose [kg], 0 for none, shape (m,).
        centre: Its centre in the flange frame [m], shape (m, 3).

    Returns:
        Shape (m, n).
    """
    tau = np.zeros_like(here.q)
    for carried, at, weight in _weights(robot, here, mass, centre):
        force = weight[:, None] * gravity
        tau[:, :carried] += torque(here.twists[:, :carried], at, force)
    return tau


def payload_torques(here: Configuration, gravity: Array, mass: Array, centre: Array) -> Array:
    """Derivatives of the torque of a payload's weight by its mass and its centre.

    With r = o + F c in F_b, tau_j = J_j(r)' m g: by m it is J_j(r)' g, and by the coordinate k of
    the centre w_j . (F e_k x m g), w_j the axis of a turning joint.

    Args:
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        mass: Of the payload at each pose [kg], shape (m,).
        centre: Its centre in the flange frame [m], shape (m, 3).

    Returns:
        By mass [N m/kg] and by the centre along x, y, z [N], shape (m, n, 4).
    """
    at = here.flange_origin + np.einsum("mij,mj->mi", here.flange_axes, centre)
    by_mass = torque(here.twists, at, np.broadcast_to(gravity, at.shape))
    pull = np.cross(np.swapaxes(here.flange_axes, 1, 2), (mass[:, None] * gravity)[:, None, :])
    by_centre = np.einsum("mji,mki->mjk", here.twists[..., :3], pull)
    return np.concatenate([by_mass[..., None], by_centre], axis=2)


def _weights(
    robot: Robot, here: Configuration, mass: Array, centre: Array
) -> Iterator[tuple[int, Array, Array]]:
    """Joints that carry it, place (m, 3) and mass (m,) of each weight."""
    m = len(here.q)
    for number, joint in enumerate(robot.joints, 1):
        if joint.mass_kg:
            R, o = here.frame(number)
            lever = np.array(joint.centre_of_mass_m or (0.0, 0.0, 0.0))
            yield number, o + R @ lever, np.full(m, joint.mass_kg)
    if mass.any():
        at = here.flange_origin + np.einsum("mij,mj->mi", here.flange_axes, centre)
        yield robot.n, at, mass
