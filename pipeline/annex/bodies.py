"""Bodies of a cell as capsules in F_b: base, arm, tool and reflectors at each pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.machine.cell import Tool
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.capsules import SHORT_M, Capsules

_BASE, _CARRIAGE, _ARM, _TOOL = "base", "carriage", "arm", "tool"
TRACKER, REFLECTOR = "tracker", "reflector"

_THICK = 0.04
"""Assumed radius of a link without a known shape, as a fraction of the length of the arm [1]."""


@dataclass(frozen=True, eq=False)
class Bodies(Locked):
    """Capsules of one kind, c of them at m poses.

    Attributes:
        part: `_BASE`, `_CARRIAGE`, `_ARM`, `_TOOL`, `TRACKER` or `REFLECTOR`.
        names: Name of each capsule, shape (c,).
        ends: Both end points in F_b [m], shape (m, c, 2, 3); identical for a point.
        radius: Radius of each capsule [m], shape (c,).
    """

    part: str
    names: Strings
    ends: Array
    radius: Array


def links(robot: Robot, here: Configuration) -> tuple[Bodies, Bodies, Bodies]:
    """Base, carriage and arm of a robot; straight lines between joints if it has no capsules."""
    known = robot.capsules
    if not len(known):
        return _straight(robot, here)
    ends = here.placed(known).transpose(3, 2, 0, 1)
    slides = np.concatenate([[False], robot.prismatic])[known.carrier]
    still = known.carrier == 0
    base, carriage, arm = (
        Bodies(part, _called(robot, known, which), ends[:, which], known.radius[which])
        for part, which in ((_BASE, still), (_CARRIAGE, slides), (_ARM, ~still & ~slides))
    )
    return base, carriage, arm


def _called(robot: Robot, known: Capsules, which: Bools) -> Strings:
    names = np.array(["base", *(joint.name for joint in robot.joints)], dtype=object)
    return np.asarray(names[known.carrier[which]], dtype=object)


def _straight(robot: Robot, here: Configuration) -> tuple[Bodies, Bodies, Bodies]:
    """Straight lines between origins of successive joint frames, the first one from F_b."""
    origin = np.concatenate([here.origin, here.flange_origin[:, None]], axis=1)
    first = np.zeros_like(origin[:, :1])
    if robot.joints[0].prismatic:  # the carriage moves along its rail; no link joins it to F_b
        first = origin[:, :1]
    lines = np.stack([np.concatenate([first, origin[:, :-1]], axis=1), origin], axis=2)
    length = np.linalg.norm(lines[:, :, 1] - lines[:, :, 0], axis=-1).max(axis=0)
    there = length > SHORT_M
    names = np.array([*(joint.name for joint in robot.joints), "flange"], dtype=object)
    thick = np.full(int(there.sum()), _THICK * length.sum())
    arm = Bodies(_ARM, names[there], lines[:, there], thick)
    return _bed(robot, here, thick[:1]), _none(_CARRIAGE, len(here.q)), arm


def _none(part: str, m: int) -> Bodies:
    return Bodies(part, np.zeros(0, object), np.zeros((m, 0, 2, 3)), np.zeros(0))


def _bed(robot: Robot, here: Configuration, thick: Array) -> Bodies:
    """The rail over the joint's range, or over the poses where a limit is infinite; else empty."""
    if not robot.joints[0].prismatic:
        return _none(_BASE, len(here.q))
    q, along = here.q[:, 0], here.axes[0, 0, :, 2]
    low, high = (
        end if np.isfinite(end) else seen
        for end, seen in ((robot.lower[0], q.min()), (robot.upper[0], q.max()))
    )
    zero = here.origin[0, 0] - q[0] * along
    ends = np.stack([zero + low * along, zero + high * along])
    return Bodies(_BASE, np.array(["base"], object), np.tile(ends, (len(q), 1, 1, 1)), thick)


def effector(here: Configuration, tool: Tool, thick: float) -> Bodies:
    """Lines from the flange to the load point and each target."""
    named = {name: at for name, at in tool.named.items() if np.isfinite(at).all()}
    ends = here.points(np.array(list(named.values())))
    start = np.broadcast_to(here.flange_origin[:, None], ends.shape)
    both = np.stack([start, ends], axis=2)
    return Bodies(_TOOL, np.array(list(named), dtype=object), both, np.full(len(named), thick))


def points(part: str, named: dict[str, Array]) -> Bodies:
    """Points that are fixed in F_b, such as tracker and reflectors."""
    at = np.array(list(named.values()), dtype=float).reshape(1, -1, 1, 3)
    both = np.repeat(at, 2, axis=2)
    return Bodies(part, np.array(list(named), dtype=object), both, np.zeros(len(named)))


def arm_joints(robot: Robot, q: Array) -> tuple[int, int] | None:
    """Indices of the first two neighbouring revolute joints whose axes are parallel."""
    axes = configure(robot, q[None]).axes[0, :, :, 2]
    for j in range(robot.n - 1):
        turning = not (robot.joints[j].prismatic or robot.joints[j + 1].prismatic)
        if turning and np.linalg.norm(np.cross(axes[j], axes[j + 1])) < 1e-6:
            return j, j + 1
    return None
