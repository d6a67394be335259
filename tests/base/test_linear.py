"""The linear algebra: against numpy's own solvers, and in other units and orders."""

import numpy as np
import pytest
from made_system import rss, twice
from scipy.spatial.transform import Rotation

from pipeline.base import linear
from pipeline.system.elimination import eliminate

RNG = np.random.default_rng(7)
X = RNG.standard_normal((40, 5))
Y = RNG.standard_normal(40)


def test_least_squares_is_numpys():
    """Values, covariance and rank of a regular problem."""
    found = linear.pseudoinverse(X)

    assert np.allclose(linear.least_squares(X, Y), np.linalg.lstsq(X, Y, rcond=None)[0])
    assert np.allclose(found.cov, np.linalg.inv(X.T @ X))
    assert found.rank == 5
    assert not found.lost.any()


@pytest.mark.parametrize("units", [np.ones(6), 10.0 ** np.array([4, -4, 0, 3, -2, 1])])
def test_a_mix_of_columns_is_found_whatever_their_units(units):
    """One direction of three columns is lost; the others keep values, and the fit is numpy's."""
    A = twice(X) * units
    found = linear.pseudoinverse(A)

    assert found.rank == 5
    assert found.lost.tolist() == [True, True, False, False, False, True]
    assert np.isinf(np.diag(found.cov)).tolist() == found.lost.tolist()
    assert found.free.shape == (6, 1)
    assert np.abs(A @ found.free).max() < 1e-12 * np.abs(A).max()
    x = linear.least_squares(A, Y)
    assert np.sum((Y - A @ x) ** 2) == pytest.approx(rss(X, Y))
    assert np.allclose((x * units)[2:5], np.linalg.lstsq(X, Y, rcond=None)[0][2:])


def test_a_column_of_rounding_is_nothing():
    """A joint that no pull loads: its column is rounding of 1e-15, in any unit."""
    A = np.column_stack([X, 1e-15 * RNG.standard_normal(40)])
    found = linear.pseudoinverse(A)

    assert found.rank == 5
    assert found.lost.tolist() == [False] * 5 + [True]
    assert np.abs(found.X[5]).max() == 0
    assert np.abs(found.free[:, 0]) == pytest.approx(np.eye(6)[5])
    assert linear.orthonormal(A).shape == (40, 5)
    assert np.isinf(linear.covariance(A.T @ A)[5, 5])
    assert np.allclose(linear.covariance(A.T @ A)[:5, :5], np.linalg.inv(X.T @ X))


@pytest.mark.parametrize("units", [1.0, 1e5])
def test_what_columns_reach_and_what_they_do_not(units):
    """An orthonormal basis spans the columns, the complement the rest.

    Together, the whole space.
    """
    A = twice(X) * units
    Q, K = linear.orthonormal(A), linear.complement(A)

    assert Q.shape == (40, 5)
    assert K.shape == (40, 35)
    assert np.allclose(Q.T @ Q, np.eye(5))
    assert np.allclose(A - Q @ (Q.T @ A), 0, atol=1e-12 * units)
    assert np.allclose(K.T @ A, 0, atol=1e-12 * units)


def test_batches_are_their_members():
    """Many small problems at once give the same as each alone."""
    N = np.stack([x.T @ x for x in RNG.standard_normal((7, 9, 3))])
    g = RNG.standard_normal((7, 3))

    for k in range(7):
        assert np.allclose(linear.solve(N, g)[k], np.linalg.solve(N[k], g[k]))
        assert np.allclose(linear.inverse(N)[k], np.linalg.inv(N[k]))
    assert np.allclose(linear.log_det(N), np.log(np.linalg.det(N)))


def test_whitened_rows_have_unit_covariance():
    """W V W' = 1, and a factor of V reproduces V, also if V is singular."""
    V = np.cov(RNG.standard_normal((3, 50)))
    W, L = linear.whitening(V), linear.factor(np.diag([4.0, 1.0, 0.0]))

    assert np.allclose(W @ V @ W.T, np.eye(3))
    assert np.allclose(L @ L.T, np.diag([4.0, 1.0, 0.0]))


def test_an_error_that_drowns_the_others_is_weighed_as_the_others_are_not_seen():
    """An error 1e12 times the others, in all rows: orthogonal to it the covariance is unit."""
    shared = RNG.standard_normal(12)
    V = np.eye(12) + 1e24 * np.outer(shared, shared)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(V)
    W = linear.whitening(np.stack([V, np.eye(12)]))

    assert np.isfinite(W).all()
    assert np.linalg.norm(W[0] @ V @ W[0].T, 2) < 2
    assert np.allclose(W[1], np.eye(12))


def test_one_member_that_is_none_spoils_no_other():
    """Singular or NaN: that member is NaN, the others have their inverse."""
    N = np.stack([2 * np.eye(3), np.zeros((3, 3)), np.full((3, 3), np.nan)])
    found = linear.regular_inverse(N)

    assert np.allclose(found[0], np.eye(3) / 2)
    assert np.isnan(found[1:]).all()


def test_a_definite_matrix_has_its_inverse_and_determinant_and_another_has_none():
    """As numpy's, of those that are positive definite; the others are told by NaN."""
    X = np.random.default_rng(4).normal(size=(4, 30, 9))
    good = np.swapaxes(X, 1, 2) @ X
    turned, missing = good[1] - 50.0 * np.eye(9), np.where(np.eye(9) > 0, np.nan, good[2])
    inverse, log_det = linear.definite_inverse(np.stack([good[0], turned, good[2], missing]))

    for k in (0, 2):
        assert inverse[k] == pytest.approx(np.linalg.inv(good[k]), rel=1e-12, abs=1e-14)
        assert (inverse[k] == inverse[k].T).all()
        assert log_det[k] == pytest.approx(np.log(np.linalg.eigvalsh(good[k])).sum(), rel=1e-12)
    assert np.isnan(inverse[[1, 3]]).all()
    assert np.isnan(log_det[[1, 3]]).all()


def test_a_rigid_motion_is_found_again():
    """Also for points in one plane, where a reflection would fit equally well."""
    a = RNG.standard_normal((6, 3)) * [1, 1, 0]
    R, t = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix(), np.array([1.0, -2.0, 3.0])
    found, shift = linear.rigid(a, a @ R.T + t)

    assert np.allclose(found, R)
    assert np.allclose(shift, t)


APART = np.sqrt(0.5)
"""A unit column and one at a small angle d to it differ, as a combination of unit length, by d
sqrt(1/2)."""


def alike(angle):
    """Two orthonormal columns, the second turned to within an angle of the first [rad]."""
    Q = np.linalg.qr(RNG.standard_normal((40, 2)))[0]
    return np.column_stack([Q[:, 0], np.cos(angle) * Q[:, 0] + np.sin(angle) * Q[:, 1]])


@pytest.mark.parametrize(("times", "rank"), [(0.4, 1), (4.0, 2)])
def test_near_twins_part_where_the_rule_says(times, rank):
    """Just within each limit they count as one direction, just beyond it as two."""
    long = np.sqrt(2.0)  # the longest combination of two columns that are alike
    rows = alike(times * 1e-9 * long / APART)
    assert linear.pseudoinverse(rows).rank == linear.orthonormal(rows).shape[1] == rank
    assert linear.complement(rows).shape[1] == 40 - rank

    products = alike(np.sqrt(times * 1e-11) * long / APART)
    cov = linear.covariance(products.T @ products)
    assert np.isfinite(np.diag(cov)).all() == (rank == 2)

    part = alike(np.sqrt(times * 1e-7))
    S = eliminate(part.T @ part, np.array([0]))
    assert linear.left(S[1:, 1:], np.ones(1))[1] == rank - 1


def test_what_is_taken_out_of_an_estimate_leaves_that_of_the_others():
    """Two of seven columns known to be zero: numpy's solution and covariance of the other five."""
    rng = np.random.default_rng(3)
    X, y = rng.normal(size=(20, 7)), rng.normal(size=20)
    whole = linear.left(X.T @ X, np.ones(7))[0]

    x, cov = linear.without(whole @ X.T @ y, whole, np.array([1, 4]))

    rest = np.delete(X, [1, 4], axis=1)
    assert np.allclose(x, np.linalg.lstsq(rest, y)[0], rtol=1e-10)
    assert np.allclose(cov, np.linalg.inv(rest.T @ rest), rtol=1e-10)


def test_where_length_has_a_meaning_the_solution_is_the_shortest():
    """Of shifts along all axes that fit equally well, the shortest, in metres."""
    seen = np.array([1.0, 1e-3, 0.2])
    N = 4e8 * np.outer(seen, seen)
    shift = linear.shortest(N) @ (N @ np.array([0.0, 0.0, 1e-3]))

    assert np.allclose(shift, 2e-4 * seen / (seen @ seen))


def test_volumes_lengths_and_axes_are_numpys():
    """As the restricted likelihood and the registration use them."""
    assert np.isnan(linear.log_det(np.diag([1.0, -1.0, 2.0])))
    points = RNG.standard_normal((9, 3)) + 100.0
    assert linear.extent(points) ** 2 == pytest.approx(
        8 * np.linalg.eigvalsh(np.cov(points.T))[::-1]
    )
    blocks = linear.spans(np.stack([twice(X)[:, :3], twice(X)[:, [0, 1, 5]]]))
    assert np.sum(blocks**2, axis=(1, 2)) == pytest.approx([3, 2])


def test_points_beside_their_plane_are_turned_not_mirrored():
    """With noise that a reflection would fit better, the result is still a rotation."""
    a = RNG.standard_normal((4, 3)) * [1, 1, 1e-3]
    R, _ = linear.rigid(a, a * [1, 1, -1])

    assert np.linalg.det(R) == pytest.approx(1)
    assert pytest.approx(np.eye(3)) == R @ R.T


@pytest.mark.parametrize("rank", [4, 2])
def test_the_factor_of_a_covariance_follows_no_direction_that_rounding_chose(rank):
    """With degenerate eigenvalues the eigenvectors are arbitrary.

    Draws along the factor do not change.
    """
    Q = np.linalg.qr(RNG.standard_normal((6, 6)))[0]
    C = Q @ np.diag([3.0] * rank + [0.0] * (6 - rank)) @ Q.T
    off = RNG.standard_normal((20, 6, 6))
    found = linear.factor(C + 1e-13 * (off + np.swapaxes(off, 1, 2)))

    assert np.allclose(found @ np.swapaxes(found, 1, 2), C, atol=1e-11)
    assert np.ptp(found, axis=0).max() < 1e-5
