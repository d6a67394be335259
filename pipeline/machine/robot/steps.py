"""Constant transformations between frames, as written in tables and URDFs."""

from __future__ import annotations

import numpy as np
from pydantic import ConfigDict

from pipeline.base.arrays import Array
from pipeline.base.strict import Degrees, Length, Numbers


class Fixed(Numbers):
    """Constant transformation between frames: xyz [m], then Rz(yaw) Ry(pitch) Rx(roll) [deg]."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    xyz_m: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)

    @property
    def step(self) -> Array:
        """Pose of the second frame in the first, shape (4, 4)."""
        roll, pitch, yaw = np.deg2rad(self.rpy_deg)
        step = screw_z(yaw, 0.0) @ turn_y(pitch) @ screw_x(roll, 0.0)
        step[:3, 3] = self.xyz_m
        return step


def screw_x(alpha: float, a: float) -> Array:
    """Tx(a) Rx(alpha), [m] and [rad], shape (4, 4)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def screw_z(theta: float, r: float) -> Array:
    """Rz(theta) Tz(r), [rad] and [m], shape (4, 4)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, r], [0, 0, 0, 1.0]])


def turn_y(beta: float) -> Array:
    """Ry(beta), [rad], shape (4, 4)."""
    c, s = np.cos(beta), np.sin(beta)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])
