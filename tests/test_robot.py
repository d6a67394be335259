"""Robots: tables to frames, by three ways that share nothing but the table."""

import tomllib
from importlib import resources

import numpy as np
import pinocchio as pin
import pytest

from pipeline.base.errors import InputError
from pipeline.machine import robot as robots
from pipeline.machine.robot import SHIPPED, configure, load
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.model import model

POINT = np.array([0.11, -0.07, 0.23])
RNG = np.random.default_rng(7)


def inside(robot, m, rng=RNG):
    """Joint values within limits, +-pi where there are none."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    return rng.uniform(lower, upper, (m, robot.n))


def product(rows, q):
    """The plain product of one transform per row, straight from the TOML of a modified table."""
    T = np.eye(4)
    for row, value in zip(rows, q, strict=True):
        alpha = np.deg2rad(row.get("alpha_deg", 0))
        theta = np.deg2rad(row.get("theta_deg", 0))
        x = row.get("a_m", 0.0) if "a_m" in row else row.get("d_m", 0.0)
        z = row.get("d_m", 0.0) if "a_m" in row else row.get("r_m", 0.0)
        if row["type"] == "prismatic":
            z = z + value
        else:
            theta = theta + value
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        T = T @ np.array(
            [
                [ct, -st, 0, x],
                [ca * st, ca * ct, -sa, -z * sa],
                [sa * st, sa * ct, ca, z * ca],
                [0, 0, 0, 1],
            ]
        )
    return T


@pytest.fixture(params=SHIPPED)
def robot(request):
    return load(request.param)


def test_flange_is_the_product_of_the_rows_and_what_pinocchio_says(robot):
    """Numpy product, batched frames and Pinocchio agree to 1e-12 m."""
    rows = tomllib.loads((resources.files(robots) / f"{robot.name}.toml").read_text())
    q = inside(robot, 50)
    batched = configure(robot, q).points(POINT[None])[:, 0]
    built = model(robot, {"tool": POINT})
    data = built.createData()

    for here, there in zip(q, batched, strict=True):
        pin.framesForwardKinematics(built, data, here)
        by_pin = data.oMf[built.getFrameId("tool")].translation
        by_hand = (product(rows["joint"], here) @ np.append(POINT, 1))[:3]
        assert np.abs(by_pin - by_hand).max() < 1e-12
        assert np.abs(there - by_hand).max() < 1e-12


def test_jacobians_are_finite_differences(robot):
    """velocity() is the derivative of the points by the joints."""
    q = inside(robot, 20)
    J = velocity(configure(robot, q).twists, configure(robot, q).points(POINT[None]))[:, 0]
    h = 1e-6

    for k in range(robot.n):
        ahead, behind = q.copy(), q.copy()
        ahead[:, k] += h
        behind[:, k] -= h
        moved = configure(robot, ahead).points(POINT[None]) - configure(robot, behind).points(
            POINT[None]
        )
        assert np.abs(moved[:, 0] / (2 * h) - J[:, k]).max() < 1e-8


def test_torque_is_the_work_of_the_force(robot):
    """J' f by screws is J' f by Pinocchio's Jacobian."""
    q, force = inside(robot, 20), RNG.normal(size=(20, 3))
    here = configure(robot, q)
    ours = torque(here.twists, here.points(POINT[None])[:, 0], force)
    built = model(robot, {"tool": POINT})
    data = built.createData()

    for i in range(20):
        J = pin.computeFrameJacobian(
            built, data, q[i], built.getFrameId("tool"), pin.LOCAL_WORLD_ALIGNED
        )
        assert np.abs(J[:3].T @ force[i] - ours[i]).max() < 1e-12


def test_the_letters_of_khalil_and_craig_name_the_same_arm():
    """A Khalil table with d renamed a and r renamed d is a Craig table."""
    khalil = (resources.files(robots) / "kr500_rail.toml").read_text()
    craig = (
        khalil.replace('"khalil"', '"craig"').replace("\nd_m", "\na_m").replace("\nr_m", "\nd_m")
    )
    q = inside(load("kr500_rail"), 5)

    a, b = (configure(parse(text, "x.toml"), q).flange_origin for text in (khalil, craig))

    assert np.abs(a - b).max() == 0.0


def test_a_standard_table_is_read_by_its_own_rule():
    """A distal table of two turning joints: Rz Tz Tx Rx, joint by joint."""
    text = """
format = 1
name = "two"
description = "two joints"
convention = "standard"
source = "test"
[[joint]]
name = "a1"
type = "revolute"
alpha_deg = 90
a_m = 0.3
d_m = 0.5
[[joint]]
name = "a2"
type = "revolute"
a_m = 0.7
"""
    q = np.array([[0.4, -1.1]])
    one, two = q[0]
    reach = 0.3 + 0.7 * np.cos(two)
    expected = [np.cos(one) * reach, np.sin(one) * reach, 0.5 + 0.7 * np.sin(two)]

    assert np.abs(configure(parse(text, "two.toml"), q).flange_origin[0] - expected).max() < 1e-15


def test_the_real_kr500_is_the_published_arm():
    """kr500_rail_kuka reaches where KUKA's dimensions 500, 1045, 1300, 55, 1525, 290 say.

    At A1 = 0, A2 = -90, A3 = 90 the arm is upright with the forearm level.
    """
    robot = load("kr500_rail_kuka")
    axes = np.deg2rad([0, 0, -90, 90, 0, 0, 0])
    q = robot.controller_matrix @ axes + robot.controller_offset

    flange = configure(robot, q[None]).flange_origin[0]

    assert np.linalg.norm(flange[:2]) == pytest.approx(0.5 + 1.525 + 0.290, abs=1e-12)
    assert flange[2] == pytest.approx(1.045 + 1.3 - 0.055, abs=1e-12)


def test_a_robot_that_does_not_ship_is_refused_by_name():
    """The sentence names the robots that ship."""
    with pytest.raises(InputError, match="kr500_rail_kuka"):
        load("kr600")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("lower_deg = -120.0", "lower_m = -1.0"), "theta6"),
        (("d_m = 1.3", "a_m = 1.3"), "khalil"),
        (('name = "theta3"', 'name = "theta2"'), "not unique"),
        (("lower_m = 0.0", "lower_m = 20.0"), "not below"),
        (('convention = "khalil"', 'convention = "denavit"'), "convention"),
        (("d_m = 1.3", "d_m = 1e160"), r"d_m: 1e\+160 should be less than"),
        (("d_m = 1.3", "d_m = nan"), "d_m: nan should be"),
        (("lower_deg = -120.0", "lower_deg = -inf"), "lower_deg: -inf should be"),
    ],
)
def test_a_wrong_robot_file_is_refused_with_the_place(change, says):
    """Each mistake is named."""
    text = (resources.files(robots) / "kr500_rail.toml").read_text().replace(*change)
    with pytest.raises(InputError, match=says):
        parse(text, "mine.toml")
