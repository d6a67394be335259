"""Joints with a compliance for each sign of the torque: where their parameters stand."""

import numpy as np
import pytest

from pipeline.machine import sides
from pipeline.machine.cell import Cell, Tool, baseline, load
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load as robot_of
from pipeline.machine.robot.configuration import torque

ROBOT = robot_of("kr500_rail")
EVERY = {f"{one.label} {one.form}".strip(): one for one in catalogue(ROBOT)}
TWO, FIVE = EVERY["joint_asymmetry:3 pull"], EVERY["joint_asymmetry:6 pull"]
TILT, PLAY = EVERY["joint_tilt:4"], EVERY["joint_lost_motion:2 wide"]
Q = np.array([[3.0, 0.2, -1.1, 1.4, 0.6, -0.7, 0.3], [6.0, -0.8, -0.7, 1.1, -1.2, 0.9, 2.1]])
FORCE = np.array([[300.0, 0.0, -400.0], [-300.0, -1200.0, 500.0]])
TOOL = Tool(np.array([0.1, 0.05, 0.4]), np.array(["P1"], object), np.array([[0.2, 0.0, 0.1]]))


def test_columns_of_two_sided_joints_follow_those_of_the_springs():
    """By the index of the joint; others have none, however many parameters they have."""
    assert sides.columns(7, (TWO, FIVE)) == {2: 7, 5: 8}
    assert sides.columns(7, (TILT, FIVE, PLAY, TWO)) == {5: 9, 2: 11}
    assert sides.columns(7, (TILT, PLAY)) == {}


def test_the_side_of_a_joint_is_the_sign_of_its_torque():
    """Of the pull at each pose, by the index of the joint."""
    cell = Cell(ROBOT, TOOL, (*baseline(ROBOT), TILT, TWO, FIVE))
    x = np.zeros(len(cell.parameters))
    at = load(cell, Pulls.at(Q, FORCE), x)
    tau = torque(at.configuration.twists, at.load_point, at.force)
    found = sides.along(cell, x, Q, FORCE)
    assert sorted(found) == [2, 5]
    for joint, side in found.items():
        assert side.tolist() == np.sign(tau[:, joint]).tolist()
    for k in (0, 1):
        one = sides.at_pose(cell, x, Q[k], FORCE[k])
        assert one == {joint: float(side[k]) for joint, side in found.items()}
    assert {tuple(side) for side in found.values()} - {(1.0, 1.0), (-1.0, -1.0)}
    assert sides.along(Cell(ROBOT, TOOL, baseline(ROBOT)), np.zeros(7), Q, FORCE) == {}


@pytest.mark.parametrize("lost", [[], [1], [0, 2]])
def test_both_sides_are_linear_combinations(lost):
    """T x and T V T'; what rests on an unknown one is unknown."""
    rng = np.random.default_rng(3)
    A, x, T = (
        rng.normal(size=(3, 3)),
        rng.normal(size=3),
        np.array([[1.0, 0, 1], [1, 0, -1], [0, 2, 0]]),
    )
    V = A @ A.T
    expected = T @ V @ T.T
    for k in lost:
        V[k, k] = np.inf
    value, cov = sides.taken(x, V, T)
    np.testing.assert_allclose(value, [x[0] + x[2], x[0] - x[2], 2 * x[1]])
    gone = [row for row in range(3) if any(T[row, k] for k in lost)]
    for i in range(3):
        assert np.isinf(cov[i, i]) == (i in gone)
        for j in range(3):
            if i not in gone and j not in gone:
                assert cov[i, j] == pytest.approx(expected[i, j])
