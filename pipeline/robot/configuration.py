"""Kinematics of many poses at once: a `Configuration` is joint values whose frames are computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.results import Array, Locked
from pipeline.robot.mdh import Robot


@dataclass(frozen=True, eq=False)
class Configuration(Locked):
    """Frames of a robot at m joint vectors, in F_b.

    Attributes:
        q: Joint values [m] or [rad], shape (m, n).
        axes: Rotation of each joint frame after its own motion, columns x, y, z, (m, n, 3, 3).
        origin: Origin of each joint frame [m], shape (m, n, 3).
        flange_axes: Rotation of the flange, shape (m, 3, 3).
        flange_origin: Origin of the flange [m], shape (m, 3).
        twists: Unit joint screws (omega, v at the origin of F_b), shape (m, n, 6).
    """

    q: Array
    axes: Array
    origin: Array
    flange_axes: Array
    flange_origin: Array
    twists: Array

    def points(self, tool: Array) -> Array:
        """Points fixed to the flange, in F_b.

        Args:
            tool: Coordinates in the flange frame [m], shape (t, 3).

        Returns:
            Coordinates in F_b [m], shape (m, t, 3).
        """
        return self.flange_origin[:, None, :] + np.einsum("mij,tj->mti", self.flange_axes, tool)

    def frame(self, joint: int) -> tuple[Array, Array]:
        """Rotation (m, 3, 3) and origin (m, 3) of the frame of joint 1..n; 0 is F_b itself."""
        if joint == 0:
            m = len(self.q)
            return np.broadcast_to(np.eye(3), (m, 3, 3)), np.zeros((m, 3))
        return self.axes[:, joint - 1], self.origin[:, joint - 1]


def configure(robot: Robot, q: Array) -> Configuration:
    """Compute all frames of `robot` at `q`.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
    """
    q = np.asarray(q, dtype=float)
    m, n = q.shape
    cos, sin = np.cos(q), np.sin(q)
    axes, origin = np.empty((m, n, 3, 3)), np.empty((m, n, 3))
    R, o = np.broadcast_to(np.eye(3), (m, 3, 3)), np.zeros((m, 3))
    for j, joint in enumerate(robot.joints):
        o = o + R @ robot.placement[j, :3, 3]
        R = R @ robot.placement[j, :3, :3]
        if joint.prismatic:
            o = o + R[:, :, 2] * q[:, j, None]
        else:
            x, y = R[:, :, 0], R[:, :, 1]
            c, s = cos[:, j, None], sin[:, j, None]
            R = np.stack([c * x + s * y, c * y - s * x, R[:, :, 2]], axis=-1)
        axes[:, j], origin[:, j] = R, o
    return Configuration(
        q=q,
        axes=axes,
        origin=origin,
        flange_axes=R @ robot.flange[:3, :3],
        flange_origin=o + R @ robot.flange[:3, 3],
        twists=_joint_twists(robot, axes[..., 2], origin),
    )


def _joint_twists(robot: Robot, z: Array, origin: Array) -> Array:
    slides = robot.prismatic[None, :, None]
    omega = np.where(slides, 0.0, z)
    v = np.where(slides, z, np.cross(origin, z))
    return np.concatenate([omega, v], axis=-1)


def rotation_about(origin: Array, axis: Array) -> Array:
    """Twist of a unit rotation about `axis` through `origin`, both (m, 3); shape (m, 6)."""
    return np.concatenate([axis, np.cross(origin, axis)], axis=-1)


def translation_along(axis: Array) -> Array:
    """Twist of a unit translation along `axis`, (m, 3); shape (m, 6)."""
    return np.concatenate([np.zeros_like(axis), axis], axis=-1)


def velocity(twists: Array, points: Array) -> Array:
    """How points move per unit of each screw, omega x p + v: the Jacobians J_m of Eq. (4).

    Args:
        twists: Shape (m, k, 6).
        points: Shape (m, t, 3), in F_b [m].

    Returns:
        Shape (m, t, k, 3).
    """
    omega, v = twists[:, None, :, :3], twists[:, None, :, 3:]
    return np.cross(omega, points[:, :, None, :]) + v


def torque(twists: Array, point: Array, force: Array) -> Array:
    """Work of a force at a point per unit of each screw: J_l^T f of Eq. (5), shape (m, k).

    Args:
        twists: Shape (m, k, 6).
        point: Where the force acts [m], shape (m, 3).
        force: [N], shape (m, 3).
    """
    moment = np.cross(point, force)
    return np.einsum("mki,mi->mk", twists[..., :3], moment) + np.einsum(
        "mki,mi->mk", twists[..., 3:], force
    )
