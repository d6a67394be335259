"""User-supplied joint values, forces and points: checked, in SI."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, listed
from pipeline.library import holds
from pipeline.machine.robot import Joint, Robot
from pipeline.machine.robot.axes import LIMIT_SLACK

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    _Found = TypeVar("_Found", bound=DataclassInstance)

_TURN = 2 * np.pi
"""Joint angle beyond its limits from which degrees are suspected [rad]."""
_TURNS = 4 * np.pi
"""Maximum angle of a joint from its zero [rad], whether its file has limits or not."""


def joint_values(robot: Robot, q: npt.ArrayLike) -> Array:
    """Joint values [m] or [rad], shape (m, n), checked against the limits of the robot file.

    Args:
        robot: The robot.
        q: Prismatic joints in m, revolute joints in rad, shape (n,) or (m, n).

    Raises:
        InputError: Not n numbers per row, not finite, beyond a limit, or in degrees or mm.
    """
    values = _numbers("q", q)
    if values.ndim not in (1, 2) or values.shape[-1] != robot.n or not values.size:
        units = [f"{joint.name} [{_unit(joint)}]" for joint in robot.joints]
        raise InputError(
            f"q has shape {values.shape}, and {robot.name} has {robot.n} joints: {listed(units)}",
            f"give an array of shape ({robot.n},), or (m, {robot.n}) for m poses",
        )
    rows = np.atleast_2d(values)
    outside = (rows < robot.lower - LIMIT_SLACK) | (rows > robot.upper + LIMIT_SLACK)
    outside |= ~robot.prismatic & (np.abs(rows) > _TURNS)
    if outside.any():
        m, j = np.argwhere(outside)[0].tolist()
        raise _beyond(robot, rows[m], j, m + 1 if len(rows) > 1 else None)
    return rows


def _beyond(robot: Robot, row: Array, j: int, number: int | None) -> InputError:
    """Error for a joint beyond its limits, with a way out that fits the apparent unit."""
    joint, value = robot.joints[j], float(row[j])
    where = f"joint {j + 1} ({joint.name})" + ("" if number is None else f" of row {number}")
    if joint.prismatic:
        mm = joint.lower <= value / 1e3 <= joint.upper
        text = f"{where}: {value:.6g} m is beyond {joint.lower:.6g}..{joint.upper:.6g} m"
        return InputError(text, "lengths are in m: divide millimetres by 1000" if mm else _MOVE)
    lower, upper = np.rad2deg([joint.lower, joint.upper])
    limits = f"{lower:.6g}..{upper:.6g} deg" if np.isfinite(upper - lower) else "two turns"
    if abs(value) > _TURN:
        way_out = "angles are in rad: convert degrees with robot.from_degrees(q)"
        return InputError(f"{where}: {value:.6g} rad is beyond {limits}", way_out)
    return InputError(f"{where}: {np.rad2deg(value):.6g} deg is beyond {limits}", _MOVE)


_MOVE = "give a pose within the limits, or correct these in the robot file"


def loaded(robot: Robot, q: npt.ArrayLike, force_n: npt.ArrayLike) -> tuple[Array, Array]:
    """Joint values (m, n) and the force at each [N], (m, 3), from one or many of either.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (n,) or (m, n).
        force_n: Force on the robot [N], F_b, shape (3,) or (m, 3).

    Raises:
        InputError: As `joint_values`; or forces are not finite, do not match the poses in number,
            or exceed what such a robot can hold.
    """
    rows, force = joint_values(robot, q), _numbers("force_n", force_n)
    if force.ndim not in (1, 2) or force.shape[-1] != 3 or not force.size:
        raise InputError(
            f"force_n has shape {force.shape}", "give x, y, z [N] as shape (3,), or (m, 3)"
        )
    forces = np.atleast_2d(force)
    m = max(len(rows), len(forces))
    if len(rows) not in (1, m) or len(forces) not in (1, m):
        raise InputError(
            f"there are {len(forces)} forces for {len(rows)} poses",
            "give one force for all poses, or one for each",
        )
    hardest = float(np.linalg.norm(forces, axis=1).max())
    holds.refuse_absurd(robot, hardest, "forces are in N")
    return np.broadcast_to(rows, (m, robot.n)), np.broadcast_to(forces, (m, 3))


def as_asked(found: _Found, *given: npt.ArrayLike) -> _Found:
    """Drop the axis of the poses from all arrays if a single pose was given without it."""
    if any(np.ndim(one) != 1 for one in given):
        return found
    own = {one.name: getattr(found, one.name) for one in fields(found)}
    return replace(found, **{k: v[0] for k, v in own.items() if isinstance(v, np.ndarray)})


def point(name: str, values: npt.ArrayLike | None) -> Array | None:
    """A point of the tool in the flange frame [m], shape (3,); None if none is given.

    Raises:
        InputError: It is not a point, or so far away that it must be in mm.
    """
    if values is None:
        return None
    found = _numbers(name, values)
    if found.shape != (3,):
        raise InputError(f"{name} has shape {found.shape}", "give x, y, z, shape (3,)")
    if np.abs(found).max() > _FAR_M:
        far = float(np.abs(found).max())
        raise InputError(
            f"{name} lies {far:.6g} m off the flange",
            "lengths are in m: divide millimetres by 1000",
        )
    return found


_FAR_M = 10.0
"""Maximum distance of a point of the effector from its flange [m]."""


def _numbers(name: str, values: npt.ArrayLike) -> Array:
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{name} is no array of numbers", "give numbers in SI") from problem
    if not np.isfinite(found).all():
        at = np.argwhere(~np.isfinite(found))[0].tolist()
        raise InputError(f"{name}{at} is {found[tuple(at)]}", "give finite numbers")
    return found


def _unit(joint: Joint) -> str:
    return "m" if joint.prismatic else "rad"
