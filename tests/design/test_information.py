"""The information of a pose: fits to drawn readings, and slopes of every part by differences."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.design.information import (
    Experiment,
    _pull_back,
    information,
    station,
    value_and_slope,
)
from pipeline.design.scatter import PulledReadings
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load

LOAD = np.array([0.15, 0.0, 0.25])
RING = np.array([[0.15, 0, 0.1], [-0.075, 0.13, 0.1], [-0.075, -0.13, 0.1]])
ANCHOR = np.array([5.0, 6.0, -0.9])
STEPS, REPEATS = np.array([900.0, 2500.0]), np.array([2.0, 1.0])
COV = 9e-10 * np.array([[1.0, 0.3, 0.0], [0.3, 0.5, 0.1], [0.0, 0.1, 0.8]])


@pytest.fixture(scope="module")
def made():
    robot = load("kr500_rail")
    return Experiment(
        robot, LOAD, RING, robot.nominal_compliance,
        PulledReadings(STEPS, REPEATS, np.array([4.0, 9.0]), 0.5, COV),
    )  # fmt: skip


def drawn_poses(robot, m, seed):
    lower = np.where(np.isfinite(robot.lower), robot.lower, -3)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 3)
    return np.random.default_rng(seed).uniform(lower, upper, (m, robot.n))


def test_a_station_stands_and_yields_as_the_forward_model_does(made):
    """Points, direction, length of the chain and displacement per newton of two poses."""
    q = drawn_poses(made.robot, 2, 1)
    at = station(made, q, ANCHOR)
    cell = paper_cell(made.robot, Tool(LOAD, np.array(["a", "b", "c"], object), RING))
    for k in range(2):
        none = np.zeros(1)
        chain = ANCHOR - at.load_point[:, k]
        assert at.chain_m[k] == pytest.approx(np.linalg.norm(chain))
        np.testing.assert_allclose(at.direction[:, k], chain / np.linalg.norm(chain))
        pulls = Pulls(none.astype(int), none.astype(int), q[k : k + 1],
                      at.direction[:, k][None], none, none, none, none)  # fmt: skip
        there = predict(cell, pulls, made.scale)
        np.testing.assert_allclose(at.points[..., k], there.unloaded[0], atol=1e-12)
        np.testing.assert_allclose(at.A[..., k].sum(axis=1), there.displacement[0], rtol=1e-9)
        work = at.tau[:, k] ** 2 @ made.scale  # Castigliano: what the load point yields
        np.testing.assert_allclose(
            np.sum(at.J_load[:, :, k] * at.direction[:, k], axis=1), at.tau[:, k], rtol=1e-12
        )
        tip = replace(cell, tool=Tool(LOAD, np.array(["load"], object), LOAD[None]))
        yields = predict(tip, pulls, made.scale).displacement[0, 0] @ at.direction[:, k]
        assert work == pytest.approx(yields, rel=1e-9)


def test_estimates_from_drawn_readings_scatter_as_the_information_says(made):
    """Three poses, 3000 campaigns: loaded readings, one zero to a target, a scale that errs."""
    rng = np.random.default_rng(5)
    q = drawn_poses(made.robot, 6, 2)
    at = station(made, q, ANCHOR)
    M = information(made, at).sum(axis=0)
    L, T = np.linalg.cholesky(COV), np.kron(np.eye(3), COV)
    size = np.repeat([0, 1], [2, 1])
    blocks, W, noise = [], [], []
    for k in range(6):
        A = at.A[..., k].transpose(0, 2, 1).reshape(9, 7)
        d = A.sum(axis=1)
        blocks.append(np.vstack([STEPS[s] * A for s in size]))
        V = np.kron(np.eye(3) + 0.5, T)
        for i, s in enumerate(size):
            V[9 * i : 9 * i + 9, 9 * i : 9 * i + 9] += [4.0, 9.0][s] ** 2 * np.outer(d, d)
        W.append(np.linalg.inv(np.linalg.cholesky(V)))
        zero = np.sqrt(0.5) * np.einsum("ij,ctj->cti", L, rng.normal(size=(3000, 3, 3)))
        rows = []
        for s in size:
            read = np.einsum("ij,ctj->cti", L, rng.normal(size=(3000, 3, 3))) - zero
            force = [4.0, 9.0][s] * rng.normal(size=3000)
            rows.append(read.reshape(3000, 9) + force[:, None] * d)
        noise.append(np.hstack(rows))
    X = np.vstack([w @ b for w, b in zip(W, blocks, strict=True)])
    y = np.hstack([n @ w.T for w, n in zip(W, noise, strict=True)])
    x = np.linalg.lstsq(X, y.T, rcond=None)[0]

    std = np.sqrt(np.diag(np.linalg.inv(M)))
    np.testing.assert_allclose(x.std(axis=1), std, rtol=0.06)


def test_more_of_anything_is_more_information(made):
    """Two repeats more, a stronger step, a better scale: the difference has no negative side."""
    at = station(made, drawn_poses(made.robot, 4, 3), ANCHOR)
    plain = information(made, at)
    s = made.scatter
    for better in (
        PulledReadings(STEPS, REPEATS + 2, s.force_std, 0.5, COV),
        PulledReadings(1.5 * STEPS, REPEATS, s.force_std, 0.5, COV),
        PulledReadings(STEPS, REPEATS, 0 * s.force_std, 0.5, COV),
        PulledReadings(STEPS, REPEATS, s.force_std, 0.0, COV),
        PulledReadings(STEPS, REPEATS, s.force_std, 0.5, COV / 2),
    ):
        more = information(replace(made, scatter=better), at) - plain
        assert (np.linalg.eigvalsh(more)[:, 0] > -1e-9 * np.abs(plain).max()).all()
        assert (np.linalg.eigvalsh(more)[:, -1] > 1e-3 * np.abs(plain).max(axis=(1, 2))).any()


@pytest.mark.parametrize("name", ["kr500_rail", "fanuc_r2000ic"])
def test_a_slope_by_joints_and_anchor_is_the_difference(name):
    """Of the displacements themselves, weighted at random, sliding and turning joints."""
    robot = load(name)
    one = Experiment(
        robot, LOAD, RING, np.ones(robot.n), PulledReadings(STEPS, REPEATS, np.zeros(2), 0.0, COV)
    )
    q, rng = drawn_poses(robot, 3, 4), np.random.default_rng(6)
    anchor = ANCHOR + rng.normal(size=(3, 3))
    G = rng.normal(size=(3, robot.n, 3, 3))

    by_q, by_anchor = _pull_back(station(one, q, anchor), G)

    def value(q, anchor):
        return (G * station(one, q, anchor).A).sum(axis=(0, 1, 2))

    h = 1e-6
    for j in range(robot.n):
        step = h * np.eye(robot.n)[j]
        slope = (value(q + step, anchor) - value(q - step, anchor)) / (2 * h)
        np.testing.assert_allclose(by_q[j], slope, rtol=1e-5, atol=1e-6 * np.abs(by_q).max())
    for i in range(3):
        step = h * np.eye(3)[i]
        slope = (value(q, anchor + step) - value(q, anchor - step)) / (2 * h)
        np.testing.assert_allclose(
            by_anchor[i], slope, rtol=1e-5, atol=1e-6 * np.abs(by_anchor).max()
        )


def test_one_weighting_for_all_poses_is_that_of_each(made):
    """And the value is the sum of weights times information, with an exact scale or without."""
    at = station(made, drawn_poses(made.robot, 3, 7), ANCHOR)
    W = np.random.default_rng(8).normal(size=(7, 7))
    W = W @ W.T
    exact = replace(made, scatter=PulledReadings(STEPS, REPEATS, np.zeros(2), 0.5, COV))
    for one in (made, exact):
        shared = value_and_slope(one, at, W)
        each = value_and_slope(one, at, np.stack([W] * 3))
        for a, b in zip(shared, each, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * np.abs(b).max())
        np.testing.assert_allclose(shared[0], np.sum(W * information(one, at), axis=(1, 2)))
