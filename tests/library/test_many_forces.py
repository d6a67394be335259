"""Forces at many poses, each of which the robot holds."""

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.library.joints import loaded
from pipeline.machine.robot import load
from pipeline.machine.robot.rating import ABSURD, weight_n


def test_each_force_counts_by_itself_and_with_all_its_parts():
    """A hundred poses with half of what is refused pass; one force with three such parts fails."""
    robot = load("kr500_rail")
    q = [8.5, *np.deg2rad([-10.0, 35.0, 39.0, 81.0, 22.0, -10.0])]
    half = ABSURD * weight_n(robot) / 2

    rows, forces = loaded(robot, q, np.tile([0.0, 0.0, -half], (100, 1)))
    assert (rows.shape, forces.shape) == ((100, 7), (100, 3))
    with pytest.raises(InputError, match="forces are in N"):
        loaded(robot, q, [1.5 * half] * 3)
