"""Can a plan be driven? The arm from pose to pose, checked against itself and the floor.

Between poses the chain is slack and nothing is read: beams and chain are asked at the poses only.
Joints move together in a straight line, as joint motions of controllers do.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.design.arm import arm_alone
from pipeline.design.problem import Problem
from pipeline.machine.gaps import gaps
from pipeline.machine.robot import Robot, configure
from pipeline.machine.room import Room

_STEP_RAD, _STEP_M = np.deg2rad(0.5), 0.01
"""Steps in which a motion is looked at: half a degree moves a point at 3 m by 26 mm, and rough
hulls are good to 50."""


@dataclass(frozen=True, eq=False)
class Leg(Locked):
    """The way to a pose from the one before it.

    Attributes:
        pose: Number of the pose it leads to, from 1.
        via: Joint values [m] or [rad] of points on the way, shape (k, n).
        blocked: What is not kept on the way, in words; None where all is.
    """

    pose: int
    via: Array
    blocked: str | None = None

    @property
    def sentence(self) -> str:
        """Why the way cannot be driven."""
        return (
            f"from pose {self.pose - 1} to pose {self.pose} the arm does not keep "
            f"{self.blocked}, neither straight nor by way of the middle of its joints"
        )


def legs(problem: Problem, q: Array) -> list[Leg]:
    """The ways between poses in their order, straight where that is free.

    Args:
        problem: Robot, cell and effector.
        q: Joint values of the poses [m] or [rad], shape (m, n).
    """
    room = arm_alone(problem.robot, problem.tool, problem.spec)
    return [_leg(problem, room, k, q[k - 1], q[k]) for k in range(1, len(q))]


def standing(problem: Problem, q: Array) -> list[str]:
    """What poses themselves do not keep of arm and floor, in sentences.

    Args:
        problem: Robot, cell and effector.
        q: Joint values [m] or [rad], shape (m, n).
    """
    room = arm_alone(problem.robot, problem.tool, problem.spec)
    found = ((k, _broken(problem, room, one[None])) for k, one in enumerate(q, 1))
    return [f"pose {k} does not keep {rule}" for k, rule in found if rule is not None]


def _leg(problem: Problem, room: Room, k: int, start: Array, end: Array) -> Leg:
    straight = _broken(problem, room, between(problem.robot, start, end))
    none = np.zeros((0, len(start)))
    if straight is None:
        return Leg(k + 1, none)
    middle = (problem.lower + problem.upper) / 2
    turning = np.flatnonzero(~problem.robot.prismatic)
    held = np.arange(len(middle)) <= turning[0]  # rail and first axis turn with the arm folded
    via = np.stack([np.where(held, start, middle), np.where(held, end, middle)])
    points = [start, *via, end]
    ways = [between(problem.robot, a, b) for a, b in pairwise(points)]
    if _broken(problem, room, np.concatenate(ways)) is None:
        return Leg(k + 1, via)
    return Leg(k + 1, none, straight)


def between(robot: Robot, start: Array, end: Array) -> Array:
    """Joint values on the straight way between two poses, both ends included, shape (s, n)."""
    step = np.where(robot.prismatic, _STEP_M, _STEP_RAD)
    count = int(np.ceil(np.max(np.abs(end - start) / step, initial=1.0)))
    return np.asarray(start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start))


def _broken(problem: Problem, room: Room, q: Array) -> str | None:
    """The first rule that some of these joint values (m, n) do not keep; None where all do."""
    at = configure(problem.robot, q)
    points = at.points(np.vstack([problem.tool.load_point[None], problem.tool.points]))
    places = np.moveaxis(points, 0, -1)
    for rule in room.rules:
        found = gaps(room.only(rule), at, places, places[0], 0.0)
        if any(len(one.pose) for one in found):
            return rule
    return None
