"""The deflection at the test pose, as a vector and along the force."""

import numpy as np
import pytest

from pipeline.answer.conformity import pose_entry
from pipeline.answer.sentences import _directed
from pipeline.machine.robot import load
from pipeline.prediction.tolerance import JudgedTolerance, TipDeflection
from pipeline.reduction.pose_of_interest import PoseOfInterest


def test_it_is_in_the_base_frame_and_along_the_force():
    """3, 4 and 12 mm under a force along y and z: by hand, (4 * 3 + 12 * 4) / 5 = 12 mm."""
    robot = load("kr500_rail")
    moved = np.array([[3e-3, 4e-3, 12e-3]])
    at = TipDeflection(moved, np.array([13e-3]), np.array([1e-4]))
    where = PoseOfInterest(np.zeros(robot.n), np.array([0.0, 300.0, 400.0]), stated=True)
    pose = pose_entry(robot, where, JudgedTolerance(at, None))

    assert pose.vector_mm == pytest.approx((3, 4, 12))
    assert pose.along_force_mm == pytest.approx(12)
    assert _directed(pose) == " It is (3.00, 4.00, 12.0) mm in F_b, 12.00 mm along the force."
    assert _directed(pose.model_copy(update={"vector_mm": None})) == ""
