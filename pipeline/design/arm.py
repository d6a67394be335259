"""Bodies of an arm, approximate if its file has none, and the free space it always needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.design.room import Room, room_of
from pipeline.machine.cell import Tool
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.capsules import SHORT_M, Capsules
from pipeline.machine.surroundings import Surrounded, Surroundings

_THICK, _THIN = 0.10, 0.035
"""Radii of links at foot and wrist over the length of the arm [1]: estimates, similar to the rough
hulls that ship (KR 210: 0.33 and 0.12 m of 3.5 m)."""


def bodied(robot: Robot) -> Robot:
    """The robot with bodies: those of its file, or rough ones."""
    return robot if len(robot.capsules) else replace(robot, capsules=hulls(robot))


def arm_alone(robot: Robot, tool: Tool, stated: Surrounded) -> Room:
    """Free space that the arm needs regardless of the readings: itself, the chain, a stated floor.

    Args:
        robot: The robot.
        tool: The effector.
        stated: Cell and effector as the file describes them.
    """
    cell = stated.cell or Surroundings()
    stated = stated.model_copy(update={"cell": cell.model_copy(update={"tracker_m": None})})
    room = room_of(bodied(robot), tool.named, stated, 0.0)
    assert room is not None  # there is a cell
    return room


def hulls(robot: Robot) -> Capsules:
    """Rough bodies of a robot whose file has none: the links of its table.

    A capsule from each turning joint to the next, in the frame of the first, thinner towards the
    wrist.
    """
    here = configure(robot, np.clip(np.zeros(robot.n), robot.lower, robot.upper)[None])
    at = np.vstack([here.origin[0], here.flange_origin[0]])
    links = [k for k in range(robot.n) if not robot.prismatic[min(k + 1, robot.n - 1)]]
    size = [float(np.linalg.norm(at[k + 1] - at[k])) for k in links]
    arm, share = sum(size), np.linspace(_THICK, _THIN, len(links))
    rows = [
        (k + 1, here.axes[0, k].T @ (at[k + 1] - at[k]), radius * arm)
        for k, length, radius in zip(links, size, share, strict=True)
        if length > SHORT_M
    ]
    ends = np.array([[np.zeros(3), end] for _, end, _ in rows]).transpose(1, 0, 2)
    return Capsules(
        np.array([carrier for carrier, _, _ in rows], dtype=np.int64),
        ends,
        np.array([radius for _, _, radius in rows]),
        "made from the lengths of the links; no drawing was used",
    )
