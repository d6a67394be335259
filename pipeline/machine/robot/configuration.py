"""Vectorised kinematics: a `Configuration` holds joint values of many poses and their frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.machine.robot.capsules import Capsules
from pipeline.machine.robot.mdh import Robot


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
        """Rotation (m, 3, 3) and origin (m, 3) of the frame of joint 1..n."""
        return self.axes[:, joint - 1], self.origin[:, joint - 1]

    def placed(self, bodies: Capsules) -> Array:
        """Both ends of capsules in F_b [m], shape (2, 3, c, m), the m poses side by side."""
        out = np.empty((2, 3, len(bodies), len(self.q)))
        out[:] = bodies.ends.transpose(0, 2, 1)[..., None]
        moving = np.flatnonzero(bodies.carrier)
        joint = bodies.carrier[moving] - 1
        axes = self.axes.transpose(3, 2, 1, 0)[:, :, joint]  # which axis, xyz, capsule, pose
        origin = self.origin.transpose(2, 1, 0)[:, joint]
        for end, x in zip(out, bodies.ends[:, moving, :, None], strict=True):
            end[:, moving] = origin + x[:, 0] * axes[0] + x[:, 1] * axes[1] + x[:, 2] * axes[2]
        return out


def configure(robot: Robot, q: Array) -> Configuration:
    """Compute all frames of `robot` at `q`; cached for a small number of poses.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
    """
    q = np.asarray(q, dtype=float)
    return _kept(robot, q.tobytes(), len(q)) if len(q) <= _FEW else _configured(robot, q)


_FEW = 256
"""Maximum number of poses whose frames are cached: a diagnosis requests those of the same poses 300
times."""


@lru_cache(maxsize=64)
def _kept(robot: Robot, q: bytes, m: int) -> Configuration:
    """Cached frames, keyed by the joint values as bytes."""
    return _configured(robot, np.frombuffer(q).reshape(m, robot.n))


def _configured(robot: Robot, q: Array) -> Configuration:
    m, n = q.shape
    values = np.ascontiguousarray(q.T)
    cos, sin = np.cos(values), np.sin(values)
    axes, origin = np.empty((n, 3, 3, m)), np.empty((n, 3, m))  # joint, which axis, xyz, pose
    R, o = np.repeat(np.eye(3)[:, :, None], m, axis=2), np.zeros((3, m))
    for j, joint in enumerate(robot.joints):
        R, o = _moved(R, o, robot.placement[j])
        if joint.prismatic:
            axes[j], o = R, o + R[2] * values[j]
        else:
            np.add(cos[j] * R[0], sin[j] * R[1], out=axes[j, 0])
            np.subtract(cos[j] * R[1], sin[j] * R[0], out=axes[j, 1])
            axes[j, 2] = R[2]
        R, origin[j] = axes[j], o
    flange_axes, flange_origin = _moved(R, o, robot.flange)
    return Configuration(
        q=q,
        axes=axes.transpose(3, 0, 2, 1),
        origin=origin.transpose(2, 0, 1),
        flange_axes=flange_axes.transpose(2, 1, 0),
        flange_origin=flange_origin.T,
        twists=_joint_twists(robot, axes[:, 2], origin),
    )


def _moved(R: Array, o: Array, step: Array) -> tuple[Array, Array]:
    """Frame (axes (3, 3, m), origin (3, m)) composed with a constant transformation (4, 4)."""
    m = R.shape[-1]
    flat = R.reshape(3, 3 * m)
    return (step[:3, :3].T @ flat).reshape(3, 3, m), o + (step[:3, 3] @ flat).reshape(3, m)


def _joint_twists(robot: Robot, z: Array, origin: Array) -> Array:
    """Unit screws, shape (m, n, 6), from z axes and origins (n, 3, m)."""
    slides = robot.prismatic
    twists = np.empty((len(z), 6, z.shape[-1]))
    twists[:, :3] = z
    twists[:, 3:] = cross(origin.transpose(2, 0, 1), z.transpose(2, 0, 1)).transpose(1, 2, 0)
    twists[slides, :3], twists[slides, 3:] = 0.0, z[slides]
    return twists.transpose(2, 0, 1)


def cross(a: Array, b: Array) -> Array:
    """Vector product over the last axis, for shapes (m, ..., 3).

    As for all arrays of a `Configuration`, poses are contiguous in memory: numpy then works on long
    rows, three times as fast as its own product on rows of three.
    """
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    first = y * w
    out = np.empty((*first.shape[1:], 3, len(first))).transpose(-1, *range(first.ndim))
    np.subtract(first, z * v, out=out[..., 0])
    np.subtract(z * u, x * w, out=out[..., 1])
    np.subtract(x * v, y * u, out=out[..., 2])
    return out


def rotation_about(origin: Array, axis: Array) -> Array:
    """Twist of a unit rotation about `axis` through `origin`, both (m, 3); shape (m, 6)."""
    return np.concatenate([axis, cross(origin, axis)], axis=-1)


def translation_along(axis: Array) -> Array:
    """Twist of a unit translation along `axis`, (m, 3); shape (m, 6)."""
    return np.concatenate([np.zeros_like(axis), axis], axis=-1)


def rigid_motions(point: Array, axes: Array) -> tuple[Array, ...]:
    """Unit rotations about, then translations along the columns of `axes`, (m, 3, 3), (m, 6)."""
    each = [axes[:, :, k] for k in range(3)]
    return (*(rotation_about(point, axis) for axis in each), *map(translation_along, each))


def velocity(twists: Array, points: Array) -> Array:
    """Velocity of points per unit of each screw, omega x p + v: the Jacobians J_m of Eq. (4).

    Args:
        twists: Screws in F_b, shape (m, k, 6).
        points: Points in F_b [m], shape (m, t, 3).

    Returns:
        Shape (m, t, k, 3).
    """
    omega, v = twists[:, None, :, :3], twists[:, None, :, 3:]
    moved = cross(omega, points[:, :, None, :])
    moved += v
    return moved


def torque(twists: Array, point: Array, force: Array) -> Array:
    """Work of a force at a point per unit of each screw: J_l^T f of Eq. (5), shape (m, k).

    Args:
        twists: Screws in F_b, shape (m, k, 6).
        point: Point of application in F_b [m], shape (m, 3).
        force: Force in F_b [N], shape (m, 3).
    """
    work = np.concatenate([cross(point, force), force], axis=-1)
    return sum(twists[..., i] * work[:, None, i] for i in range(6))
