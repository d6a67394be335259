"""Feasible poses: within the joint limits, effector above the floor, chain free."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.errors import InputError
from pipeline.design.gaps import free
from pipeline.design.room import Room
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.axes import rounded

_CHAIN_M = (1.2, 4.5)
"""Shortest and longest sensible chain [m], scale and turnbuckle included."""
_CLEARANCE_M = 0.3
"""Minimum height of joints, load point and targets above the floor [m]."""
_COLUMN_M = 0.6
"""Minimum distance of the chain from the robot's column [m]."""
_LONGEST_RAIL_M = 1000.0
"""Upper limit of the length of a rail [m]; a joint without limits is infinitely long."""
_FAR_M = 1e6
"""Replacement for the limit of a sliding joint without one [m]."""
_RAIL_REACH_M = 2.5
"""Maximum distance of the carriage from the anchor along the rail [m]."""


def default_anchors(robot: Robot) -> Array:
    """Floor points to pull to: on both sides of a rail every 3 m, or around a fixed robot [m].

    The floor is 0.891 m below F_b at a rail (Eq. (17)) and at z = 0 for a robot on the floor.

    Raises:
        InputError: The rail has no limits, or implausible ones.
    """
    if not robot.joints[0].prismatic:
        angle = np.arange(6) * np.pi / 3
        return np.stack([2.5 * np.cos(angle), 2.5 * np.sin(angle), 0 * angle], axis=-1)
    rail, lower, upper = robot.joints[0].name, robot.lower[0], robot.upper[0]
    if not upper - lower <= _LONGEST_RAIL_M:
        raise InputError(
            f"{rail} reaches from {lower:g} to {upper:g} m, and nobody says where to pull to",
            "give the joint its limits in the robot file, or pulls.anchors in the plan",
            file="plan",
        )
    along = np.arange(min(lower + 1.5, (lower + upper) / 2), upper, 3.0)
    side = np.where(np.arange(len(along)) % 2 == 0, 2.5, -2.5)
    return np.stack([side, along, np.full_like(along, -0.891)], axis=-1)


def draw_poses(
    robot: Robot, tool: Array, anchors: Array, which: Ints, rng: np.random.Generator
) -> Array:
    """One random feasible pose per entry of `which`.

    Args:
        robot: The robot.
        tool: Load point and targets in the flange frame [m], shape (1 + t, 3).
        anchors: Floor points [m], F_b, shape (a, 3).
        which: Anchor of each pose, shape (p,).
        rng: Source of the draws.

    Returns:
        Joint values [m] or [rad], shape (p, n).

    Raises:
        InputError: An anchor is out of reach.
    """
    found = try_poses(robot, tool, anchors, which, rng)
    missing = np.flatnonzero(np.isnan(found[:, 0]))
    if not len(missing):
        return found
    at = anchors[which[missing[0]]].tolist()
    raise InputError(
        f"no feasible pose found for the anchor at {at} m",
        "give an anchor within reach of the arm, or the joint values of the poses",
        file="plan",
    )


def try_poses(
    robot: Robot,
    tool: Array,
    anchors: Array,
    which: Ints,
    rng: np.random.Generator,
    room: Room | None = None,
) -> Array:
    """As `draw_poses`, NaN for the poses that were not found; in a room only poses that fit it."""
    found = np.full((len(which), robot.n), np.nan)
    lower, upper = (robot.lower, robot.upper) if room is None else (room.lower, room.upper)
    for _ in range(200):
        open_poses = np.flatnonzero(np.isnan(found[:, 0]))
        if not len(open_poses):
            break
        pose = np.repeat(open_poses, 16)
        anchor = anchors[which[pose]]
        candidates = rounded(robot, _candidates(robot, lower, upper, anchor, rng))
        good = feasible(robot, candidates, tool, anchor)
        if room is not None:
            some = np.flatnonzero(good)
            good[some] = free(room, configure(robot, candidates[some]), tool, anchor[some])
        found[pose[good][::-1]] = candidates[good][::-1]
    return found


def _candidates(
    robot: Robot, lower: Array, upper: Array, anchor: Array, rng: np.random.Generator
) -> Array:
    full_turn = np.where(robot.prismatic, _FAR_M, np.pi)
    lower, upper = np.maximum(lower, -full_turn), np.minimum(upper, full_turn)
    lower = np.broadcast_to(lower, (len(anchor), robot.n)).copy()
    upper = np.broadcast_to(upper, (len(anchor), robot.n)).copy()
    if robot.joints[0].prismatic:
        lower[:, 0] = np.maximum(lower[:, 0], anchor[:, 1] - _RAIL_REACH_M)
        upper[:, 0] = np.minimum(upper[:, 0], anchor[:, 1] + _RAIL_REACH_M)
    return rng.uniform(lower, upper)


def feasible(robot: Robot, q: Array, tool: Array, anchor: Array) -> Bools:
    """Which poses are clear of the floor with a free chain of sensible length to their anchor.

    Args:
        robot: The robot.
        q: Joint values [m] or [rad], shape (m, n).
        tool: Load point and targets in the flange frame [m], shape (1 + t, 3).
        anchor: Floor point of each pose [m], shape (m, 3).
    """
    configuration = configure(robot, q)
    points = configuration.points(tool)
    lowest = np.minimum(points[..., 2].min(axis=1), configuration.origin[:, 2:, 2].min(axis=1))
    length = np.linalg.norm(anchor - points[:, 0], axis=1)
    return (
        (lowest > anchor[:, 2] + _CLEARANCE_M)
        & (length > _CHAIN_M[0])
        & (length < _CHAIN_M[1])
        & (_column_distance(robot, configuration, points[:, 0], anchor) > _COLUMN_M)
    )


def _column_distance(robot: Robot, at: Configuration, start: Array, end: Array) -> Array:
    """Horizontal distance of the chain from the axis of the first turning joint [m]."""
    first = int(np.argmin(robot.prismatic))
    column = at.origin[:, first, :2]
    a, b = start[:, :2] - column, end[:, :2] - column
    along = b - a
    share = np.clip(-np.sum(a * along, axis=1) / np.sum(along**2, axis=1).clip(1e-12), 0, 1)
    return np.linalg.norm(a + share[:, None] * along, axis=1)


def nearest_in_reach(load_point: Array, anchors: Array) -> Ints:
    """For each load point (p, 3) the nearest anchor that leaves room for a chain, shape (p,)."""
    length = np.linalg.norm(load_point[:, None] - anchors, axis=-1)
    return np.argmin(np.where(length < _CHAIN_M[0], np.inf, length), axis=1)
