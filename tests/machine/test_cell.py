"""The forward model against simple, slow computations of the same physics."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.base.arrays import compared
from pipeline.machine.cell import Tool, jacobian, paper_cell, predict, sensitivity
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

TARGETS = {"P1": [0.20, 0.05, 0.12], "P2": [-0.12, 0.19, 0.10], "P3": [-0.10, -0.18, 0.22]}


def pulls(robot, m, seed=11, size=3000.0):
    rng = np.random.default_rng(seed)
    force = rng.normal(size=(m, 3))
    force *= size / np.linalg.norm(force, axis=1, keepdims=True)
    none = np.zeros(m)
    q = rng.uniform(robot.lower, robot.upper, (m, robot.n))
    return Pulls(np.arange(m), np.ones(m, int), q, force, none, none, none, none)


def cell(load_point=(0.15, 0.0, 0.25), robot="kr500_rail"):
    tool = Tool(
        np.array(load_point), np.array(list(TARGETS), object), np.array(list(TARGETS.values()))
    )
    return paper_cell(load(robot), tool)


def test_displacement_is_eq_5_by_pinocchio_pose_by_pose():
    """J_m K^-1 J_l' f with Pinocchio's Jacobians and the stiffnesses of Table III."""
    here = cell()
    k = np.array([8e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
    asked = pulls(here.robot, 10)
    ours = predict(here, asked, 1 / k).displacement
    built = model(here.robot, {"load": here.tool.load_point, **TARGETS})
    data = built.createData()

    def J(q, frame):
        return pin.computeFrameJacobian(
            built, data, q, built.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED
        )[:3]

    for i in range(10):
        q, f = asked.q[i], asked.force[i]
        for t, name in enumerate(TARGETS):
            expected = J(q, name) @ np.diag(1 / k) @ J(q, "load").T @ f
            assert np.abs(ours[i, t] - expected).max() < 1e-14


def test_B_is_the_derivative_of_the_displacements():
    """Central differences of predict by each compliance."""
    here = cell()
    asked, x = pulls(here.robot, 4), here.robot.nominal_compliance
    B = jacobian(here, asked, x)

    for k in range(7):
        h = np.zeros(7)
        h[k] = 0.1 * x[k]
        moved = predict(here, asked, x + h).displacement - predict(here, asked, x - h).displacement
        assert np.abs(moved / (0.2 * x[k]) - B[..., k]).max() < 1e-9 * np.abs(B[..., k]).max()


def test_the_column_of_a_drift_is_the_time_between_its_readings():
    """Read as differences of positions ten metres away: rounding stays a millionth of a percent.

    A direction of 1e-9 counts as one of its own, and other processors round otherwise.
    """
    here = cell()
    between = np.linspace(20.0, 200.0, 10)
    asked = replace(pulls(here.robot, 10), time_zero=np.zeros(10), time=between)
    drift = next(e for e in catalogue(here.robot) if e.name == "tracker_drift")

    B = sensitivity(here, asked, here.robot.nominal_compliance, [drift])

    expected = np.broadcast_to(between[:, None, None, None] * np.eye(3), B.shape)
    assert np.linalg.norm(B - expected) < 2e-8 * np.linalg.norm(expected)


def test_what_only_rounding_tells_apart_keeps_its_order():
    values = np.array([1e-7, 3.0, 3.0 + 4e-16, np.inf, 3.0 - 4e-16, -2e300, 0.0])
    order = np.argsort(-compared(values), kind="stable")
    assert order.tolist() == [3, 1, 2, 4, 0, 6, 5]
    assert compared(1e-320) == 1e-320
    assert np.isnan(compared(np.nan))


def test_a_pull_through_the_axis_of_joint_7_does_not_turn_it():
    """The column of joint 7 is zero, and no other."""
    here = cell(load_point=(0.0, 0.0, 0.25))
    B = jacobian(here, pulls(here.robot, 30), here.robot.nominal_compliance)
    size = np.abs(B).max(axis=(0, 1, 2))

    assert size[6] < 1e-12 * size[5]
    assert (size[:6] > 1e-3 * size[5] * here.robot.nominal_compliance[5]).all()


def test_the_deflected_robot_is_in_equilibrium():
    """Potential energy of springs and load is stationary at the deflected joints (Pinocchio)."""
    here = replace(cell(), equilibrium="deformed")
    x = here.robot.nominal_compliance
    asked = pulls(here.robot, 5)
    answer = predict(here, asked, x)
    built = model(here.robot, {"load": here.tool.load_point, **TARGETS})
    data = built.createData()
    frame = built.getFrameId("load")

    for i in range(5):
        dq = np.zeros(7)
        for _ in range(50):  # fixed-point iteration on the joint values
            J = pin.computeFrameJacobian(
                built, data, asked.q[i] + dq, frame, pin.LOCAL_WORLD_ALIGNED
            )[:3]
            dq = x * (J.T @ asked.force[i])
        pin.framesForwardKinematics(built, data, asked.q[i] + dq)
        for t, name in enumerate(TARGETS):
            there = data.oMf[built.getFrameId(name)].translation
            assert np.abs(answer.loaded[i, t] - there).max() < 1e-12


def test_second_order_vanishes_with_the_load():
    """Deflected and undeflected geometry differ by the square of the load."""
    here = cell()
    x = here.robot.nominal_compliance

    def gap(size):
        asked = pulls(here.robot, 20, size=size)
        bent = predict(replace(here, equilibrium="deformed"), asked, x).displacement
        return np.abs(bent - predict(here, asked, x).displacement).max()

    assert gap(2000.0) / gap(1000.0) == pytest.approx(4.0, rel=0.02)


def test_a_force_in_a_wrong_unit_still_finds_an_equilibrium():
    """A thousand and a million times too large: far away, but finite."""
    here = replace(cell(), equilibrium="deformed")
    for size in (3e6, 3e9):
        there = predict(here, pulls(here.robot, 20, size=size), here.robot.nominal_compliance)

        assert np.isfinite(there.displacement).all()
        assert np.abs(there.displacement).max() < 100


def test_what_remembers_a_pose_remembers_nothing_of_another_set_of_forces():
    """Hysteresis under the same forces twice: the second set moves as the first."""
    bare = cell()
    robot = bare.robot
    once = replace(pulls(robot, 12), pose=np.repeat(np.arange(3), 4))
    once = replace(once, q=once.q[once.pose], branch=np.tile([1.0, 1.0, -1.0, -1.0], 3))
    for effect in catalogue(robot):
        if effect.name != "joint_hysteresis":
            continue
        with_it = bare.with_effects(effect)
        typical = [100 * p.typical for p in effect.parameters]
        x = np.concatenate([robot.nominal_compliance, typical])
        twice = predict(with_it, once.under(np.stack([once.force] * 2)), x).displacement

        np.testing.assert_array_equal(twice[12:], twice[:12])


def test_what_is_kept_is_asked_for_by_all_it_depends_on():
    """Changing robot, tool, pulls, causes and sizes in turn, twice each: as without a cache.

    For this number of pulls nothing is cached: a few pulls at a time give the reference.
    """
    base = cell()
    few, other = pulls(base.robot, 4), pulls(base.robot, 4, seed=12)
    causes = [
        e for e in catalogue(base.robot, few) if e.place in ("force", "scale", "tool", "joint")
    ]
    cells = [base, cell((0.1, 0.1, 0.2)), *(base.with_effects(one) for one in causes[:40])]
    for asked in (few, other, few):
        many = asked.part(np.tile(np.arange(4), 80))
        for here in cells:
            for much in (1.0, -0.5):
                x = much * np.array([one.typical for one in here.parameters])
                ours, plain = (predict(here, p, x) for p in (asked, many))
                np.testing.assert_allclose(ours.displacement, plain.displacement[:4], atol=1e-15)
                np.testing.assert_allclose(ours.unloaded, plain.unloaded[:4], atol=1e-12)
