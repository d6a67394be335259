"""Joints beyond the limits of the robot file: a little, or impossible."""

import numpy as np
import pytest

from pipeline.machine.robot import load
from pipeline.reduction.limits import _beyond, doubt

ROBOT = load("kr500_rail")
MIDDLE = (ROBOT.lower + ROBOT.upper) / 2


def at(joint, value):
    """Joints beyond a limit in one pose, all others in the middle of their range."""
    q = MIDDLE.copy()
    q[joint] = value
    return _beyond(ROBOT, "joints.csv", np.array([7]), np.array([12]), q[None])


@pytest.mark.parametrize(("degrees", "out"), [(0.5, False), (0.99, False), (1.01, True)])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_turning_joint_may_be_a_degree_beyond(degrees, out, side):
    """A controller stops it at its own limit; robot files round theirs."""
    end = ROBOT.lower[2] if side < 0 else ROBOT.upper[2]
    (one,) = at(2, end + side * np.deg2rad(degrees))

    assert np.rad2deg(one.over) == pytest.approx(degrees)
    assert one.out is out


@pytest.mark.parametrize(("metres", "out"), [(0.01, False), (0.02, True)])
def test_the_carriage_may_be_as_far_as_a_degree_moves_a_point_at_a_metre(metres, out):
    """17.5 mm; the message has metres, and degrees for a turning joint."""
    (one,) = at(0, ROBOT.upper[0] + metres)

    assert one.out is out
    assert f"{metres:.3f} m outside its limits" in one.said


def test_within_its_limits_no_joint_is_beyond():
    """Also exactly at a limit."""
    assert not at(2, ROBOT.upper[2])
    assert doubt([]) is None


def test_the_first_line_of_the_log_is_doubted():
    """File and line of it, whatever comes later."""
    late, first = (at(2, ROBOT.upper[2] + 1.0)[0] for _ in range(2))
    problem = doubt([late, first.__class__(3, first.joint, first.value, first.file, 4)])

    assert (problem.file, problem.line) == ("joints.csv", 4)
    assert problem.thing.startswith("pose 3: joint")
