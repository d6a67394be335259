"""Criteria of a plan: figures against draws of estimates and numpy's algebra."""

import numpy as np
import pytest
from scipy import stats

from pipeline.design import criteria


@pytest.fixture(scope="module")
def M():
    """Information of three plans about four compliances."""
    A = np.random.default_rng(1).normal(size=(3, 9, 4)) * np.array([1.0, 3.0, 0.5, 10.0])
    return A.swapaxes(1, 2) @ A


def draws(M, count, rng):
    """Errors of estimates whose covariance is the inverse of the information."""
    return rng.multivariate_normal(np.zeros(len(M)), np.linalg.inv(M), size=count)


def test_the_prediction_errs_as_draws_of_the_estimates_say(M):
    """Root mean square length over places by their weights, 40 000 draws: to a hundredth."""
    rng = np.random.default_rng(2)
    places, weights = rng.normal(size=(3, 3, 4)), np.array([1.0, 2.0, 5.0])
    criterion = criteria.prediction(places, weights, "workspace")

    found = criterion.figure(M)

    for one, plan in zip(found, M, strict=True):
        moved = np.einsum("pia,da->dpi", places, draws(plan, 40_000, rng))
        square = np.mean(np.sum(moved**2, axis=2), axis=0) @ weights / weights.sum()
        assert one == pytest.approx(np.sqrt(square), rel=0.015)
    assert (criterion.name, criterion.unit) == ("workspace", "m")


def test_the_average_errs_as_draws_of_the_estimates_say(M):
    """Root mean square of all relative errors; by compliance their own."""
    rng = np.random.default_rng(3)
    found, each = criteria.CLASSIC["A"].figure(M), criteria.relative_std(M)

    for one, std, plan in zip(found, each, M, strict=True):
        error = draws(plan, 40_000, rng)
        assert one == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.015)
        np.testing.assert_allclose(std, error.std(axis=0), rtol=0.02)


def test_the_ellipsoid_has_the_semi_axes_of_numpy(M):
    """Their geometric mean for D, the largest for E."""
    for k, plan in enumerate(M):
        axes = np.sqrt(np.linalg.eigvals(np.linalg.inv(plan)).real)
        assert criteria.CLASSIC["D"].figure(M)[k] == pytest.approx(stats.gmean(axes))
        assert criteria.CLASSIC["E"].figure(M)[k] == pytest.approx(axes.max())


@pytest.mark.parametrize(
    "criterion", [criteria.CLASSIC["A"], criteria.CLASSIC["D"], criteria.CLASSIC["E"]]
)
def test_twice_the_pulls_are_worth_a_root_of_two(M, criterion):
    """Every figure is an uncertainty."""
    np.testing.assert_allclose(criterion.figure(2 * M), criterion.figure(M) / np.sqrt(2))


def test_a_plan_that_leaves_a_mix_open_is_no_plan(M):
    """No figure and no finite uncertainty, together with others that have both."""
    flat = M.copy()
    flat[1] = np.diag([1.0, 1.0, 1.0, 0.0])

    with np.errstate(all="ignore"):
        for criterion in (criteria.CLASSIC["A"], criteria.CLASSIC["D"], criteria.CLASSIC["E"]):
            figures = criterion.figure(flat)
            assert np.isnan(figures[1]) | np.isinf(figures[1])
            np.testing.assert_allclose(figures[[0, 2]], criterion.figure(M)[[0, 2]])
        stds = criteria.relative_std(flat)
    assert np.isinf(stds[1]).all()
    np.testing.assert_allclose(stds[[0, 2]], criteria.relative_std(M)[[0, 2]])


def test_the_smooth_stand_in_is_close_above_the_smallest_eigenvalue(M):
    """Power mean of order 24 of four: at most 4^(1/24) too large, and equal if all are equal."""
    smooth, S = criteria.CLASSIC["E"].smooth(M)
    least = np.linalg.eigvalsh(M)[:, 0]

    assert (np.exp(smooth) >= least * (1 - 1e-12)).all()
    assert (np.exp(smooth) <= least * 4 ** (1 / 24) * (1 + 1e-12)).all()
    assert np.exp(criteria.CLASSIC["E"].smooth(7.0 * np.eye(4)[None])[0][0]) == pytest.approx(7.0)
    np.testing.assert_allclose(np.einsum("kij,kij->k", S, M), 1.0)
    turn = np.random.default_rng(4).normal(size=M.shape)
    turn = turn + turn.swapaxes(1, 2)
    h = 1e-5
    ahead, behind = (criteria.CLASSIC["E"].smooth(M + s * turn)[0] for s in (h, -h))
    np.testing.assert_allclose(np.sum(S * turn, axis=(1, 2)), (ahead - behind) / (2 * h), rtol=1e-4)


def test_a_support_touches_where_it_was_taken(M):
    """Z of the smooth criteria is tight at M; that of E has trace one."""
    for criterion in (criteria.CLASSIC["A"], criteria.CLASSIC["D"]):
        Z = criterion.support(M)
        np.testing.assert_allclose(np.sum(Z * M, axis=(1, 2)), np.exp(criterion.score(M)[0]))
    Z = criteria.CLASSIC["E"].support(M)
    np.testing.assert_allclose(np.einsum("kii->k", Z), 1.0)
    assert (np.linalg.eigvalsh(Z) > -1e-12).all()
