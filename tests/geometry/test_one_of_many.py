"""Tests of many readings, and estimates under a condition."""

import numpy as np
import pytest

from pipeline.base import linear
from pipeline.geometry.roughness import ScaleGrid
from pipeline.positions.left_out import _Without
from pipeline.positions.outliers import _Asked
from pipeline.system import alarms


def asked(drop, others):
    """A reading of two directions beside others that fit as they should."""
    rest = np.full((others, 1), 1.4)
    rank = np.full((others + 1, 1), 2)
    return _Asked(np.vstack([[[drop]], rest]), rank, 10_000, None)


def test_a_reading_has_to_be_farther_off_the_more_are_tested():
    """P(chi2_2 > x) = exp(-x / 2): the limit is three times -2 ln(rate / readings)."""
    alone = -6 * np.log(alarms.READING)
    among = -6 * np.log(alarms.READING / 1000)

    for drop, of_one, of_many in ((0.99 * alone, 0, 0), (1.01 * alone, 1, 0), (1.01 * among, 1, 1)):
        assert asked(drop, 0).far(1.0).sum() == of_one
        assert asked(drop, 999).far(1.0).sum() == of_many


def test_a_parameter_is_held_at_its_prior_mean_and_not_at_zero():
    """As if it had been read there without any noise, which moves those correlated with it."""
    rng = np.random.default_rng(4)
    X, mean = rng.standard_normal((9, 4)), np.array([0.5, -1.0, 2.0, 0.3])
    x = mean + 0.3 * rng.standard_normal(4)
    P = X.T @ X
    one = _Without(np.zeros(1, bool), None, linear.cholesky(P), x, mean, ())

    free, held = [0, 3], [1, 2]
    step = np.linalg.lstsq(X[:, free], X @ x - X[:, held] @ mean[held], rcond=None)[0]
    found = one.holding(np.array(held))

    assert found[held] == pytest.approx(mean[held])
    assert found[free] == pytest.approx(step)


def test_an_average_over_cells_scatters_as_draws_from_them():
    """First and second moments of a mixture of two normal distributions, entry by entry."""
    x = np.array([[1.0, -2.0, 0.5], [3.0, -2.0, 0.0]])
    C = np.array([np.diag([0.1, 0.2, 0.3]) + 0.05, np.diag([0.4, 0.1, 0.2]) - 0.02])
    w = np.array([0.3, 0.7])
    blank = {"zeros": None, "free": (), "rough": None, "transmission": None}
    found = ScaleGrid(
        **blank, std=np.ones((2, 3)), width=np.log([0.5, 0.7]), x=x, cov=C,
        log=np.log([0.6, 1.0]) - 40.0,
    )  # fmt: skip

    mean = np.array([0.3 * 1 + 0.7 * 3, -2.0, 0.15])
    assert found.weight == pytest.approx(w)
    assert found.mean == pytest.approx(mean)
    square = sum(p * (V + np.outer(one, one)) for p, V, one in zip(w, C, x, strict=True))
    assert found.covariance == pytest.approx(square - np.outer(mean, mean))
    assert found.covariance[0, 0] == pytest.approx(0.3 * 0.15 + 0.7 * 0.38 + 0.3 * 0.7 * 2.0**2)
