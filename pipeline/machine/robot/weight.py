"""Wrenches and torques of the weight of links and payload.

A link is described by its mass m and first moment m c in its frame: its weight has the wrench
(moment about the origin of F_b, force) = ((m o + R m c) x g, m g), linear in both, and a joint
carries the sum over the links after it.
"""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot.configuration import Configuration, cross
from pipeline.machine.robot.mdh import Robot


def weighs(robot: Robot) -> bool:
    """Whether the robot file states masses of its links."""
    return any(joint.mass_kg for joint in robot.joints)


def link_moments(robot: Robot) -> Array:
    """Mass [kg] and first moment in the link's frame [kg m] of each link, shape (n, 4)."""
    mass = np.array([joint.mass_kg or 0.0 for joint in robot.joints])
    centre = np.array([joint.centre_of_mass_m or (0.0, 0.0, 0.0) for joint in robot.joints])
    return np.column_stack([mass, mass[:, None] * centre])


def carried(
    here: Configuration, gravity: Array, moments: Array, mass: Array, centre: Array
) -> Array:
    """Wrench of the weight of everything that each joint carries: moment [N m], force [N].

    Args:
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        moments: Mass [kg] and first moment [kg m] of each link, shape (n, 4).
        mass: Mass of the payload at each pose [kg], 0 for none, shape (m,).
        centre: Its centre of mass in the flange frame [m], shape (m, 3).

    Returns:
        Wrenches about the origin of F_b, shape (m, n, 6).
    """
    out = np.zeros((*here.q.shape, 6))
    heavy = np.flatnonzero(moments.any(axis=1))
    if len(heavy):
        at = moments[heavy, :1] * here.origin[:, heavy]
        at = at + np.einsum("mkij,kj->mki", here.axes[:, heavy], moments[heavy, 1:])
        out[:, heavy, :3], out[:, heavy, 3:] = cross(at, gravity), moments[heavy, :1] * gravity
    if mass.any():
        at = here.flange_origin + np.einsum("mij,mj->mi", here.flange_axes, centre)
        force = mass[:, None] * gravity
        out[:, -1, :3] += cross(at, force)
        out[:, -1, 3:] += force
    return np.cumsum(out[:, ::-1], axis=1)[:, ::-1]


def by_moments(here: Configuration, gravity: Array) -> Array:
    """Derivative of each link's wrench by its mass and first moment, shape (m, n, 4, 6)."""
    m, n = here.q.shape
    out = np.zeros((m, n, 4, 6))
    out[:, :, 0, :3], out[:, :, 0, 3:] = cross(here.origin, gravity), gravity
    out[:, :, 1:, :3] = cross(np.swapaxes(here.axes, 2, 3), gravity)
    return out


def work(screws: Array, wrenches: Array) -> Array:
    """Work of wrenches (m, v, 6) per unit of screws (m, v, 6): torque or force, shape (m, v)."""
    return np.asarray(np.einsum("mvi,mvi->mv", screws, wrenches))


def gravity_torque(
    robot: Robot, here: Configuration, gravity: Array, mass: Array, centre: Array
) -> Array:
    """Torque (force) of weight about (along) each joint, in its positive sense [N m] or [N].

    tau_j = sum over the masses k carried by joint j of J_j(r_k)' m_k g, F_b.

    Args:
        robot: Robot with masses and centres of its links; links without a mass are weightless.
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        mass: Mass of the payload at each pose [kg], 0 for none, shape (m,).
        centre: Its centre of mass in the flange frame [m], shape (m, 3).

    Returns:
        Shape (m, n).
    """
    return work(here.twists, carried(here, gravity, link_moments(robot), mass, centre))
