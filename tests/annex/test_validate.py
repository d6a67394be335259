"""Eqs. (22), (23): relative deflection errors against ones computed pose by pose."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.annex.validate import deflections, validate
from pipeline.base.arrays import Parameter
from pipeline.base.errors import InputError
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.reduction.pose_of_interest import PoseOfInterest, place_of_interest
from pipeline.reduction.settings import AskedPose
from pipeline.system.system import Estimate, Goodness

ROBOT = load("kr500_rail")
TOOL = Tool(
    np.array([0.15, 0.0, 0.25]),
    np.array(["P1", "P2"], object),
    np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10]]),
)
CELL = paper_cell(ROBOT, TOOL)
Q = np.array([8.5, *np.deg2rad([-10, 35, 39, 81, 22, -10])])
F = np.array([-124.5, -175.4, -209.1])
X = ROBOT.nominal_compliance
HERE = PoseOfInterest(Q, F, True)


def estimate(cov):
    """An estimate with this covariance, other attributes arbitrary."""
    return Estimate(
        parameters=tuple(Parameter(f"c{i}", "1", 1.0) for i in range(7)),
        value=X,
        cov=cov,
        identifiable=np.isfinite(np.diag(cov)),
        residual=np.zeros(1),
        goodness=Goodness(1.0, 1, 0.5),
        noise_from="stated",
        residual_std_m=0.0,
        quantile=1.96,
    )


def certain(cov):
    """One hypothesis with this covariance."""
    return [Hypothesis(1.0, (), CELL, None, estimate(cov))]


def test_deflections_are_eq_5_by_finite_differences():
    """A x from the derivative of the point and of the work of the force by each joint."""
    A = deflections(CELL, Q[None], F[None])[0]
    h, x = 1e-6, np.zeros((2, 3))
    for k in range(7):
        step = np.eye(7)[k] * h
        ahead, behind = (configure(ROBOT, (Q + s)[None]) for s in (step, -step))
        move = (ahead.points(TOOL.points) - behind.points(TOOL.points))[0] / (2 * h)
        lever = (ahead.points(TOOL.load_point[None]) - behind.points(TOOL.load_point[None]))[0, 0]
        x += move * (lever @ F / (2 * h)) * X[k]

    moved = A @ X

    assert moved == pytest.approx(x, rel=1e-7)


def test_one_stiffness_off_by_one_percent_shows_as_its_share():
    """If only k_1..k_7 together are off by the same 1 %, mu is 1 % at any pose."""
    cov = np.outer(X, X) * 0.01**2
    table = validate(
        certain(cov),
        HERE,
        np.random.default_rng(1),
        poses=4000,
    )
    full = table[table["draw"] == "covariance"]

    for _, mu in full.groupby(["set", "target"])["mu"]:
        assert np.sqrt(np.mean(mu**2)) == pytest.approx(0.01, rel=0.05)


def test_only_the_full_covariance_keeps_the_stiffnesses_together():
    """With one common relative error, both targets of a pose are off alike; not by Eq. (23)."""
    cov = np.outer(X, X) * 0.01**2
    table = validate(certain(cov), HERE, np.random.default_rng(1), poses=200)
    mu = table.set_index(["draw", "set", "index", "target"])["mu"].unstack("target")
    gap = (mu["P1"] / mu["P2"] - 1).abs().groupby("draw").median()

    assert gap["covariance"] < 1e-9
    assert gap["independent"] > 1e-3


def test_an_undetermined_stiffness_stays_put():
    """A parameter of infinite uncertainty is not drawn."""
    cov = np.diag((0.01 * X) ** 2)
    cov[6, 6] = np.inf
    table = validate(certain(cov), HERE, np.random.default_rng(1), poses=50)

    assert np.isfinite(table["mu"]).all()


def test_what_may_be_true_is_drawn_by_its_weight():
    """Two hypotheses 10 % apart, weights 0.8 and 0.2: mu is the distance to either."""
    cov = np.outer(X, X) * 1e-12
    stiff, soft = estimate(cov), replace(estimate(cov), value=1.1 * X)
    both = [Hypothesis(w, (), CELL, None, x) for w, x in ((0.8, stiff), (0.2, soft))]
    table = validate(both, PoseOfInterest(Q, F, True), np.random.default_rng(1), poses=4000)
    mu = table.loc[table["draw"] == "covariance", "mu"].to_numpy()

    near, far = 0.02 / 1.02, 0.08 / 1.02
    assert np.minimum(np.abs(mu - near), np.abs(mu - far)).max() < 1e-5
    assert np.mean(np.abs(mu - far) < 1e-5) == pytest.approx(0.2, abs=0.02)


def test_validation_poses_are_where_they_should_be():
    """1000 around the test pose and 1000 in the workspace, per draw and target."""
    cov = np.diag((0.01 * X) ** 2)
    table = validate(certain(cov), HERE, np.random.default_rng(1))

    assert table.groupby(["set", "draw", "target"]).size().eq(1000).all()


def test_a_test_pose_of_another_robot_is_refused():
    """The sentence names the joints."""
    pulls = Pulls(*[np.zeros(1, int)] * 2, Q[None], F[None], *[np.zeros(1)] * 4)
    with pytest.raises(InputError, match="theta7"):
        place_of_interest(AskedPose(q=[1, 2, 3], force_n=(0, 0, 1)), ROBOT, pulls)
