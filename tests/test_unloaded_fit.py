"""Causes from the unloaded positions: against dense least squares with priors, and draws."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from pipeline.diagnosis.unloaded_fit import Fits, fitted, student, unloaded
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale

KR500 = load("kr500_rail")
EFFECTS = {effect.label: effect for effect in catalogue(KR500)}
OFFSET, OTHER = EFFECTS["joint_offset:3"], EFFECTS["joint_offset:5"]
NAMES = np.array(["P1", "P2", "P3"], object)
POINTS = np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]])
CELL = paper_cell(KR500, Tool(np.array([0.15, 0.0, 0.25]), NAMES, POINTS))
POSES = 9
TOOL_M = 5e-3
"""How far the points of the tool may be from their nominals."""


@cache
def asked():
    """Two pulls in each of nine poses; the zeros have covariances of any direction."""
    rng = np.random.default_rng(3)
    m = 2 * POSES
    pose = np.repeat(np.arange(POSES) + 4, 2)
    q = np.repeat(rng.uniform(KR500.lower, KR500.upper, (POSES, 7)), 2, axis=0)
    force, none = rng.standard_normal((m, 3)) * 1000, np.zeros(m)
    pulls = Pulls(pose, np.arange(m) % 2, q, force, none, none, none, none)
    pull, target = np.repeat(np.arange(m), 3), np.tile(np.arange(3), m)
    zero = pull // 2 * 3 + target
    half = 2e-5 * (rng.standard_normal((3 * POSES, 3, 3)) + 2 * np.eye(3))
    C = (half @ half.swapaxes(1, 2))[zero]
    turn = np.diag([2e-5, 3e-5, 1e-5]) @ np.array([[1, 0.4, 0], [0, 1, -0.3], [0, 0, 1.0]])
    moved = predict(CELL, pulls, KR500.nominal_compliance)
    return Measured(
        pulls=pulls, pull=pull, target=target, name=NAMES[target],
        delta=moved.displacement.reshape(-1, 3), unloaded=moved.unloaded.reshape(-1, 3),
        loaded_cov=C, zero_cov=C, zero=zero, reading_std=np.ones(m),
        direction_cov=np.zeros((m, 3, 3)), rotation_cov=turn @ turn.T, scale=Scale(),
        noise_stated=True, joint_std=np.zeros(7),
    )  # fmt: skip


def stands(q, points=POINTS):
    """Where the table puts the reflectors in nine poses, three to a pose, shape (27, 3)."""
    cell = replace(CELL, tool=replace(CELL.tool, points=points))
    moved = predict(cell, Pulls.at(q, np.zeros(3)), np.zeros(7))
    return moved.unloaded.reshape(-1, 3)


def read(rng, offset=0.0, joint_std=None, scale=1.0):
    """The measurements with the zeros read of a robot, tool and base that are off, by draws."""
    data = asked()
    std = np.zeros(7) if joint_std is None else joint_std
    q = data.pulls.q[::2] + std * rng.standard_normal(7)
    q[:, 2] += offset
    at = stands(q, POINTS + 2e-4 * rng.standard_normal((3, 3)))
    at = at + np.cross(np.linalg.cholesky(data.rotation_cov) @ rng.standard_normal(3), at)
    at = at + 3.0 * rng.standard_normal(3)  # the base stands anywhere
    C = data.zero_cov[np.unique(data.zero, return_index=True)[1]]
    at = at + scale * (np.linalg.cholesky(C) @ rng.standard_normal((27, 3, 1)))[..., 0]
    return replace(data, unloaded=at[data.zero], joint_std=std)


def by_hand(data, joints, scale=1.0):
    """Offsets of some joints by dense generalised least squares with a prior on all else.

    Returns:
        Values and their covariance, what is left with the priors, and where.
    """
    off = np.zeros(7)
    for _ in range(4):
        found = linearised(data, joints, scale, off)
        off[joints] += found[0]
    return off[joints], *found[1:]


def linearised(data, joints, scale, off):
    """One step of it from some offsets: the columns of the offsets there, the others at zero."""
    q, d = data.pulls.q[::2], 1e-6
    first = np.unique(data.zero, return_index=True)[1]
    here, columns, prior = stands(q), [], []
    for axis in np.eye(3):  # the base's place
        columns.append(np.tile(axis, 27))
        prior.append(0.0)
    for k in range(9):
        step = np.zeros(9)
        step[k] = d
        columns.append(((stands(q, POINTS + step.reshape(3, 3)) - here) / d).ravel())
        prior.append(1 / TOOL_M**2)
    for axis in np.eye(3):  # the base's rotation, its prior below
        columns.append(np.cross(axis, here).ravel())
        prior.append(0.0)
    for k in np.flatnonzero(data.joint_std):
        columns.append(((stands(q + d * np.eye(7)[k]) - here) / d).ravel())
        prior.append(1 / data.joint_std[k] ** 2)
    for k in joints:
        step = d * np.eye(7)[k]
        columns.append(((stands(q + off + step) - stands(q + off - step)) / (2 * d)).ravel())
        prior.append(0.0)
    X, P = np.array(columns).T, np.diag(prior)
    P[12:15, 12:15] = np.linalg.inv(data.rotation_cov)
    W = np.zeros((81, 81))
    for i, C in enumerate(data.zero_cov[first]):
        W[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = np.linalg.inv(C * scale**2)
    N = X.T @ W @ X + P
    size = np.sqrt(np.diag(N))
    cov = np.linalg.inv(N / np.outer(size, size)) / np.outer(size, size)
    y = (data.unloaded[first] - stands(q + off)).ravel()
    x = cov @ X.T @ W @ y
    left = y - X @ x
    n = len(joints)
    return x[-n:], cov[-n:, -n:], left @ W @ left + x @ P @ x, left


@pytest.mark.parametrize("sure", [True, False], ids=["log exact", "log stated"])
@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_offsets_are_those_of_dense_least_squares(sure, scale):
    """Values, covariance, what is left and where, with tool, base and stated joints estimated."""
    std = np.zeros(7) if sure else np.array([1e-4, 0, 2e-4, 1e-4, 1e-4, 0, 1e-4])
    data = read(np.random.default_rng(4), 2e-4, std, scale)
    zeros = unloaded(CELL, data, scale)
    fit = fitted(zeros, (OTHER, OFFSET))
    x, cov, chi2, left = by_hand(data, [4, 2], scale)

    assert fit.values == pytest.approx(x, rel=1e-4, abs=1e-9)
    assert fit.chi2 == pytest.approx(chi2, rel=1e-4)
    assert fit.dof == 81 - 3 - 9 - 2
    birge = max(1.0, chi2 / fit.dof)
    assert fit.cov == pytest.approx(cov * birge, rel=2e-3, abs=2e-3 * cov.max())
    assert zeros.short(fit) == pytest.approx(left.reshape(-1, 3), abs=1e-7)
    assert Fits(zeros).left((OTHER, OFFSET)) == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3)
    assert fit.size(1)[0] == pytest.approx(fit.values[1:])
    assert fit.size(1)[1] == pytest.approx(np.sqrt(np.diag(fit.cov))[1:])


def test_the_stated_uncertainty_is_that_of_draws():
    """Robot, tool, base and readings drawn forty times: offsets scatter as stated, chi2 as dof."""
    rng, off, chi2 = np.random.default_rng(5), [], []
    std = np.array([0, 1e-4, 0, 1e-4, 0, 1e-4, 0])
    for _ in range(40):
        fit = fitted(unloaded(CELL, read(rng, 3e-4, std), 1.0), (OFFSET,))
        inflated = max(1.0, fit.chi2 / fit.dof)
        off.append((fit.values[0] - 3e-4) / np.sqrt(fit.cov[0, 0] / inflated))
        chi2.append(fit.chi2)
    assert fit.dof == 81 - 3 - 9 - 1
    assert np.mean(chi2) == pytest.approx(fit.dof, abs=4 * np.sqrt(2 * fit.dof / 40))
    assert np.std(off) == pytest.approx(1.0, abs=4 / np.sqrt(80))
    assert np.mean(off) == pytest.approx(0.0, abs=4 / np.sqrt(40))


def test_a_large_offset_is_found_where_the_robot_stands():
    """Two degrees are no small change: the estimate is linearised again where it arrives."""
    data = read(np.random.default_rng(6), 0.035)
    fit = fitted(unloaded(CELL, data, 1.0), (OFFSET,))

    assert fit.values[0] == pytest.approx(0.035, abs=5 * np.sqrt(fit.cov[0, 0]))
    assert fit.p > 1e-3
    assert fitted(unloaded(CELL, data, 1.0), (OFFSET,), rounds=1).p < 1e-6


def test_a_stated_joint_is_not_estimated_where_the_log_is_taken_as_exact():
    """`exact` drops the joints' own errors and their priors, and nothing else."""
    std = np.full(7, 2e-4)
    data = read(np.random.default_rng(7), 0.0, std)
    zeros = unloaded(CELL, data, 1.0)
    sure = unloaded(CELL, replace(data, joint_std=np.zeros(7)), 1.0)
    one, two = (fitted(each, (OFFSET,)) for each in (zeros.exact, sure))

    assert one.values == pytest.approx(two.values)
    assert one.chi2 == pytest.approx(two.chi2)
    assert fitted(zeros, ()).chi2 < fitted(sure, ()).chi2


def test_without_a_pose_it_is_the_fit_of_the_others():
    """Rows of that pose gone, priors kept: as if it had never been measured."""
    data = read(np.random.default_rng(8), 2e-4)
    kept = data.pulls.pose[data.pull] != 6
    cut = replace(data, **{
        f: getattr(data, f)[kept]
        for f in ("pull", "target", "name", "delta", "unloaded", "loaded_cov", "zero_cov", "zero")
    })  # fmt: skip
    zeros = unloaded(CELL, data, 1.0)
    rest = zeros.without(2)
    never = fitted(unloaded(CELL, cut, 1.0), (OFFSET,))
    found, quick = fitted(rest, (OFFSET,)), Fits(zeros).without(2)((OFFSET,))

    assert len(rest.at) == 24
    assert len(rest.known) == len(zeros.known) - 9
    assert 2 not in rest.pose
    for one in (found, quick):
        assert one.values == pytest.approx(never.values, rel=1e-5)
        assert one.chi2 == pytest.approx(never.chi2, rel=1e-4)
        assert one.dof == never.dof == 72 - 3 - 9 - 1
        assert one.cov == pytest.approx(never.cov, rel=1e-4)
    gone = zeros.pose == 2
    late = zeros.short(never)[gone]
    assert np.linalg.norm(late) > np.linalg.norm(zeros.short(fitted(zeros, (OFFSET,)))[gone])


def test_a_fit_is_made_once_for_each_set_of_causes():
    """Asked again it is the same record; another set is another one."""
    fits = Fits(unloaded(CELL, read(np.random.default_rng(9)), 1.0))

    assert fits((OFFSET,)) is fits((OFFSET,))
    assert fits((OTHER,)) is not fits((OFFSET,))
    assert fits((OFFSET, OTHER)).values.shape == (2,)
    assert fits(()).values.shape == (0,)
    assert fits(()).dof == 81 - 3 - 9


def test_positions_that_are_not_known_are_left_out():
    """One zero unknown is one row less; with three poses nothing is said."""
    data = read(np.random.default_rng(2))
    lost = data.unloaded.copy()
    lost[data.zero == 4, 1] = np.nan
    assert len(unloaded(CELL, replace(data, unloaded=lost), 1.0).at) == 26

    for poses, there in ((4, True), (3, False)):
        few = np.where((data.zero < 3 * poses)[:, None], data.unloaded, np.nan)
        found = unloaded(CELL, replace(data, unloaded=few), 1.0)
        assert (found is not None) is there
    assert unloaded(CELL, data, np.inf) is None
    assert unloaded(CELL, data, 1.0).pose.tolist() == np.repeat(np.arange(9), 3).tolist()


def test_intervals_of_few_readings_are_students():
    """The quantile is that of the fit's own degrees of freedom, one at least."""
    fit = fitted(unloaded(CELL, read(np.random.default_rng(2)), 1.0), ())

    assert student(fit) == pytest.approx(stats.t.ppf(0.975, 69))
    assert student(replace(fit, dof=0)) == pytest.approx(stats.t.ppf(0.975, 1))
    assert fit.p == pytest.approx(stats.chi2.sf(fit.chi2, 69))
