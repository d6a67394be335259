"""Mixes of parameters against whole matrices of numpy, and the joint values that part them."""

import numpy as np
import pytest
from made_system import any_system, dense

from pipeline.base.arrays import Parameter
from pipeline.design.parting import _values
from pipeline.machine.robot import load
from pipeline.system.combinations import information, mixes


def parameters(n, units="rad/(N m)"):
    """Made-up compliances of size one."""
    units = [units] * n if isinstance(units, str) else units
    return tuple(Parameter(f"c{k}", unit, 1.0) for k, unit in enumerate(units))


def test_groups_that_nothing_joins_are_told_apart():
    """Two pairs and one single joint: two combinations of two, whatever else was measured."""
    true = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    W = np.array([[1, 0.5, 0, 0, 0], [0, 0, 1, -0.25, 0], [0, 0, 0, 0, 1.0]])
    mixed = np.random.default_rng(1).standard_normal((20, 3)) @ W * 100

    found = mixes(mixed.T @ mixed, parameters(5), true, np.array([0, 0, 0, 0, 1], bool))

    known = {tuple(one.of.tolist()): one for one in found}
    assert set(known) == {(0, 1), (2, 3)}
    assert known[0, 1].weights == pytest.approx([1, 0.5])
    assert known[2, 3].weights == pytest.approx([1, -0.25])
    assert known[0, 1].value == pytest.approx(2.0)


def test_parameters_of_two_units_are_not_mixed():
    """A sum of a prismatic and two revolute joints is known, and part of the revolute ones."""
    rows = np.array([[1.0, 1.0, 0.5], [2.0, 1.0, 0.5]]) * 50
    units = parameters(3, ["m/N", "rad/(N m)", "rad/(N m)"])

    (one,) = mixes(rows.T @ rows, units, np.ones(3), np.array([True, False, False]))
    none = mixes(rows[:1].T @ rows[:1], units, np.ones(3), np.zeros(3, bool))

    assert one.of.tolist() == [1, 2]
    assert one.weights == pytest.approx([1, 0.5])
    assert not none


def test_a_member_that_costs_little_is_left_out_and_one_that_costs_more_is_not():
    """A third joint with a weight of 0.01, known to its own size or hardly at all."""

    def of(third_std):
        rows = np.vstack([[100.0, 58.0, 1.0], [0.0, 0.0, 1 / third_std]])
        (one,) = mixes(rows.T @ rows, parameters(3), np.full(3, 1.0), np.zeros(3, bool))
        return one.of.tolist()

    assert of(0.9) == [0, 1]
    assert of(20.0) == [0, 1, 2]


@pytest.mark.parametrize("seed", range(20))
def test_any_system_is_told_by_as_many_mixes_as_it_has_directions(seed):
    """Each is determined by the rows, they are independent, and each agrees with numpy."""
    rng = np.random.default_rng(seed)
    n, rank = 6, int(rng.integers(1, 6))
    system = any_system(rng, n, rank)
    W = np.linalg.inv(np.linalg.cholesky(dense(system)))
    A, y = W @ system.B * system.typical, W @ system.c
    x, cov = np.linalg.pinv(A, rcond=1e-8) @ y, np.linalg.pinv(A.T @ A, rcond=1e-12)
    alone = np.zeros(n, bool)

    found = mixes(information(system, n), system.parameters, x * system.typical, alone)

    weights = np.zeros((len(found), n))
    for row, one in zip(weights, found, strict=True):
        row[one.of] = one.weights
        w = row * system.typical
        assert one.value == pytest.approx(w @ x, rel=1e-6)
        assert one.std == pytest.approx(np.sqrt(w @ cov @ w), rel=1e-6)
    assert np.linalg.matrix_rank(weights * system.typical) == rank == len(found)


@pytest.mark.parametrize("name", ["kr500_rail", "fanuc_r2000ic"])
def test_every_step_within_the_limits_is_tried(name):
    """Ten degrees or half a metre apart; one more either way would leave the limits."""
    robot = load(name)
    for joint in range(robot.n):
        tried, by = _values(robot, joint), 0.5 if robot.prismatic[joint] else np.deg2rad(10.0)
        low, high = robot.lower[joint], robot.upper[joint]
        low, high = (low if np.isfinite(low) else -np.pi), (high if np.isfinite(high) else np.pi)

        np.testing.assert_allclose(np.diff(tried), by, rtol=1e-9)
        assert low <= tried[0] < low + by + 1e-12
        assert high - by - 1e-12 < tried[-1] <= high
