"""Read absolute positions with the joint values at which they were measured."""

from __future__ import annotations

import numpy as np

from pipeline.machine.robot import Robot
from pipeline.readers._log_form import opened
from pipeline.readers._log_table import Log, Quantity, known_columns, suffixed, typed
from pipeline.readers.export_settings import OWN_LOG, LogForm
from pipeline.readers.logs import ANGLE, LENGTH, controller_axes, own_joints

AXES, TURNS = ("x", "y", "z"), ("rx", "ry", "rz")

TARGET = "T"
"""Target name used if a table names none."""

TEMPERATURE = {"c": 1.0}
"""Units of temperature [degC]."""


def positions(name: str, data: bytes, robot: Robot, said: LogForm = OWN_LOG) -> Log:
    """Read a table of positions: joint values, x, y, z and, for 6D targets, rx, ry, rz.

    Args:
        name: Name of the file.
        data: Its content.
        robot: The robot whose joints they are.
        said: [positions] of campaign.toml.

    Returns:
        Numbers by joint [m] or [rad], x, y, z [m]; if present rx, ry, rz [rad], pose and
        temperature [degC]; words series, target and payload, empty if there is no such column.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    places = [Quantity(axis, LENGTH) for axis in AXES]
    turns = [Quantity(turn, ANGLE, needed=False) for turn in TURNS]
    others = [*turns, Quantity("pose", {}, needed=False),
              Quantity("temperature", TEMPERATURE, needed=False),
              *(Quantity(word, {}, "name", needed=False) for word in _WORDS)]  # fmt: skip
    return with_joints(name, data, robot, said, [*places, *others])


_WORDS = ("series", "target", "payload")


def with_joints(name: str, data: bytes, robot: Robot, said: LogForm, others: list[Quantity]) -> Log:
    """Read joint values, under the robot's or its controller's names, and further columns.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    own, axes = own_joints(robot), controller_axes(robot)
    file = opened(name, data, said, "positions", own[0].stem)
    there = [[q for q in kind if suffixed(file.titles, q)] for kind in (own, axes)]
    from_controller = bool(axes) and len(there[1]) > len(there[0])
    known_columns(said, "positions", [*own, *axes, *others])
    log = typed(file, [*(axes if from_controller else own), *others], said, "positions")
    if not from_controller:
        return log
    values = np.column_stack([log.number[axis.stem] for axis in axes])
    q = values @ robot.controller_matrix.T + robot.controller_offset
    number = log.number | {j.name: q[:, k] for k, j in enumerate(robot.joints)}
    return Log(log.file, number, log.word, log.line, log.rejected)
