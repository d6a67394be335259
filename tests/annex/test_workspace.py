from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.annex.bodies import arm_joints
from pipeline.annex.workspace import _seen, workspace
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.system import Estimate, Goodness

LOAD = np.array([0.15, 0.02, 0.25])
Q = {
    "kr500_rail": [5.0, 0.3, 0.5, 0.7, 1.2, 0.5, 0.4],
    "kr500_rail_kuka": [5.0, 0.3, 0.5, 0.7, 1.2, 0.5, 0.4],
    "fanuc_r2000ic": [0.3, -0.3, -0.5, 0.1, -1.1, 2.5],
    "ur10": [0.3, -1.0, 1.5, -0.6, 1.2, 0.4],
    "ur10e": [0.3, -1.0, 1.5, -0.6, 1.2, 0.4],
    "kr210_l150": [0.3, 0.3, -0.4, 0.7, 1.2, 0.4],
    "kr210_r2700_2": [0.3, -1.2, 1.6, 0.7, 1.2, 0.4],
    "irb6640": [0.3, 0.3, 0.2, 0.7, 1.2, 0.4],
    "kr360_r2830": [0.3, -1.2, 1.6, 0.7, 1.2, 0.4],
    "irb6700_200_260": [0.3, 0.3, 0.2, 0.7, 1.2, 0.4],
    "fanuc_m900ia_260l": [0.3, 0.3, 0.2, 0.7, 1.2, 0.4],
    "gp180": [0.3, 0.3, 0.2, 0.7, 1.2, 0.4],
    "ur20": [0.3, -1.0, 1.5, -0.6, 1.2, 0.4],
}


def cell_of(name):
    """The paper's cell of a robot with one reflector."""
    return paper_cell(load(name), Tool(LOAD, np.array(["P1"], object), np.array([[0.2, 0, 0.1]])))


def estimate_of(cell, unknown=None):
    """Compliances near the robot's own, correlated, one of them possibly undetermined."""
    rng = np.random.default_rng(5)
    value = cell.robot.nominal_compliance * rng.uniform(0.8, 1.2, cell.robot.n)
    own = 0.1 * rng.standard_normal((len(value), len(value)))
    half = 0.03 * value[:, None] * np.hstack([np.ones((len(value), 1)), own])
    cov = half @ half.T
    if unknown is not None:
        cov[unknown] = cov[:, unknown] = 0.0
        cov[unknown, unknown] = np.inf
    known = np.isfinite(np.diag(cov))
    return Estimate(
        cell.parameters, value, cov, known, np.zeros(1), Goodness(1.0, 1, None), "stated", 0.0, 2.0
    )


def known(cell, estimate):
    """A model of one hypothesis."""
    return [ModelHypothesis(1.0, cell, estimate.value, estimate.cov)]


def moved(cell, q, force, x):
    """Displacement of the load point, from the forward model pull by pull."""
    m = len(force)
    tool = Tool(LOAD, np.array(["here"], object), LOAD[None])
    none, zero = np.zeros(m), np.zeros(m, int)
    pulls = Pulls(zero, zero, np.tile(q, (m, 1)), force, none, none, none, none)
    return predict(replace(cell, tool=tool), pulls, x).displacement[:, 0]


@pytest.mark.parametrize("name", Q)
def test_no_pull_moves_the_load_point_further(name):
    """At the test pose, no direction of pull is more compliant than the map says."""
    cell, q = cell_of(name), np.array(Q[name])
    estimate = estimate_of(cell)
    here = workspace(known(cell, estimate), PoseOfInterest(q, np.ones(3), True)).iloc[0]
    pull = np.random.default_rng(1).standard_normal((4000, 3))
    pull /= np.linalg.norm(pull, axis=1, keepdims=True)

    size = np.linalg.norm(moved(cell, q, pull, estimate.value), axis=1)

    assert size.max() <= here["worst_m_per_n"] * (1 + 1e-9)
    assert size.max() >= here["worst_m_per_n"] * 0.995


def test_a_stretched_arm_has_its_map():
    """Elbow up and down coincide there: the test pose is kept, whatever the rounding."""
    turn = np.tile(np.eye(3), (3, 2, 1, 1))
    elbow = np.tile([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], (3, 1, 1))
    points = np.array([[[2.0, 0.0, 0.0]], [[1.0, 1.0, 0.0]], [[1.0, -1.0, 0.0]]])
    here = SimpleNamespace(points=lambda _: points, axes=turn, origin=elbow)
    inside, plane = _seen(here, cell_of("kr500_rail"), (0, 1))

    assert inside.tolist() == [True, True, False]
    assert np.isfinite(plane).all()


def test_its_uncertainty_is_that_of_draws_from_the_covariance():
    """Compliances drawn from the full covariance give the stated scatter of the deflection."""
    name = "kr500_rail"
    cell, q = cell_of(name), np.array(Q[name])
    estimate = estimate_of(cell)
    here = workspace(known(cell, estimate), PoseOfInterest(q, np.ones(3), True)).iloc[0]
    rng = np.random.default_rng(2)
    each = np.array([moved(cell, q, np.eye(3), one) for one in np.diag(estimate.value)])
    x = rng.multivariate_normal(estimate.value, estimate.cov, size=20000, method="eigh")
    size = np.linalg.norm(np.tensordot(x / estimate.value, each, 1), ord=2, axis=(1, 2))

    assert np.std(size) == pytest.approx(here["std_m_per_n"], rel=0.03)


def test_its_uncertainty_holds_what_hypotheses_differ_by():
    """For two equally likely robots, 10 % apart, the map is the mean, uncertain by half of it."""
    cell, where = cell_of("kr500_rail"), PoseOfInterest(np.array(Q["kr500_rail"]), np.ones(3), True)
    x = cell.robot.nominal_compliance
    both = [ModelHypothesis(0.5, cell, f * x, np.zeros((7, 7))) for f in (0.95, 1.05)]
    here = workspace(both, where).iloc[0]
    middle = workspace([ModelHypothesis(1.0, cell, x, np.zeros((7, 7)))], where).iloc[0]

    assert here["worst_m_per_n"] == pytest.approx(middle["worst_m_per_n"], rel=1e-9)
    assert here["std_m_per_n"] == pytest.approx(0.05 * middle["worst_m_per_n"], rel=1e-6)


@pytest.mark.parametrize("name", Q)
def test_the_map_lies_where_pinocchio_puts_the_load_point(name):
    """Heights agree with Pinocchio, and the plane is as wide as the arm is long."""
    cell, q = cell_of(name), np.array(Q[name])
    table = workspace(known(cell, estimate_of(cell)), PoseOfInterest(q, np.ones(3), True))
    built = model(cell.robot, {"load": LOAD})
    data = built.createData()
    pin.framesForwardKinematics(built, data, q)
    at = data.oMf[built.getFrameId("load")].translation

    assert table["height_m"].iloc[0] == pytest.approx(at[2], abs=1e-12)
    assert 100 < len(table) <= 626
    assert np.hypot(np.ptp(table["reach_m"]), np.ptp(table["height_m"])) > 2.0


def test_every_place_of_the_map_is_reached_once():
    """The elbow stays on one side of the stretched position, so that no place has two values."""
    name = "fanuc_r2000ic"
    cell = cell_of(name)
    table = workspace(
        known(cell, estimate_of(cell)), PoseOfInterest(np.array(Q[name]), np.ones(3), True)
    )
    swept = table[table["row"] >= 0]
    corners = {(r.row, r.column): (r.reach_m, r.height_m) for r in swept.itertuples()}
    turns = []
    for (row, column), here in corners.items():
        along, across = corners.get((row + 1, column)), corners.get((row, column + 1))
        if along and across:
            a, b = np.subtract(along, here), np.subtract(across, here)
            turns.append(a[0] * b[1] - a[1] * b[0])

    assert len(turns) > 100
    assert abs(np.sign(turns).sum()) == len(turns)


def test_a_stiffness_that_is_not_known_leaves_the_map_and_takes_its_uncertainty():
    """An undetermined compliance: all values stay, with unknown uncertainty where it acts."""
    cell = cell_of("kr500_rail")
    unknown = known(cell, estimate_of(cell, unknown=6))
    table = workspace(unknown, PoseOfInterest(np.array(Q["kr500_rail"]), np.ones(3), True))

    assert np.isfinite(table.drop(columns="std_m_per_n").to_numpy(float)).all()
    assert np.isinf(table["std_m_per_n"]).any()


def test_a_hypothesis_without_weight_takes_no_uncertainty():
    """An impossible hypothesis that determines nothing changes neither map nor prediction."""
    cell, where = cell_of("kr500_rail"), PoseOfInterest(np.array(Q["kr500_rail"]), np.ones(3), True)
    one, blind = known(cell, estimate_of(cell)), known(cell, estimate_of(cell, unknown=6))
    both = (*one, replace(blind[0], weight=0.0))

    assert workspace(both, where).equals(workspace(one, where))
    models = [IdentifiedModel("", "adequate", {}, tuple(those)) for those in (both, one)]
    first, second = (model.predict(where.q, where.force).std for model in models)
    assert first == pytest.approx(second)


def test_an_arm_without_parallel_joints_has_no_map():
    """Without a shoulder and an elbow there is no plane to show, which is not an error."""
    cell = cell_of("kr500_rail")
    tilted = cell.robot.placement.copy()
    angle = 0.3
    tilted[3] = tilted[3] @ np.array(
        [
            [1, 0, 0, 0],
            [0, np.cos(angle), -np.sin(angle), 0],
            [0, np.sin(angle), np.cos(angle), 0],
            [0, 0, 0, 1],
        ]
    )
    robot = replace(cell.robot, placement=tilted)
    q = np.array(Q["kr500_rail"])

    assert arm_joints(cell.robot, q) == (2, 3)
    assert arm_joints(robot, q) is None
    other = known(replace(cell, robot=robot), estimate_of(cell))
    assert workspace(other, PoseOfInterest(q, np.ones(3), True)).empty
