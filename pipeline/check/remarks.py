"""What somebody has to say of rows of a log."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.machine.robot import Robot
from pipeline.readers._log_form import opened
from pipeline.readers._log_table import typed
from pipeline.readers.export_settings import LogForm
from pipeline.readers.logs import POSE, REMARK, REPEAT, has_joints, has_load


def remarks(name: str, data: bytes, said: LogForm, robot: Robot | None = None) -> list[str]:
    """What the column `remark` of a log says, each with its line, pose and pull.

    Args:
        name: Name of the file.
        data: Its content.
        said: [scale] or [joints] of campaign.toml.
        robot: Whose joint log it is; None for a log of loads.

    Raises:
        InputError: The file cannot be read.
    """
    holds = has_load if robot is None else partial(has_joints, robot)
    section = "scale" if robot is None else "joints"
    file = opened(name, data, said, section, POSE.stem, holds)
    pose, repeat = replace(POSE, filled=False), replace(REPEAT, needed=False)
    log = typed(file, [pose, repeat, REMARK], said, section)
    out = []
    for k in np.flatnonzero(log.word.get("remark", np.array([])) != ""):
        where = [f"{what} {log.number[what][k]:.0f}" for what in ("pose", "repeat")
                 if what in log.number and np.isfinite(log.number[what][k])]  # fmt: skip
        said_of = f", {' '.join(where)}" if where else ""
        out.append(f"{name}, line {log.line[k]}{said_of}: {log.word['remark'][k]}")
    return out
