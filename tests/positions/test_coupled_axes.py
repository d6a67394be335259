"""Positions with the values of a controller whose axes are coupled."""

import numpy as np
import pytest

from pipeline.machine.robot import load
from pipeline.positions.positioned import positions


def test_the_third_axis_of_a_fanuc_turns_with_the_second():
    """Axes in degrees: q = M a + offset; there J3 counts from the horizontal, q3 = -J2 - J3."""
    robot = load("fanuc_r2000ic")
    axes = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    head = ",".join([*(f"{one}_deg" for one in robot.controller), "x_m,y_m,z_m"])
    data = f"{head}\n{','.join(map(str, axes))},1,2,3\n".encode()
    log = positions("at.csv", data, robot)
    found = [float(log.number[joint.name][0]) for joint in robot.joints]

    turned = np.deg2rad([10.0, 20.0, -50.0, -40.0, -50.0, -60.0])
    assert found == pytest.approx(turned + robot.controller_offset)
