"""Weight of an arm as usual, and the torques by which it acts on screws."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.machine.effects._anatomy import turning
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import link_moments, weighs


def carried_by(screws: Array, carrier: Ints, unit: Array) -> Array:
    """Torques about screws per mass and first moment of each link that they carry, (m, v, 4 n)."""
    m, n = unit.shape[:2]
    behind = np.arange(1, n + 1) >= carrier[:, None]
    both = screws @ unit.reshape(m, 4 * n, 6).swapaxes(1, 2)
    both *= np.repeat(behind, 4, axis=1)
    return np.asarray(both)


def usual(robot: Robot) -> tuple[Array, Array]:
    """Usual masses [kg] and first moments [kg m] of links, with wide uncertainties.

    If the robot file states them, the means are those. Otherwise an arm of six axes weighs some
    five times its payload, mostly in the first three links (KUKA KR 500 and ABB IRB 6640, by their
    data sheets), each centred between its axes. On the last one hangs a tool that nobody states,
    as heavy as half the payload or none.

    Returns:
        Mean and standard deviation, each of shape (n, 4).
    """
    turns = turning(robot)
    share = np.zeros(robot.n)
    share[np.array(turns) - 1] = _SHARE[: len(turns)]
    payload = robot.payload_kg or _PAYLOAD_KG
    mass = _ARM * payload * share
    ends = np.array([*(step[:3, 3] for step in robot.placement[1:]), robot.flange[:3, 3]])
    half = 0.5 * np.linalg.norm(ends, axis=1) + _WIDE_M
    mean = np.column_stack([mass, 0.5 * mass[:, None] * ends])
    std = np.column_stack([mass, *[mass * half] * 3])
    last = turns[-1] - 1
    std[last] = np.hypot(std[last], _TOOL * payload * np.array([1.0, *[_TOOL_M] * 3]))
    return link_moments(robot) if weighs(robot) else mean, np.maximum(std, LEAST)


LEAST = 1e-3
"""Least standard uncertainty of a mass [kg] or first moment [kg m]: none is exact, and none
vanishes."""
_ARM = 5.0
"""Mass of an arm over its rated payload [1]: an estimate for machining robots."""
_SHARE = np.array([0.3, 0.28, 0.3, 0.05, 0.04, 0.03, 0.01])
_PAYLOAD_KG = 200.0
"""Payload of a robot whose file states none [kg]: a medium one for machining robots."""
_TOOL, _TOOL_M = 0.5, 0.25
"""Mass of a tool over the rated payload [1], a robot being chosen for what it carries, and distance
of its centre from the flange [m]: where the payload may be (KUKA KR QUANTEC, by its data sheet)."""
_WIDE_M = 0.1
"""Standard deviation of the distance of a link's centre of mass from the line between its
axes [m]."""
