"""Distance of poses from obstacles of a cell, and its derivative by the joints.

A gap changes by sum_k g_k . dp_k of the points p_k of the arm that define it. Seen from the joints
these g_k are forces: the derivative of any sum of gaps is the torque tau_j = twist_j . W of the
wrench W = (p x g, g) that acts beyond joint j, Eq. (5). The poses are the last axis of arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.design.room import Room, closest, dot, length
from pipeline.machine.robot import Configuration

_ROUNDED = 1e-3
"""Minimum gap of random poses [m or 1]: they are printed rounded to 1e-4 deg."""


@dataclass(frozen=True, eq=False)
class _Point:
    """Points of the arm that gaps depend on.

    Attributes:
        at: In F_b [m], shape (3, k).
        carrier: Number of the joint that carries each, 0 for what does not move, shape (k,).
        slope: Derivative of the gap by the point, shape (3, k).
    """

    at: Array
    carrier: Ints
    slope: Array


@dataclass(frozen=True, eq=False)
class Gaps:
    """Narrow gaps, k of them in all poses together.

    Attributes:
        pose: Pose of each, from 0, shape (k,).
        value: Positive where kept [m], [1] for cosines, shape (k,).
        points: The points of the arm that each depends on.
        by_anchor: Derivative by the anchor of the chain, shape (3, k); None where it is zero.
    """

    pose: Ints
    value: Array
    points: tuple[_Point, ...]
    by_anchor: Array | None = None


def gaps(room: Room, at: Configuration, points: Array, anchor: Array, near: float) -> list[Gaps]:
    """All gaps of a room that are narrow, at every pose.

    Args:
        room: Space that a pose must leave free.
        at: The poses.
        points: Load point, then reflectors, in F_b [m], shape (1 + t, 3, m).
        anchor: Anchor of the chain, F_b [m], shape (3, m).
        near: Gaps of this width or more [m] or [1] are left out.
    """
    places = points.transpose(1, 0, 2)
    far = np.empty_like(places)
    far[:] = (anchor if room.tracker is None else room.tracker[:, None])[:, None]
    far[:, 0] = anchor
    ends = at.placed(room.bodies)
    found = [_touching(room, places, far, ends, near)]
    if room.cones:
        found.append(_shot(room, at, places, far, near))
    if room.floor is not None:
        found.append(_grounded(room, places, ends, near))
    return found


def free(room: Room, at: Configuration, tool: Array, anchor: Array) -> Bools:
    """Poses that keep all gaps and the joint limits that cables allow, shape (m,).

    Args:
        room: Space that a pose must leave free.
        at: The poses.
        tool: Load point, then reflectors, flange frame [m], shape (1 + t, 3).
        anchor: Anchor of the chain of each pose, F_b [m], shape (m, 3).
    """
    out: Bools = np.all((at.q >= room.lower) & (at.q <= room.upper), axis=1)
    for found in gaps(room, at, np.moveaxis(at.points(tool), 0, -1), anchor.T, _ROUNDED):
        out[found.pose] = False
    return out


def _shot(room: Room, at: Configuration, places: Array, far: Array, near: float) -> Gaps:
    """Cosine between the line that leaves a point and the axis of its cone, minus its limit.

    value = b . d - cos(limit) with b = (end - p) / L; d, carried by the flange, is the difference
    of the points p + d and p.
    """
    point = np.array([cone.point for cone in room.cones])
    axis = np.stack([cone.axis for cone in room.cones], axis=1)[:, None, :, None]
    limit = np.cos([cone.half_angle for cone in room.cones])
    d = (axis * at.flange_axes.transpose(2, 1, 0)[:, :, None]).sum(axis=0)  # xyz, cone, pose
    line = (far - places)[:, point]
    reach = length(line)
    value = dot(line, d) / reach - limit[:, None]
    which, pose = np.nonzero(value < near)
    value, reach, d = value[which, pose], reach[which, pose], d[:, which, pose]
    b, p = line[:, which, pose] / reach, places[:, point[which], pose]
    along = (d - (value + limit[which]) * b) / reach
    carrier = np.full(len(pose), room.joints)
    points = _Point(p + d, carrier, b), _Point(p, carrier, -b - along)
    return Gaps(pose, value, points, along * (point[which] == 0))


def _grounded(room: Room, places: Array, ends: Array, near: float) -> Gaps:
    """Height of points of the effector and of the lower ends of capsules above the floor."""
    lifted = np.flatnonzero(room.lifted)
    ends = ends[:, :, lifted]
    low = np.where(ends[0, 2] < ends[1, 2], ends[0], ends[1])
    every = np.concatenate([places, low], axis=1)
    none = np.zeros(places.shape[1])
    value = every[2] - np.concatenate([none, room.bodies.radius[lifted]])[:, None] - room.floor
    which, pose = np.nonzero(value < near)
    effector = np.full(places.shape[1], room.joints)
    carrier = np.concatenate([effector, room.bodies.carrier[lifted]])[which]
    up = np.repeat([[0.0], [0.0], [1.0]], len(pose), axis=1)
    return Gaps(pose, value[which, pose], (_Point(every[:, which, pose], carrier, up),))


def _touching(room: Room, places: Array, far: Array, ends: Array, near: float) -> Gaps:
    """Distance between capsules, and of beams and chain from capsules.

    A line is a capsule without thickness that ends at a fixed point. Computed only where one is
    near the ball around the other.
    """
    radius, carrier = room.bodies.radius, room.bodies.carrier
    i, j, pose = _near_pairs(room, ends, near)
    point, body, when = _near_lines(room, places, far, ends, near)
    body, pose = np.concatenate([j, body]), np.concatenate([pose, when])
    start = np.concatenate([ends[0][:, i, pose[: len(i)]], places[:, point, when]], axis=1)
    end = np.concatenate([ends[1][:, i, pose[: len(i)]], far[:, point, when]], axis=1)
    c, d = ends[0][:, body, pose], ends[1][:, body, pose]
    s, t = closest(start, end, c, d)
    q, between = c + t * (d - c), start + s * (end - start) - c - t * (d - c)
    distance = length(between)
    thick = np.concatenate([radius[i], np.zeros(len(point))]) + radius[body]
    some = np.flatnonzero(distance - thick < near)
    normal = between[:, some] / distance[some].clip(1e-12)
    line, s = (some >= len(i)), s[some]
    moving = np.concatenate([carrier[i], np.full(len(point), room.joints)])[some]
    from_start = np.where(line, 0.0, s) * (end - start)[:, some]  # a line acts at its start
    p = _Point(start[:, some] + from_start, moving, np.where(line, 1 - s, 1.0) * normal)
    points = p, _Point(q[:, some], carrier[body[some]], -normal)
    chain = np.concatenate([np.zeros(len(i), bool), point == 0])[some]
    return Gaps(pose[some], (distance - thick)[some], points, chain * s * normal)


def _near_pairs(room: Room, ends: Array, near: float) -> tuple[Ints, Ints, Ints]:
    """Pairs of capsules, one near the ball around the other, and their pose, (k,) each."""
    half, radius = room.bodies.half, room.bodies.radius
    i, j = room.pairs  # the second is the longer one
    middle = (ends[0][:, i] + ends[1][:, i]) / 2
    reach = half[i] + radius[i] + radius[j] + near
    off = _from_line(ends[0][:, j], ends[1][:, j], middle)
    which, pose = np.nonzero(off < reach[:, None] ** 2)
    return i[which], j[which], pose


def _near_lines(
    room: Room, places: Array, far: Array, ends: Array, near: float
) -> tuple[Ints, Ints, Ints]:
    """Pairs of a line and a capsule, one near the ball around the other, and their pose, (k,) each.

    The ball around a rail is as large as a hall: the box around fixed bodies is tested in its
    place.
    """
    start, end = places[:, :, None], far[:, :, None]
    reach = room.bodies.radius[:, None] + near
    off = _from_line(start, end, (ends[0] + ends[1])[:, None] / 2)
    found = (off < (room.bodies.half[:, None] + reach) ** 2) & room.crossed[..., None]
    still = room.bodies.carrier == 0
    box = ends[:, :, None, still]
    above = np.minimum(start, end) < np.maximum(*box) + reach[still]
    below = np.maximum(start, end) > np.minimum(*box) - reach[still]
    found[:, still] &= (above & below).all(axis=0)
    point, body, pose = np.nonzero(found)
    return point, body, pose


def _from_line(a: Array, b: Array, p: Array) -> Array:
    """Squared distance of points p from segments ab [m^2], (3, ...) each."""
    u, w = b - a, p - a
    along, whole = dot(w, u), dot(u, u).clip(1e-12)
    share = np.clip(along / whole, 0, 1)
    return np.asarray(dot(w, w) - share * (2 * along - share * whole))
