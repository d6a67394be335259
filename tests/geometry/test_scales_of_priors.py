"""An estimated scale of a prior is uncertain, and so is what the prior holds near zero."""

import numpy as np
import pytest

from pipeline.positions.estimate import Posterior, Prior, of_scales


def estimated(N, b, scale):
    """A spring with a wide prior, two elements of one group with the given scale, a third alone."""
    std = np.array([1e4, scale, 2 * scale, 0.7])
    none = np.zeros(0, dtype=bool)
    known = Prior(np.zeros(4), std, none, none, np.full(4, 1e4), (slice(1, 3),), (np.nan, np.nan))
    cov = np.linalg.inv(N + np.diag(std**-2.0))
    return known, Posterior(cov @ b, cov, 0.0)


def test_an_estimate_moves_with_the_scale_as_stated():
    """Against a difference of estimates; the variance of the scale is that of its likelihood."""
    rng = np.random.default_rng(3)
    X = rng.standard_normal((30, 4))
    N, b = X.T @ X, X.T @ rng.standard_normal(30)
    known, found = estimated(N, b, 0.2)
    h = 1e-5
    moved = (estimated(N, b, 0.2 * np.exp(h))[1].x - estimated(N, b, 0.2 * np.exp(-h))[1].x) / 2 / h
    V = np.linalg.inv(N + np.diag([1e-8, 0.0, 0.0, 0.7**-2]))[1:3, 1:3]
    seen = np.linalg.solve(V + np.diag(known.std[1:3] ** 2), np.diag(known.std[1:3] ** 2))

    expected = np.outer(moved, moved) / (2 * np.trace(seen @ seen) + 1.4**-2)
    assert of_scales(known, found) == pytest.approx(expected, rel=1e-6, abs=1e-12)
