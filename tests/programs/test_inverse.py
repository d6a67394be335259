"""Joint values for poses of the flange: of all robots that ship, where nothing helps.

Truth is Pinocchio's forward kinematics.
"""

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model as pin_model
from pipeline.machine.robot import SHIPPED, axes, load
from pipeline.programs.inverse import FixedSlidingArm


def pose(robot, q):
    """The flange in F_b, from Pinocchio, shape (4, 4)."""
    model = pin_model(robot, {"x": np.zeros(3)})
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("x")].homogeneous


def somewhere(robot, rng):
    """Joint values half a radian within all limits."""
    low, high = np.maximum(robot.lower, -2.5), np.minimum(robot.upper, 2.5)
    return rng.uniform(low + 0.5, high - 0.5)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", SHIPPED)
def test_a_pose_is_reached_from_a_place_near_it(name):
    """Joint values a tenth of a radian off come back; the carriage stays where it is."""
    robot, rng = load(name), np.random.default_rng(3)
    arm = FixedSlidingArm(robot, axes.of(robot))
    for _ in range(10):
        q = somewhere(robot, rng)
        near = q + np.where(robot.prismatic, 0.0, rng.normal(0, 0.05, robot.n))
        found = arm.reach(pose(robot, q), near, True)

        assert found.why_not is None
        assert pose(robot, found.q) == pytest.approx(pose(robot, q), abs=1e-6)
        assert found.q[robot.prismatic] == pytest.approx(q[robot.prismatic], abs=0)
        assert (np.abs(found.q - near) < 0.5).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name",
    ["kr500_rail", "kr500_rail_kuka", "fanuc_r2000ic", "kr210_l150", "kr210_r2700_2", "irb6640"],
)
def test_signs_of_the_axes_settle_the_configuration(name):
    """Without a start, the quarter turn of each axis leaves the pose that was taught.

    At these poses: an elbow or wrist near its middle can have both its ways in the same quarters.
    """
    robot, rng = load(name), np.random.default_rng(5)
    of = axes.of(robot)
    arm = FixedSlidingArm(robot, of)
    for _ in range(5):
        q = somewhere(robot, rng)
        taught = of.values(q[None])[0][~of.slides]
        quarter = np.floor(taught / (np.pi / 2)) * np.pi / 2
        ranges = [(low, low + np.pi / 2) for low in quarter.tolist()]
        start = np.where(robot.prismatic, q, np.clip(0.0, robot.lower, robot.upper))
        found = arm.reach(pose(robot, q), start, False, ranges)

        assert found.why_not is None
        assert found.q == pytest.approx(q, abs=1e-5)


def test_several_configurations_are_not_chosen_from():
    """With nothing before it and nothing said, a pose of a six-axis arm is ambiguous."""
    robot = load("ur10e")
    q = np.array([0.3, -1.2, 1.4, -1.8, -1.5, 0.2])
    found = FixedSlidingArm(robot, axes.of(robot)).reach(pose(robot, q), np.zeros(6), False)

    assert "arm configurations reach it" in found.why_not[0]


def test_what_cannot_be_reached_is_said_with_its_distance():
    """Beyond the arm's reach it says how far; where a limit is in the way, of which joint."""
    robot = load("kr210_r2700_2")
    arm = FixedSlidingArm(robot, axes.of(robot))
    q = np.deg2rad([0, -60, 40, 0, 20, 0])
    far = pose(robot, q)
    far[0, 3] += 5.0
    beyond = np.deg2rad([0, -60, 40, 0, 20, 0.0]) + np.array([np.pi - 0.1, 0, 0, 0, 0, 0])
    behind = arm.reach(pose(robot, beyond), q, True)
    low = np.deg2rad([0, 10, 40, 20, 60, 10.0])  # axis 2 turns no further than -5 deg

    assert "mm and" in arm.reach(far, q, True).why_not[0]
    assert behind.why_not is None
    assert "beyond its limit" in arm.reach(pose(robot, low), q, True).why_not[0]


def test_a_start_that_is_half_a_turn_away_is_no_solution():
    """The wrist exactly upside down: it turns, by its own last axis."""
    robot = load("kr210_r2700_2")
    q = np.deg2rad([0, -60, 40, 10, 30, 0.0])
    half = q + np.array([0, 0, 0, 0, 0, np.pi])
    found = FixedSlidingArm(robot, axes.of(robot)).reach(pose(robot, half), q, True)

    assert found.why_not is None
    assert pose(robot, found.q) == pytest.approx(pose(robot, half), abs=1e-6)
