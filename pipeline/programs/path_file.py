"""Path that is compared with a tolerance, in a format that `pipeline compensate` also reads."""

from __future__ import annotations

import numpy as np

from pipeline.library import holds
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path
from pipeline.programs import cartesian, joint_path
from pipeline.programs.aim import Setting, aim


def read(name: str, data: bytes, model: IdentifiedModel) -> Path:
    """Read a path with forces as `pipeline compensate` does; poses are those of the load point.

    Args:
        name: Name of the file.
        data: Content of the file.
        model: Model with the robot and its load point.

    Raises:
        InputError: A row or column is invalid, or the robot cannot reach a pose or hold its force.
    """
    letters, point = cartesian.form(name, data), model.tool.load_point
    if letters is None:
        path = joint_path.read(name, data, model.robot)
    else:
        poses = cartesian.read(name, data, model.robot, letters)
        tool = np.eye(4)
        tool[:3, 3] = point
        aimed = aim(model, poses.notation, poses.targets, Setting({"": tool}, {"": np.eye(4)}))
        lines = tuple(target.line for target in poses.targets)
        path = Path(poses.pose, aimed.q, poses.force, file=name, line=lines)
    holds.refuse_unheld(model.robot, path.q, path.force, point, name, path.line)
    return path
