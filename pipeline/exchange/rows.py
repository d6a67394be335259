"""Rows of modified DH parameters for given axes: Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d).

z_j is the direction of axis j, including its sense. The remaining freedom is used to place the
frames on the common normals.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.machine.robot.steps import Fixed

_ROUNDING = 1e-9
"""Distance [m] or angle [rad] treated as zero: the resolution of numbers of about ten digits."""

_NEARLY_PARALLEL = 0.01
"""Angle between axes below which they count as nearly parallel [rad]: their common normal would be
a hundred times as far away as the axes are apart, so the row has beta instead."""

METRES, DEGREES = 12, 10
"""Decimals of lengths in m and of angles in degrees [1]: a picometre and 2e-12 rad, which are
nanometres on no robot."""


def frames(lines: list[tuple[Array, Array]], flange: Array) -> list[Array]:
    """The frame before the first row and one on each axis, n + 1 in total, each (4, 4).

    x of a frame points along the common normal to the next axis. If that is not unique, x is kept
    from the previous frame, so that arms with parallel axes have the usual parameters.
    """
    point, z = lines[0]
    here, x = point - z * (z @ point), _across(z, np.eye(3)[0], np.eye(3)[1])
    found = [_frame(here, x, z)]
    for (_, z), (next_point, next_z) in pairwise(lines):
        origin, here, x = _normal(here, z, next_point, next_z, x)
        found.append(_frame(origin, x, z))
    z = lines[-1][1]
    foot = here + z * (z @ (flange[:3, 3] - here))
    found.append(_frame(foot, _across(z, flange[:3, 0], flange[:3, 1]), z))
    return [np.eye(4), *found[1:]] if _plain(found[1]) else found


def _normal(
    here: Array, z: Array, point: Array, next_z: Array, x_before: Array
) -> tuple[Array, Array, Array]:
    """Feet of the common normal on one axis and on the next [m], and its direction, each (3,).

    Args:
        here: A point on the axis [m].
        z: Its direction.
        point: A point on the next axis [m].
        next_z: Its direction.
        x_before: Direction to keep if the normal is not unique.
    """
    across, apart = np.cross(z, next_z), point - here
    if np.linalg.norm(across) < _NEARLY_PARALLEL:
        origin, there = here, point - next_z * (z @ apart) / (z @ next_z)
        far = np.linalg.norm(there - origin) > _ROUNDING
        x = _across(z, there - origin) if far else _across(z, x_before)
    else:
        x = across / np.linalg.norm(across)
        s, t, a = linear.solve(np.stack([z, -next_z, x], axis=1), apart)
        origin, there = here + s * z, point + t * next_z
        x = -x if a < -_ROUNDING else x
    return origin, there, -x if x @ x_before < -_ROUNDING else x


def _across(z: Array, *wished: Array) -> Array:
    """The first of the vectors not parallel to z, made orthogonal to z, unit length, shape (3,)."""
    units = [wish / np.linalg.norm(wish) for wish in wished]
    squares = [unit - z * (z @ unit) for unit in units]
    found = next(one for one in squares if np.linalg.norm(one) > 0.1)
    return np.asarray(found / np.linalg.norm(found))


def _frame(origin: Array, x: Array, z: Array) -> Array:
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(z, x), z, origin
    return frame


def _plain(first: Array) -> bool:
    """Whether a row can lead from F_b to the first frame: an axis orthogonal to x that meets x."""
    z, at = first[:3, 2], first[:3, 3]
    off = at[1:] - z[1:] * (z[1:] @ at[1:])
    return bool(abs(z[0]) < _ROUNDING and np.linalg.norm(off) < 10**-METRES)


def row(before: Array, after: Array) -> dict[str, float]:
    """The DH parameters between two frames: Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d)."""
    T = linear.solve(before, after)
    z, at = T[:3, 2], T[:3, 3]
    alpha, beta = np.arctan2(-z[1], z[2]), np.arcsin(np.clip(z[0], -1.0, 1.0))
    d = float(z[1:] @ at[1:] / (z[1:] @ z[1:]))
    turned = Fixed(rpy_deg=(float(np.rad2deg(alpha)), 0.0, 0.0)).step
    turned = turned @ Fixed(rpy_deg=(0.0, float(np.rad2deg(beta)), 0.0)).step
    x, y = (turned[:3, :2].T @ T[:3, 0]).tolist()
    angles = {"alpha_deg": alpha, "beta_deg": beta, "theta_deg": np.arctan2(y, x)}
    found = {name: rounded_text(np.rad2deg(angle), DEGREES) for name, angle in angles.items()}
    found |= {"a_m": rounded_text(at[0] - d * z[0], METRES), "d_m": rounded_text(d, METRES)}
    return found if found["beta_deg"] else {k: v for k, v in found.items() if k != "beta_deg"}


def fixed(name: str, step: Array) -> dict[str, Any]:
    """A constant transform as a table of a robot file; empty if it is the identity."""
    if np.abs(step - np.eye(4)).max() < 10**-DEGREES:
        return {}
    R, at = step[:3, :3], step[:3, 3]
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < _ROUNDING:  # roll and yaw have the same axis
        turns = np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0
    else:
        turns = np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])
    return {
        name: {
            "xyz_m": [rounded_text(x, METRES) for x in at],
            "rpy_deg": [rounded_text(np.rad2deg(angle), DEGREES) for angle in turns],
        }
    }


def rounded_text(value: float, decimals: int) -> float:
    """Round a number to some decimals, zero without a sign."""
    return round(float(value), decimals) + 0.0
