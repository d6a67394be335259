"""The scatter of readings about a model: factors of covariances, likelihood and gradient."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pipeline.positions.laws import Inputs
from pipeline.positions.mechanism import Linear
from pipeline.positions.outliers import _columns
from pipeline.positions.scatter import PoseScatter, _Likelihood, triangular

POSES, JOINTS = 40, 4


@pytest.fixture
def rows() -> Linear:
    """Two targets, the second without orientation, and one pose without its first target."""
    rng = np.random.default_rng(3)
    read = np.ones((POSES, 12), dtype=bool)
    read[:, 9:], read[5, :6] = False, False
    Z = np.where(read[..., None], rng.normal(size=(POSES, 12, JOINTS)), 0.0)
    none = np.zeros(POSES)
    inputs = Inputs(np.zeros((POSES, JOINTS)), np.zeros((POSES, JOINTS)), none, none, none)
    return Linear(np.zeros((POSES, 12)), lambda: (Z, Z), read, inputs, np.zeros((POSES, 2, 3)))


def errors(rows: Linear, s: np.ndarray) -> np.ndarray:
    """Errors of the rows drawn from joints and noise, each pose by itself."""
    rng = np.random.default_rng(8)
    noise = np.tile(np.repeat(s[-2:], 3), 2) * rng.normal(size=rows.read.shape)
    joints = rows.Z @ (s[:-2] * rng.normal(size=(POSES, JOINTS)))[..., None]
    return np.where(rows.read, joints[..., 0] + noise, 0.0)[:, rows.used]


def by_density(rows: Linear, e: np.ndarray, s: np.ndarray) -> float:
    """The negative log density of the errors, from a library and over the rows read only."""
    total = 0.0
    for k, read in enumerate(rows.read):
        Z = rows.Z[k, read]
        noise = np.tile(np.repeat(s[-2:], 3), 2)[read]
        V = Z @ np.diag(s[:-2] ** 2) @ Z.T + np.diag(noise**2)
        mine = np.zeros(12)
        mine[rows.used] = e[k]
        total -= stats.multivariate_normal(cov=V).logpdf(mine[read])
        total -= 0.5 * read.sum() * np.log(2 * np.pi)
    return total


def test_the_likelihood_is_the_density_of_the_errors(rows):
    """The likelihood is that of a library, and its gradient the slope of that by differences."""
    s = np.array([0.5, 1.5, 0.1, 0.8, 0.3, 0.7])
    e = errors(rows, s)
    of = _Likelihood(rows, e[:, :, None] * e[:, None, :], JOINTS)
    logs, step = 2 * np.log(s), 1e-5 * np.eye(6)
    slopes = [
        (by_density(rows, e, np.exp((logs + h) / 2)) - by_density(rows, e, np.exp((logs - h) / 2)))
        / 2e-5
        for h in step
    ]

    value, slope = of(logs)

    assert value == pytest.approx(by_density(rows, e, s), rel=1e-10)
    assert slope == pytest.approx(slopes, rel=1e-6, abs=1e-6)


def test_factors_whiten_the_errors_of_each_pose(rows):
    """W V W' = 1 and L W = 1, for the covariance of each pose."""
    scatter = PoseScatter(np.array([0.5, 1.5, 0.1, 0.8]), 0.3, 0.7)
    L, W = scatter.factors(rows)
    Z = rows.Z[:, rows.used]
    V = Z @ np.diag(scatter.joints**2) @ np.swapaxes(Z, 1, 2)
    noise = np.where(rows.used % 6 >= 3, 0.7, 0.3) ** 2
    V = V + np.eye(len(rows.used)) * np.where(rows.read[:, rows.used], noise, 1.0)[:, None]

    assert pytest.approx(np.tile(np.eye(9), (POSES, 1, 1)), abs=1e-12) == W @ V @ W.swapaxes(1, 2)
    assert pytest.approx(np.tile(np.eye(9), (POSES, 1, 1)), abs=1e-12) == L @ W


def test_a_singular_covariance_is_regularised_and_an_empty_one_refused():
    """A variance lost in the rounding of a larger one does not end the estimate; none at all does.

    Planted bug: without the fallback the root of a negative number is NaN.
    """
    a = np.array([[1.0], [1.0 / 3], [2.0 / 7]])
    V = (a @ a.T)[:, :, None].repeat(2, axis=2)
    L, W = triangular(V)

    assert np.isfinite(W).all()
    assert np.einsum("ikm,jkm->ijm", L, L) == pytest.approx(V, rel=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="no variance"):
        triangular(np.zeros((2, 2, 1)))


@pytest.mark.parametrize("six", [(True, False), (False, False), (True, True)])
def test_a_bad_reading_moves_its_own_coordinates_and_no_other(rows, six):
    """By one metre or radian along each that was read; a rotation only where one is."""
    at = np.ravel([[True] * 3 + [one] * 3 for one in six])
    rows = replace(rows, read=rows.read & at)
    _, W = PoseScatter(np.array([0.5, 1.5, 0.1, 0.8]), 0.3, 0.7).factors(rows)

    D = _columns(W, rows, np.array(six))

    assert D.shape == (POSES, len(rows.used), 2, 6 if any(six) else 3)
    for pose, target, axis in np.ndindex(POSES, 2, D.shape[3]):
        unit = (rows.used == 6 * target + axis) * rows.read[pose, rows.used]
        assert D[pose, :, target, axis] == pytest.approx(W[pose] @ unit, abs=1e-12)


def test_many_small_factors_are_those_of_each():
    """L L' = V and L W = 1 along the last axis, also where one error drowns the others."""
    half = np.random.default_rng(16).normal(size=(6, 4, 4))
    V = half @ half.swapaxes(1, 2)
    L, W = (np.moveaxis(one, -1, 0) for one in triangular(np.moveaxis(V, 0, -1)))

    np.testing.assert_allclose(L, np.linalg.cholesky(V), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(W @ L, np.broadcast_to(np.eye(4), V.shape), atol=1e-9)
    drowned = np.eye(3) + 1e24
    L, W = triangular(np.stack([drowned, np.eye(3)], axis=-1))
    assert np.isfinite(W).all()
    np.testing.assert_allclose(W[..., 1], np.eye(3), atol=1e-11)
    with pytest.raises(np.linalg.LinAlgError, match="no variance"):
        triangular(np.zeros((2, 2, 1)))
    with pytest.raises(np.linalg.LinAlgError, match="no variance"):
        triangular(np.stack([np.eye(2), np.diag([1.0, 0.0])], axis=-1))
