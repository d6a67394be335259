"""The scatter of readings about a model: factors of covariances, likelihood and gradient."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from pipeline.positions import scatter as module
from pipeline.positions.estimate import Posterior, ReadRows, unwhitened
from pipeline.positions.laws import Inputs
from pipeline.positions.mechanism import Linear
from pipeline.positions.outliers import _columns
from pipeline.positions.scatter import (
    PoseScatter,
    _Likelihood,
    likeliest_variances,
    triangular,
)

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
    return Linear(
        np.zeros((POSES, 12)),
        lambda used: (Z[:, used], Z[:, used]),
        read,
        inputs,
        np.zeros((POSES, 2, 3)),
    )


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

    here = of(s**2)

    assert here.value == pytest.approx(by_density(rows, e, s), rel=1e-10)
    assert here.slope * s**2 == pytest.approx(slopes, rel=1e-6, abs=1e-6)


def test_the_information_is_the_variance_of_the_gradient(rows):
    """With errors of the covariance itself the gradient vanishes and its slope is F."""
    s = np.array([0.5, 1.5, 0.1, 0.8, 0.3, 0.7])
    W = PoseScatter(s[:4], *s[4:]).factors(rows)[1]
    V = np.linalg.inv(np.swapaxes(W, 1, 2) @ W)
    of, step = _Likelihood(rows, V, JOINTS), 1e-4 * np.eye(6) * s**2

    F = [
        (of(s**2 + h).slope - of(s**2 - h).slope) / 2e-4 / v
        for h, v in zip(step, s**2, strict=True)
    ]

    assert of(s**2).slope * s**2 == pytest.approx(np.zeros(6), abs=1e-9)
    np.testing.assert_allclose(of(s**2).information, F, rtol=1e-4)


@pytest.mark.parametrize("s", [(0.5, 1.5, 0.1, 0.8, 0.3, 0.7), (0.0, 0.0, 0.0, 0.8, 0.3, 0.7)])
def test_the_likeliest_variances_are_those_of_a_search_from_many_starts(rows, s):
    """In a few steps and from far below and far above, also where variances end at zero.

    Planted bug: without the bound a vanishing variance goes below zero, and a factor fails.
    """
    e = errors(rows, 1e-2 * np.array(s))
    of, count = _Likelihood(rows, e[:, :, None] * e[:, None, :], JOINTS), [0]

    def counted(v):
        count[0] += 1
        return of(v)

    def by_logs(x):
        here = of(np.exp(x))
        return here.value, here.slope * np.exp(x)

    least = min(
        optimize.minimize(by_logs, x, jac=True, method="L-BFGS-B", bounds=[(-36, -4)] * 6).fun
        for x in np.random.default_rng(5).uniform(-20, -5, (4, 6))
    )
    for start in (1e-11, 1e-2):
        count[0] = 0
        v, gain = likeliest_variances(counted, np.full(6, start), np.ones(6, dtype=bool))

        assert count[0] <= 8
        assert of(v).value == pytest.approx(least, abs=2e-3)
        assert of(np.full(6, start)).value - gain == pytest.approx(least, abs=2e-2)


def test_a_search_that_is_cut_off_ends_where_the_likelihood_was_last_asked(rows, monkeypatch):
    """It gains what it says. Planted bug: the last step was taken once more, at any loss."""
    e = errors(rows, 1e-2 * np.array([0.5, 1.5, 0.1, 0.8, 0.3, 0.7]))
    of, begun = _Likelihood(rows, e[:, :, None] * e[:, None, :], JOINTS), np.full(6, 1e-11)
    monkeypatch.setattr(module, "_STEPS", 1)

    v, gain = likeliest_variances(of, begun, np.ones(6, dtype=bool))

    assert of(begun).value - of(v).value == pytest.approx(gain)


def test_variances_of_which_the_readings_say_nothing_stay_as_they_are(rows):
    """Joints that move no reading; least squares without unknowns would end the interpreter."""
    flat, free = np.zeros((POSES, 12, JOINTS)), np.arange(6) < JOINTS
    rows = replace(rows, slopes=lambda used: (flat[:, used], flat[:, used]))
    e = errors(rows, 1e-2 * np.array([0.5, 1.5, 0.1, 0.8, 0.3, 0.7]))
    of, begun = _Likelihood(rows, e[:, :, None] * e[:, None, :], JOINTS), np.full(6, 1e-4)

    v, gain = likeliest_variances(of, begun, free)

    assert v == pytest.approx(begun)
    assert gain == 0


def test_stated_noise_is_left_as_it_is(rows):
    """What is not free keeps its value, whatever the residuals."""
    e = errors(rows, 1e-2 * np.array([0.5, 1.5, 0.1, 0.8, 0.3, 0.7]))
    scatter = PoseScatter(np.full(4, 0.01), 2e-4, 1e-3, stated=True)

    found, _ = scatter.better(rows, e[:, :, None] * e[:, None, :])

    assert found.position == 2e-4
    assert found.rotation > 5e-3


@pytest.mark.parametrize("between", [0.06, 0.0])
def test_a_balanced_layout_has_its_variances_in_closed_form(between):
    """One mean over groups of three: REML is the analysis of variance, and zero where it is less.

    n^2 = SSW / (m (r - 1)) and r s^2 + n^2 = SSB / (m - 1), or both pooled over m r - 1 degrees of
    freedom (Searle, Casella and McCulloch, Variance Components, 1992, 4.3).
    """
    m, r = 12, 3
    rng = np.random.default_rng(2 if between else 4)
    y = 4.0 + between * rng.normal(size=(m, 1)) + 0.02 * rng.normal(size=(m, r))
    read, one = np.tile(np.arange(6) < r, (m, 1)), np.ones((m, r, 1))
    none = np.zeros(m)
    inputs = Inputs(none[:, None], none[:, None], none, none, none)
    flat = np.zeros((m, 6))
    about = Linear(flat, lambda _: (one, one), read, inputs, np.zeros((m, 1, 3)))
    scatter = PoseScatter(np.array([0.01]), 0.01, 0.1)
    for _ in range(60):
        L, W = scatter.factors(about)
        D, b = W @ one, np.einsum("mij,mj->mi", W, y)
        root = np.array([[np.sum(D**2) ** -0.5]])
        x = root[0] ** 2 * np.sum(D[..., 0] * b)
        known = Posterior(x, root, np.zeros((0, 0)), 0.0)
        at = np.zeros((m, 0), dtype=int)
        here = ReadRows(D, np.zeros((m, r, 0)), at, 0, b, W, L)
        left = here.y - here.along(known.x)
        products = unwhitened(here, left, here.variance(known))
        scatter, _ = scatter.better(about, products)

    middle = y.mean(axis=1)
    within = np.sum((y - middle[:, None]) ** 2)
    beyond = r * np.sum((middle - y.mean()) ** 2)
    noise, group = within / (m * (r - 1)), beyond / (m - 1)
    if group < noise:
        noise = group = (within + beyond) / (m * r - 1)
    assert (group > noise) == (between > 0)
    assert scatter.position**2 == pytest.approx(noise, rel=1e-3)
    assert scatter.joints[0] ** 2 == pytest.approx((group - noise) / r, rel=1e-2, abs=1e-9)


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
        assert D[pose, :, target, axis] == pytest.approx(W[pose] @ unit, abs=1e-9)


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
