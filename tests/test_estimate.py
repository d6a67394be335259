"""The estimate against textbook formulas on dense matrices, and its promises when data are poor."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import dense as whole
from made_system import restricted
from scipy import optimize, stats

from pipeline.base.arrays import Parameter
from pipeline.system.estimate import (
    fits,
    identifiable,
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


def test_whitening_is_the_inverse_root_of_the_whole_covariance(rng):
    """W V W' = I with shared zeros and errors common to all poses."""
    made = system(rng)
    V = (made.errors.G @ made.errors.G.T).toarray()
    white = whitener(made.errors, made.rows.pose)

    assert np.abs(white(white(V).T) - np.eye(len(V))).max() < 1e-12


def test_rows_of_a_pose_need_not_be_neighbours(rng):
    """Shuffled rows give the same estimate."""
    made = system(rng)
    order = rng.permutation(len(made.rows))
    rows = Rows(
        *(getattr(made.rows, f)[order] for f in ("pose", "repeat", "target", "axis", "pull"))
    )
    errors = replace(made.errors, G=made.errors.G[order])
    mixed = replace(made, rows=rows, B=made.B[order], c=made.c[order], errors=errors)

    assert solve(mixed, X).value == pytest.approx(solve(made, X).value, rel=1e-10)


def test_the_estimate_is_generalised_least_squares(rng):
    """Value, covariance and chi2 are those of the textbook on dense matrices."""
    made = system(rng)
    x, cov, chi2 = dense(made)
    found = solve(made, TYPICAL)

    assert found.value == pytest.approx(x, rel=1e-9)
    assert found.cov / UNITS == pytest.approx(cov / UNITS, rel=1e-9)
    assert found.chi2 == pytest.approx(chi2, rel=1e-9)
    assert found.dof == 24 - 3
    assert found.p_value == pytest.approx(stats.chi2.sf(chi2, 21))


def test_left_out_poses_are_estimated_without_themselves(rng):
    """The closed form equals refitting on the other poses with the textbook."""
    made = system(rng)
    ours = left_out(made)

    for pose in np.unique(made.rows.pose):
        out = made.rows.pose == pose
        x, *_ = dense(made, ~out)
        assert ours[out] == pytest.approx(made.c[out] - made.B[out] @ x, abs=1e-12)


def test_what_only_one_pose_determines_cannot_be_predicted_there(rng):
    """A parameter that moves one pose only: that pose has no left-out residual, the others have."""
    made = system(rng)
    B = made.B.copy()
    alone = made.rows.pose == made.rows.pose[0]
    B[~alone, 2] = 0.0

    left = left_out(replace(made, B=B))

    assert np.isnan(left[alone]).all()
    assert np.isfinite(left[~alone]).all()


def test_noise_that_is_not_stated_comes_from_the_residuals(rng):
    """Doubling every error column changes nothing; intervals are Student's."""
    made = system(rng, stated=False)
    louder = replace(made, errors=replace(made.errors, G=made.errors.G * 2))
    one, two = solve(made, TYPICAL), solve(louder, TYPICAL)

    assert one.std == pytest.approx(two.std, rel=1e-9)
    assert one.p_value is None
    assert one.noise_from == "residuals"
    assert one.quantile == pytest.approx(stats.t.ppf(0.975, 21))


def test_a_column_of_rounding_noise_is_not_identifiable_and_spoils_nothing(rng):
    """The others keep their values; the dark one has no finite uncertainty."""
    made = system(rng)
    B = made.B.copy()
    B[:, 1] = rng.normal(size=len(B)) * 1e-16 / TYPICAL[1]
    two = replace(made, B=B[:, [0, 2]], parameters=(made.parameters[0], made.parameters[2]))
    found, alone = solve(replace(made, B=B), TYPICAL), solve(two, TYPICAL[[0, 2]])

    assert found.identifiable.tolist() == [True, False, True]
    assert np.isinf(found.std[1])
    assert found.value[[0, 2]] == pytest.approx(alone.value, rel=1e-9)
    assert found.std[[0, 2]] == pytest.approx(alone.std, rel=1e-9)


def test_fewer_rows_than_unknowns_determine_nothing(rng):
    """Two rows for three unknowns: no value is called identifiable."""
    found = solve(system(rng, poses=(2,)), TYPICAL)

    assert not found.identifiable.any()


def test_twins_are_not_identifiable_and_the_rest_is_given(rng):
    """Two equal columns: neither has a value of its own, the third has."""
    made = system(rng)
    B = made.B.copy()
    B[:, 1] = B[:, 0] * TYPICAL[0] / TYPICAL[1]
    found = solve(replace(made, B=B), TYPICAL)

    assert found.identifiable.tolist() == [False, False, True]


def test_weak_data_are_said_to_be_weak(rng):
    """An unknown whose typical size moves the data by less than a sigma is not identifiable."""
    made = system(rng)
    B = made.B.copy()
    B[:, 0] *= 1e-3
    found = solve(replace(made, B=B, c=made.c + (B - made.B) @ X), TYPICAL)

    assert found.identifiable.tolist() == [False, True, True]
    assert np.isfinite(found.std).all()


def test_a_large_estimate_of_what_hardly_shows_is_scatter():
    """2.6 sigmas are enough at twice the typical size, not where one sigma is nine of them."""
    typical = np.ones(4)

    told = identifiable(typical, np.array([0.1, 2.6, 23.4, 45.0]), np.array([0.4, 1.0, 9.0, 9.0]))

    assert told.tolist() == [True, True, False, True]


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
