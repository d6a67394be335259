"""A force that turns with the tool."""

import numpy as np
import pytest

from pipeline.machine.robot import configure, load
from pipeline.programs.joint_path import in_base


def test_a_force_along_the_tool_points_along_its_axis_in_the_base():
    """Along x, y and z of a tool that is turned by 90 deg about z: y, -x and z of the flange."""
    robot = load("kr500_rail")
    q = np.array([[2.0, *np.deg2rad([-10.0, 35.0, 39.0, 81.0, 22.0, -10.0])]])
    x, y, z = configure(robot, q).flange_axes[0].T
    tool = np.eye(4)
    tool[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]

    for force, along in zip(np.eye(3), (y, -x, z), strict=True):
        assert in_base(robot, q, tool, 10 * force[None])[0] == pytest.approx(10 * along)
