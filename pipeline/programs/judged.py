"""A path that is held against a tolerance, in a form that `pipeline compensate` reads, too."""

from __future__ import annotations

import numpy as np

from pipeline.library import holds
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path
from pipeline.programs import cartesian, joint_path
from pipeline.programs.aim import Setting, aim


def read(name: str, data: bytes, model: IdentifiedModel) -> Path:
    """A path with forces as `pipeline compensate` reads it; poses are those of the load point.

    Args:
        name: Name of the file.
        data: Its content.
        model: Whose robot and load point.

    Raises:
        InputError: A row or column is not as it should be, or the robot cannot reach a pose.
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
