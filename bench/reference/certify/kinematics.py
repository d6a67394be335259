"""A robot in 50-digit arithmetic: frames by DH parameters, torques, equilibrium under load."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpmath import matrix, mp, mpf

mp.dps = 50

Vector = list[Any]
Frame = tuple[Any, Vector]
"""Rotation (3 x 3) and origin."""


@dataclass(frozen=True)
class Row:
    """A joint: Tx(a) Rx(alpha), then Rz(theta + q) Tz(d), or Rz(theta) Tz(d + q) if prismatic."""

    name: str
    slides: bool
    alpha: Any
    a: Any
    theta: Any
    d: Any


@dataclass(frozen=True)
class Robot:
    """The joints from base to flange."""

    rows: tuple[Row, ...]


def read(path: Path) -> Robot:
    """Read a robot file in modified DH, in Khalil's or Craig's letters."""
    said = tomllib.loads(path.read_text("utf-8"), parse_float=mpf)
    if said["convention"] not in ("khalil", "craig"):
        raise ValueError(f"{path}: {said['convention']} is not written here")
    a, d = ("d_m", "r_m") if said["convention"] == "khalil" else ("a_m", "d_m")
    return Robot(
        tuple(
            Row(
                row["name"],
                row["type"] == "prismatic",
                degrees(row.get("alpha_deg", 0)),
                mpf(row.get(a, 0)),
                degrees(row.get("theta_deg", 0)),
                mpf(row.get(d, 0)),
            )
            for row in said["joint"]
        )
    )


def degrees(angle: Any) -> Any:
    """An angle in radians."""
    return mpf(angle) * mp.pi / 180


def frames(robot: Robot, q: Sequence[Any]) -> list[Frame]:
    """Frame of every joint in F_b, behind its own motion; the last one is the flange."""
    R, p = mp.eye(3), [mpf(0)] * 3
    out = []
    for row, value in zip(robot.rows, q, strict=True):
        p = add(p, times(R, [row.a, 0, 0]))
        R = R * turn_x(row.alpha)
        angle, along = (row.theta, row.d + value) if row.slides else (row.theta + value, row.d)
        p = add(p, times(R, [0, 0, along]))
        R = R * turn_z(angle)
        out.append((R, p))
    return out


def turn_x(angle: Any) -> Any:
    """Rotation about x."""
    c, s = mp.cos(angle), mp.sin(angle)
    return matrix([[1, 0, 0], [0, c, -s], [0, s, c]])


def turn_z(angle: Any) -> Any:
    """Rotation about z."""
    c, s = mp.cos(angle), mp.sin(angle)
    return matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def times(R: Any, v: Sequence[Any]) -> Vector:
    """R v."""
    return [sum(R[i, k] * v[k] for k in range(3)) for i in range(3)]


def add(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """A + b."""
    return [x + y for x, y in zip(a, b, strict=True)]


def less(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """A - b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """A . b."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """A x b."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def at(flange: Frame, place: Sequence[Any]) -> Vector:
    """A point of the flange frame in F_b."""
    return add(flange[1], times(flange[0], place))


def efforts(robot: Robot, chain: list[Frame], where: Vector, force: Vector) -> Vector:
    """Force along, or torque about, every joint due to a force at a point."""
    out = []
    for row, (R, p) in zip(robot.rows, chain, strict=True):
        z = [R[i, 2] for i in range(3)]
        out.append(dot(z, force) if row.slides else dot(z, cross(less(where, p), force)))
    return out


def motions(robot: Robot, chain: list[Frame], point: Vector) -> list[Vector]:
    """Displacement of a point of the effector per unit of every joint."""
    out = []
    for row, (R, p) in zip(robot.rows, chain, strict=True):
        z = [R[i, 2] for i in range(3)]
        out.append(z if row.slides else cross(z, less(point, p)))
    return out


def at_rest(
    robot: Robot, q: Sequence[Any], x: Sequence[Any], load_point: Sequence[Any], force: Vector
) -> list[Frame]:
    """Frames of the deflected robot: every joint yields by its compliance times its effort there.

    The springs act about the joints' own axes, so that the deflected robot is the undeformed one at
    q + delta with delta_j = x_j tau_j(q + delta), by fixed-point iteration.
    """
    delta = [mpf(0)] * len(q)
    for _ in range(200):
        chain = frames(robot, add(q, delta))
        tau = efforts(robot, chain, at(chain[-1], load_point), force)
        new = [c * t for c, t in zip(x, tau, strict=True)]
        still = max(abs(a - b) for a, b in zip(new, delta, strict=True)) < mpf(10) ** -45
        delta = new
        if still:
            return frames(robot, add(q, delta))
    raise ArithmeticError("the robot does not come to rest under this force")
