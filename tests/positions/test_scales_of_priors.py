"""An estimated scale of a prior is uncertain, and so is what the prior holds near zero."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.positions import estimate
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import Prior, ReadRows, _solve, by_a_factor, of_scales


def estimated(N, b, scale):
    """A spring with a wide prior, two elements of one group with the given scale, a third alone."""
    std = np.array([1e4, scale, 2 * scale, 0.7])
    none = np.zeros(0, dtype=bool)
    known = Prior(
        np.zeros(4), std, none, none, np.full(4, 1e4), {"": slice(1, 3)}, (np.nan, np.nan)
    )
    return known, _solve(N, b, 0.0, (np.diag(std**-2.0), 0.0), np.zeros(4), 0)


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


def read(rng):
    """Readings of four parameters, and an estimate from them."""
    X = rng.standard_normal((30, 4))
    known, found = estimated(X.T @ X, X.T @ rng.standard_normal(30), 0.2)
    return X, known, found


def test_scales_move_no_common_factor_of_masses():
    """It is uncertain by itself; a scale that took it along made targets uncertain by 0.8 mm."""
    _, known, found = read(np.random.default_rng(7))
    v = np.array([3.0, -2.0, 4.0, 5.0])
    loose = replace(found, root=np.column_stack([found.root, v]))

    cov = Calibration.cov.func(SimpleNamespace(solution=loose, by_readings=found, known=known))

    expected = found.cov + np.outer(v, v) + of_scales(known, found)
    assert cov - np.outer(v, v) == pytest.approx(expected - np.outer(v, v), abs=1e-9)


@pytest.mark.parametrize("hung", [False, True])
def test_a_common_factor_of_masses_moves_no_target_that_was_read(monkeypatch, hung):
    """Where something does not fall with the masses, all else puts the targets back.

    Under a known payload it does move them, and is known from there.
    """
    X, _, found = read(np.random.default_rng(8))
    X[:, 3] = X[:, 0]  # softer by one, heavier by the other
    known = replace(found, root=_solve(X.T @ X, np.zeros(4), 0.0, (1e-6 * np.eye(4), 0.0),
                                       np.zeros(4), 0).root)  # fmt: skip
    v = np.array([1.0, 0.0, 0.05, -1.0])
    monkeypatch.setattr(estimate, "softened", lambda _: v)

    one = by_a_factor(SimpleNamespace(N=X.T @ X), None, known, hung).root[:, -1]

    held = 1 / np.sqrt(hung * v @ X.T @ X @ v + 1.1**-2)
    assert one[[0, 3]] == pytest.approx(held * v[[0, 3]], abs=0.05)
    assert bool(np.linalg.norm(X @ one) < 1e-4 * np.linalg.norm(X @ v)) is not hung


def test_knots_eliminated_first_leave_the_estimate_as_it_is():
    """Estimate, covariance and evidence of all parameters at once, as of dense matrices."""
    rng = np.random.default_rng(4)
    m, r, dense, knots = 20, 3, 4, 6
    at = np.stack([np.arange(m) % 3, np.arange(m) % 3 + 1, np.full(m, 4), np.full(m, 5)], axis=1)
    D, K, y = rng.normal(size=(m, r, dense)), rng.normal(size=(m, r, 4)), rng.normal(size=(m, r))
    rows = ReadRows(D, K, at, knots, y, *np.tile(np.eye(r), (2, m, 1, 1)))
    X = np.zeros((m, r, dense + knots))
    X[..., :dense] = D
    np.put_along_axis(X, np.broadcast_to(dense + at[:, None], K.shape), K, axis=2)
    flat, mean = X.reshape(m * r, -1), rng.normal(size=dense + knots)
    V = np.diag(rng.uniform(0.5, 2.0, dense + knots))
    V[dense:, dense:] += 0.3
    prior_of = np.linalg.inv(V), -np.linalg.slogdet(V)[1]
    C = np.linalg.inv(flat.T @ flat + prior_of[0])
    off = y.ravel() - flat @ mean
    whole = flat @ V @ flat.T + np.eye(m * r)

    found = _solve(rows.N, rows.b, float(np.sum(y**2)), prior_of, mean, knots)

    assert found.x == pytest.approx(mean + C @ flat.T @ off)
    assert found.cov == pytest.approx(C)
    assert found.var == pytest.approx(np.diag(C))
    for part in (slice(3), slice(5, 8), slice(dense, None), slice(2, 7)):
        assert found.of(part) == pytest.approx(C[part, part])
    assert rows.variance(found) == pytest.approx(X @ C @ np.swapaxes(X, 1, 2))
    density = off @ np.linalg.solve(whole, off) + np.linalg.slogdet(whole)[1]
    assert found.evidence == pytest.approx(-0.5 * density)


def test_a_product_with_a_triangle_is_that_of_all_its_entries():
    """Columns beyond the triangle are multiplied, too, and nothing below it is read."""
    rng = np.random.default_rng(21)
    X, R = rng.normal(size=(7, 4)), rng.normal(size=(4, 6))
    upper = np.hstack([np.triu(R[:, :4]), R[:, 4:]])

    assert estimate.by_upper(X, R) == pytest.approx(X @ upper)
    assert estimate.by_upper(X, R[:, :4]) == pytest.approx(X @ upper[:, :4])
