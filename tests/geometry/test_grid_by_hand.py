"""A grid of roughnesses against normal densities of whole covariances, cell by cell."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special, stats

from pipeline.geometry.arm_weight import usual
from pipeline.geometry.remastered import _courses, slipped
from pipeline.geometry.roughness import RoughnessGrid, SuspectUnknowns, of_cells, same
from pipeline.geometry.slipped import ShapeRows, slips
from pipeline.machine.robot import load

RNG = np.random.default_rng(61)
ROWS, K, C = 14, 4, 5
D = RNG.normal(size=(ROWS, K))
Y = RNG.normal(size=ROWS)
NOISE = np.array([0.5, 0.8, 0.5, 1.2, 0.9])
STD = 10 ** RNG.uniform(-1, 0.5, (C, K))
ROUGH = np.array([[1e-5, 2e-5], [1e-5, 9e-4], [3e-4, 2e-5], [7e-4, 9e-4], [1e-5, 2e-5]])
WIDTH = np.array([0.3, -0.2, 0.1, 0.5, -0.4])


def density(std: np.ndarray, noise: float) -> float:
    """Log density of Y with the unknowns integrated out, up to (2 pi)^(m/2)."""
    V = noise**2 * np.eye(ROWS) + D @ np.diag(std**2) @ D.T
    normal = stats.multivariate_normal(np.zeros(ROWS), V)
    return float(normal.logpdf(Y) + 0.5 * ROWS * np.log(2 * np.pi))


def grid(free=(), std=STD, unrefined=None) -> RoughnessGrid:
    """The cells of the grid by the code."""
    M = np.stack([D.T @ D / s**2 for s in NOISE])
    b = np.stack([D.T @ Y / s**2 for s in NOISE])
    square = Y @ Y / NOISE**2 + 2 * ROWS * np.log(NOISE)
    x, cov, log = of_cells(M, b, square, std)
    return RoughnessGrid(
        free=free, std=std, rough=ROUGH, width=WIDTH, x=x, cov=cov, log=log, unrefined=unrefined
    )


ONE = SuspectUnknowns("one", (1,), 8.0)
TWO = SuspectUnknowns("two", (0, 3), 5.0, tries=6)


def test_cells_have_the_density_of_their_whole_covariance():
    """And estimates by least squares with the prior as rows."""
    found = grid()
    for c in range(C):
        X = np.vstack([D / NOISE[c], np.diag(1 / STD[c])])
        P = np.linalg.inv(X.T @ X)
        assert found.log[c] == pytest.approx(density(STD[c], NOISE[c]))
        np.testing.assert_allclose(found.cov[c], P)
        np.testing.assert_allclose(found.x[c], P @ X.T @ np.r_[Y / NOISE[c], np.zeros(K)])
    assert found.best == int(np.argmax(found.log))
    weight = np.exp(found.log) * np.exp(WIDTH)
    np.testing.assert_allclose(found.weight, weight / weight.sum())


def test_a_cell_that_cannot_be_computed_has_no_weight_and_knows_nothing():
    """As from one pose that is repeated."""
    M = np.stack([np.eye(2), np.full((2, 2), np.nan)])
    with np.errstate(invalid="ignore"):
        x, cov, log = of_cells(M, np.ones((2, 2)), np.zeros(2), np.ones((2, 2)))
    assert log[1] < -1e299
    assert np.isfinite(log[0])
    assert not x[1].any()
    assert not cov[1].any()
    np.testing.assert_allclose(x[0], [0.5, 0.5])


def test_averages_over_cells_hold_what_lies_between_them():
    """Mean and covariance of a mixture, as drawn; cells of hardly any weight do not count."""
    found = grid()
    w = found.weight
    kept = w > 1e-3
    assert kept.sum() > 1
    v = w[kept] / w[kept].sum()
    mean = sum(a * x for a, x in zip(w, found.x, strict=True))
    apart = found.x[kept] - mean
    cov = sum(a * (S + np.outer(d, d)) for a, S, d in zip(v, found.cov[kept], apart, strict=True))
    np.testing.assert_allclose(found.mean, mean)
    np.testing.assert_allclose(found.covariance, cov)
    np.testing.assert_allclose(found.roughness**2, w @ ROUGH**2)


def test_other_priors_change_the_density_as_if_computed_with_them():
    """Of one unknown and of two at once, larger and smaller, cell by cell."""
    found = grid()
    for one in (ONE, TWO):
        at = list(one.columns)
        for factor in (0.3, 1.0, 20.0):
            other = STD.copy()
            other[:, at] *= factor
            expected = [density(other[c], NOISE[c]) for c in range(C)]
            np.testing.assert_allclose(found.with_std(one, other[:, at]), expected)
        wide = STD.copy()
        wide[:, at] = 3.0
        expected = [density(wide[c], NOISE[c]) for c in range(C)]
        np.testing.assert_allclose(found.with_std(one, 3.0), expected)


def marginal(one: SuspectUnknowns, rest: np.ndarray) -> float:
    """Log evidence with a suspect of any of seven sizes over three decades, by hand."""
    total = 0.0
    for size in np.geomspace(1e-3, 1.0, 7):
        std = STD.copy()
        at = list(one.columns)
        std[:, at] = np.sqrt(rest[:, at] ** 2 + (size * one.wide) ** 2)
        each = [np.exp(density(std[c], NOISE[c]) + WIDTH[c]) for c in range(C)]
        total += sum(each) / 7 / one.tries
    return float(np.log(total))


def test_the_evidence_of_a_suspect_is_that_over_all_its_sizes():
    """Beside the roughness of the table; what is free already has no roughness beside it."""
    for one in (ONE, TWO):
        assert grid().evidence(one) == pytest.approx(marginal(one, STD))
        free = grid((one,))
        assert free.evidence(one) == pytest.approx(marginal(one, np.zeros((C, K))))
        coarse = grid()
        other = grid(std=2 * STD, unrefined=coarse)
        assert other.evidence(one) == pytest.approx(marginal(one, STD))


def test_the_evidence_of_a_grid_is_over_all_sizes_of_what_is_free():
    """The whole of it, times how much the free suspects gain on the unrefined one."""
    plain = grid()
    own = float(special.logsumexp(plain.log + WIDTH))
    assert plain.log_evidence == pytest.approx(own)
    free = grid((ONE, TWO))
    gains = [marginal(one, np.zeros((C, K))) - own for one in (ONE, TWO)]
    assert free.log_evidence == pytest.approx(own + sum(gains))
    finer = grid((ONE,), std=2 * STD, unrefined=grid((ONE,)))
    fine = float(special.logsumexp(finer.log + WIDTH))
    assert finer.log_evidence == pytest.approx(fine + gains[0])


def test_the_chance_of_roughness_is_that_of_two_scales():
    """Against the best of the cells with the least of both, by chi-squared of two degrees."""
    found = grid()
    ratio = 2 * (max(found.log) - max(found.log[0], found.log[4]))
    assert ratio > 0
    assert found.p_exact() == pytest.approx(np.exp(-ratio / 2))


def test_the_chance_of_a_value_is_weighed_over_the_cells():
    """X' (C + r^2)^-1 x is chi-squared in each."""
    found = grid((TWO,))
    beside = RNG.uniform(0.1, 0.6, (C, 2))
    p = 0.0
    for c in range(C):
        x = found.x[c][[0, 3]]
        S = found.cov[c][np.ix_([0, 3], [0, 3])] + np.diag(beside[c] ** 2)
        p += found.weight[c] * stats.chi2.sf(x @ np.linalg.inv(S) @ x, 2)
    assert found.p_value(TWO, beside) == pytest.approx(p)


def alike(a: np.ndarray, b: np.ndarray, of=(0,), other=(1,)) -> bool:
    """Whether columns a and b are one, given two columns of place and one of the tool."""
    rng = np.random.default_rng(8)
    known = rng.normal(size=(20, 3))
    X = np.column_stack([a, b, known])
    zeros = SimpleNamespace(columns=SimpleNamespace(shift=slice(2, 4), tool=slice(4, 5)))
    sums = SimpleNamespace(A=np.stack([X.T @ X, np.eye(5)]))
    return same(
        zeros, sums, SuspectUnknowns("a", of, 1.0), SuspectUnknowns("b", other, 1.0)
    )  # fmt: skip


def test_parameters_are_the_same_if_place_and_tool_make_up_the_difference():
    """In size and sign they may differ; what place and tool explain is the same as nothing."""
    rng = np.random.default_rng(9)
    known = np.random.default_rng(8).normal(size=(20, 3))
    a, b = rng.normal(size=(2, 20))
    mixed = known @ np.array([1.0, -2.0, 0.5])
    assert alike(a, -3 * a + mixed)
    assert alike(a + known[:, 2], 0.1 * a)
    assert not alike(a, b)
    assert not alike(a, a + 0.01 * b)
    assert not alike(mixed, mixed)
    assert not alike(a, mixed)
    assert not alike(mixed, a)
    assert not alike(a, a, of=(0, 1))
    assert not alike(a, a, other=(1, 0))


@pytest.mark.parametrize("name", ["kr500_rail", "ur10"])
def test_usual_weights_are_by_hand(name):
    """Shares of five payloads on the joints that turn; a tool of half a payload at the last."""
    robot = load(name)
    mean, std = usual(robot)
    first = 1 if name == "kr500_rail" else 0
    share = [0.0] * first + [0.3, 0.28, 0.3, 0.05, 0.04, 0.03]
    for k in range(robot.n):
        step = robot.placement[k + 1] if k + 1 < robot.n else robot.flange
        end = step[:3, 3]
        mass = 5 * robot.payload_kg * share[k]
        half = mass * (0.1 + np.linalg.norm(end) / 2)
        tool = np.zeros(4) if k < robot.n - 1 else robot.payload_kg * np.array([0.5, *[0.125] * 3])
        expected = np.sqrt(np.array([mass, half, half, half]) ** 2 + tool**2)
        np.testing.assert_allclose(std[k], np.maximum(expected, 1e-3))
        if first:
            np.testing.assert_allclose(mean[k], [mass, *(0.5 * mass * end)])


def test_a_robot_without_a_payload_is_a_medium_one():
    """Of 200 kg."""
    robot = replace(load("kr500_rail"), payload_kg=None)
    assert usual(robot)[0][:, 0].sum() == pytest.approx(1000)


def shape_of(late: int, poses: int, columns: int) -> ShapeRows:
    """Shape rows of two targets with a step of the first behind some poses."""
    rng = np.random.default_rng(3)
    t = np.zeros((poses, 6, 6))
    t[:, :, :columns] = rng.normal(size=(poses, 6, columns))
    t[:, :, 3:] = rng.normal(size=(poses, 6, 3))
    y = 0.1 * rng.normal(size=(poses, 6)) + (np.arange(poses) >= late)[:, None] * t[:, :, 0]
    flat = t.reshape(-1, 6)
    C = np.linalg.pinv(flat.T @ flat)
    e = y - t @ (C @ flat.T @ y.ravel())
    return ShapeRows(e, t, C, y.size - np.linalg.matrix_rank(flat))


@pytest.mark.parametrize(("late", "columns"), [(2, 3), (8, 3), (5, 1), (5, 2)])
def test_a_step_may_be_as_early_or_late_as_two_poses(late, columns):
    """Its chance is that of an F test with as many columns as the shape has of the target."""
    shape = shape_of(late, 10, columns)
    at, p = slips(shape, np.arange(10), 2)
    share = (np.arange(10) >= late).astype(float)
    own = (share[:, None, None] * shape.t[:, :, :columns]).reshape(-1, columns)
    X = np.hstack([shape.t.reshape(-1, 6), own])
    e = shape.e.ravel()
    left = e - X @ np.linalg.lstsq(X, e, rcond=1e-10)[0]
    dof = shape.dof - columns
    scatter = max(1.0, left @ left / dof)
    F = (e @ e - left @ left) / columns / scatter
    assert at[0] == late
    assert p[0] == pytest.approx(stats.f.sf(F, columns, dof))


def test_no_target_slips_among_three_poses(monkeypatch):
    """Two on either side of a step are four."""
    columns = SimpleNamespace(pose=np.arange(4), time_zero=np.arange(4.0))
    shape = shape_of(2, 4, 3)
    monkeypatch.setattr(ShapeRows, "of", lambda zeros, rows: shape)
    four = SimpleNamespace(pose=np.arange(4), pulls=columns)
    assert [(one.target, one.before) for one in slipped(four, None)] == [(0, (0, 1)), (1, (0, 1))]
    three = SimpleNamespace(pose=np.arange(3), pulls=columns)
    assert slipped(three, None) == {}


def test_poses_read_at_once_have_a_course_by_the_clock():
    """Nothing moves in no time."""
    pulls = SimpleNamespace(pose=np.arange(4), time_zero=np.full(4, 7.0))
    zeros = SimpleNamespace(pose=np.arange(4), pulls=pulls)
    assert not _courses(zeros, np.arange(4)).any()
