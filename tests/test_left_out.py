"""Poses left out, and a noise that nobody stated, each against dense algebra."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import dense as whole
from made_system import restricted
from scipy import optimize

from pipeline.base.arrays import Parameter
from pipeline.system.estimate import (
    fits,
    least_squares,
    left_out,
    solve,
    tracker_noise,
)
from pipeline.system.system import Errors, Rows, System
from pipeline.system.whiten import whitener

X = np.array([1.25e-8, 2.6e-7, 2.1e-6])
TYPICAL = np.array([1.3e-8, 3.0e-7, 2.0e-6])
UNITS = np.outer(TYPICAL, TYPICAL)
"""Those of a covariance: approx would take anything below 1e-12 for zero."""


def system(rng, poses=(6, 9, 3, 6), stated=True):
    """Poses of unequal size, own noise per row, one shared zero per pose, two common errors."""
    pose = np.repeat(np.arange(len(poses)) * 3 + 1, poses)
    M = len(pose)
    B = rng.normal(size=(M, 3)) * 3e-3 / TYPICAL
    own = np.diag(rng.uniform(2e-5, 5e-5, M))
    zero = (pose[:, None] == np.unique(pose)).astype(float) * 3e-5
    common = np.column_stack([B @ X * 2e-3, 1e-5 * rng.normal(size=M)])
    G = np.hstack([own, zero, common])
    source = ["tracker"] * M + ["zero"] * len(poses) + ["force_gain", "registration"]
    shared = np.array([name in ("force_gain", "registration") for name in source])
    rows = Rows(pose, np.ones(M, int), np.full(M, "P1", object), np.arange(M) % 3, np.arange(M))
    return System(
        parameters=tuple(Parameter(f"c{k}", "m/N", t, 0.0) for k, t in enumerate(TYPICAL)),
        rows=rows,
        B=B,
        c=B @ X + G @ rng.standard_normal(G.shape[1]),
        errors=Errors(scipy.sparse.csr_array(G), np.array(source, object), shared),
        noise_stated=stated,
    )


def dense(made, keep=slice(None)):
    """x, its covariance and chi2 by the textbook, with V inverted as it stands."""
    V = (made.errors.G @ made.errors.G.T).toarray()[keep][:, keep]
    B, c = made.B[keep] * TYPICAL, made.c[keep]
    W = np.linalg.inv(V)
    cov = np.linalg.inv(B.T @ W @ B)
    x = cov @ B.T @ W @ c
    r = c - B @ x
    return TYPICAL * x, TYPICAL[:, None] * cov * TYPICAL, r @ W @ r


@pytest.fixture
def rng():
    return np.random.default_rng(17)


def of_tracker(made):
    """The same with errors of tracker and zeros alone, per metre of a noise that nobody states."""
    keep = np.isin(made.errors.source, ["tracker", "zero"])
    G = scipy.sparse.csr_array(made.errors.G[:, keep] * 1e5)
    errors = Errors(G, made.errors.source[keep], made.errors.common[keep])
    return replace(made, errors=errors, noise_stated=False)


@pytest.mark.parametrize("loud", [1.0, 30.0])
def test_a_noise_that_nobody_states_is_the_mean_square_of_the_residuals(rng, loud):
    """With nothing but the tracker's errors: s^2 = r'V^-1 r / (M - k)."""
    made = of_tracker(system(rng))
    noisy = replace(made, c=made.B @ X + loud * (made.c - made.B @ X))

    assert tracker_noise(noisy) == pytest.approx(np.sqrt(dense(noisy)[2] / 21), rel=1e-4)


def test_beside_errors_that_are_stated_it_is_where_the_likelihood_is_largest(rng):
    """Stated errors of gain and registration in metres; minimum of the whole likelihood."""
    made = system(rng, stated=False)
    relative = np.where(made.errors.common, 1.0, 1e5)
    G = scipy.sparse.csr_array(made.errors.G @ scipy.sparse.diags_array(relative))
    made = replace(made, errors=replace(made.errors, G=G))

    def loss(log_s):
        V = whole(made, {"tracker": np.exp(log_s), "zero": np.exp(log_s)})
        return restricted(made.B * TYPICAL, made.c, V)

    best = optimize.minimize_scalar(loss, bounds=(-14, -8)).x
    assert tracker_noise(made) == pytest.approx(np.exp(best), rel=1e-3)


def test_exact_data_have_the_least_noise_there_is(rng):
    """Rounding, a picometre: no weight is infinite."""
    made = of_tracker(system(rng))

    assert tracker_noise(replace(made, c=made.B @ X)) == 1e-12


def test_a_relative_noise_takes_its_size_from_the_residuals(rng):
    """chi2 is its own degrees of freedom, and the covariance is that of the mean square."""
    made = system(rng, stated=False)
    _, cov, chi2 = dense(made)
    found = solve(made, TYPICAL)

    assert found.chi2 == pytest.approx(21)
    assert found.cov / UNITS == pytest.approx(cov / UNITS * chi2 / 21, rel=1e-9)
    assert found.residual_std_m == pytest.approx(
        np.sqrt(np.sum((made.c - made.B @ found.value) ** 2) / 21)
    )
    stated = solve(replace(made, found_m=3e-5), TYPICAL)
    assert stated.cov / UNITS == pytest.approx(cov / UNITS, rel=1e-9)


def test_undetermined_values_stay_where_they_start(rng):
    """Of twins the sum is found and the difference is that of the start, in typical sizes."""
    A = rng.standard_normal((20, 3))
    A[:, 1] = A[:, 0] * TYPICAL[0] / TYPICAL[1]
    start = TYPICAL * [3.0, 1.0, 5.0]
    y = A @ (TYPICAL * [2.0, 4.0, 7.0])
    value, cov, chi2, rank = least_squares(A / TYPICAL[2], y / TYPICAL[2], TYPICAL, start)

    assert rank == 2
    assert value / TYPICAL == pytest.approx([4.0, 2.0, 7.0])
    assert chi2 == pytest.approx(0, abs=1e-12)
    assert np.isinf(np.diag(cov)).tolist() == [True, True, False]


def test_twins_cost_one_degree_of_freedom_and_exact_data_no_uncertainty(rng):
    """24 rows, three parameters, two directions; with nothing left over only twins are unknown."""
    made = system(rng, stated=False)
    B = made.B.copy()
    B[:, 1] = B[:, 0] * TYPICAL[0] / TYPICAL[1]
    made = replace(made, B=B)
    still = solve(replace(made, c=0 * made.c), 0 * TYPICAL)

    assert solve(made, TYPICAL).dof == 22
    assert still.std.tolist() == [np.inf, np.inf, 0.0]


@pytest.mark.parametrize(("p", "good"), [(0.0101, True), (0.0099, False)])
def test_a_misfit_is_what_chance_makes_once_in_a_hundred(rng, p, good):
    """Where noise is stated by its p-value, else by what a tracker can scatter."""
    found = solve(system(rng), TYPICAL)

    assert fits(replace(found, p_value=p)) == good
    assert fits(replace(found, p_value=None, residual_std_m=0.99e-4))
    assert not fits(replace(found, p_value=None, residual_std_m=1.01e-4))


def test_left_out_poses_know_neither_units_nor_order(rng):
    """Shuffled rows and a whitener at hand give the same residuals."""
    made = system(rng)
    order = rng.permutation(len(made.rows))
    rows = Rows(**{name: value[order] for name, value in vars(made.rows).items()})
    errors = replace(made.errors, G=made.errors.G[order])
    mixed = replace(made, rows=rows, B=made.B[order], c=made.c[order], errors=errors)

    assert left_out(mixed) == pytest.approx(left_out(made)[order], abs=1e-13)
    white = whitener(made.errors, made.rows.pose)
    assert left_out(made, white) == pytest.approx(left_out(made), abs=1e-15)
