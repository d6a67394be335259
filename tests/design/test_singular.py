"""The distance from singular poses: against Pinocchio, against finite differences, by the wrist."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.design.singular import dexterity
from pipeline.machine.robot import SHIPPED, configure, load

SEED = 20261125


def drawn(robot, count):
    """Joint values within the limits."""
    low, high = (np.clip(one, -4.0, 20.0) for one in (robot.lower, robot.upper))
    return np.random.default_rng(SEED).uniform(low, high, (count, robot.n))


def by_pinocchio(robot, q):
    """The smallest singular value of the turning joints' Jacobian, lengths over that of the arm."""
    built = model(robot)
    data, flange = built.createData(), built.getFrameId("flange")
    turns = ~robot.prismatic
    pin.framesForwardKinematics(built, data, q)
    at = [data.oMi[int(k) + 1].translation for k in np.flatnonzero(turns)]
    at.append(data.oMf[flange].translation)
    length = sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(at))
    J = pin.computeFrameJacobian(built, data, q, flange, pin.LOCAL_WORLD_ALIGNED)[:, turns]
    return np.linalg.svd(np.vstack([J[3:], J[:3] / length]), compute_uv=False)[-1]


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", SHIPPED)
def test_it_is_the_smallest_singular_value(name):
    """To rounding, in twenty poses of every robot that ships."""
    robot = load(name)
    q = drawn(robot, 20)
    wanted = [by_pinocchio(robot, one) for one in q]

    assert dexterity(configure(robot, q))[0] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("name", ["kr500_rail", "ur10e", "irb6640"])
def test_where_there_is_ample_room_nobody_looks_closer(name):
    """Below it, value and slope are as ever; above, the value lies between it and the true one."""
    robot, ample = load(name), 0.05
    at = configure(robot, drawn(robot, 400))
    value, slope = dexterity(at)
    quick, quick_slope = dexterity(at, ample)
    near, wide = value <= ample, value > 3 * ample

    assert near.sum() > 20
    assert quick[near] == pytest.approx(value[near], rel=1e-12)
    assert quick_slope[:, near] == pytest.approx(slope[:, near], rel=1e-9, abs=1e-12)
    assert (quick[~near] > ample).all()
    assert (quick <= value * (1 + 1e-9)).all()
    assert not quick_slope[:, wide].any()


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", SHIPPED)
def test_its_slope_is_the_finite_difference(name):
    """By every joint, rails included, which do not change it."""
    robot, h = load(name), 1e-6
    q = drawn(robot, 12)
    slope = dexterity(configure(robot, q))[1]
    steps = h * np.eye(robot.n)
    both = [[dexterity(configure(robot, q + way * s))[0] for s in steps] for way in (1, -1)]
    found = (np.array(both[0]) - np.array(both[1])) / (2 * h)

    assert slope == pytest.approx(found, abs=2e-6)
    assert np.abs(slope[robot.prismatic]).max(initial=0.0) < 1e-12


def test_a_stretched_wrist_and_a_stretched_elbow_have_none():
    """A5 at zero; and the elbow of a UR, whose third joint at zero stretches the arm."""
    kuka, ur = load("kr210_r2700_2"), load("ur10e")
    q = np.vstack([drawn(kuka, 5)])
    q[:, 4] = 0.0
    bent = drawn(ur, 5)
    bent[:, 2] = 0.0

    assert dexterity(configure(kuka, q))[0].max() < 1e-6
    assert dexterity(configure(ur, bent))[0].max() < 1e-6
