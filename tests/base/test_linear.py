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


UNITS = 10.0 ** np.array([3, -4, 0, 2, -1])
"""Units of five parameters, apart by orders of magnitude."""


def test_projected_products_are_inverted_in_their_own_units():
    """Columns after a base is taken out, by numpy's projection; a column of the base adds none."""
    rng = np.random.default_rng(12)
    base, A = rng.normal(size=(30, 3)), rng.normal(size=(30, 5)) * UNITS
    Q = np.linalg.qr(base)[0]
    free = A - Q @ (Q.T @ A)
    whole = np.einsum("mk,mk->k", A, A)
    hidden = A.copy()
    hidden[:, 2] = base @ [1.0, -2.0, 0.5]
    less = hidden - Q @ (Q.T @ hidden)
    squares = np.einsum("mk,mk->k", hidden, hidden)

    found, rank = linear.left(free.T @ free, whole)
    assert found * np.outer(UNITS, UNITS) == pytest.approx(
        np.linalg.inv((free / UNITS).T @ (free / UNITS)), rel=1e-9, abs=1e-12
    )
    assert int(rank) == 5
    both = [free.T @ free, less.T @ less]
    many, ranks = linear.left(np.stack(both), np.stack([whole, squares]))
    assert ranks.tolist() == [5, 4]
    assert many[0] == pytest.approx(found, rel=1e-6)
    rest = np.delete(less / UNITS, 2, axis=1)
    seen = np.delete(np.delete(many[1] * np.outer(UNITS, UNITS), 2, 0), 2, 1)
    assert seen == pytest.approx(np.linalg.inv(rest.T @ rest), rel=1e-6, abs=1e-9)
    assert np.abs(many[1][2] * UNITS[2] * UNITS).max() < 1e-6


def test_ranks_of_many_are_those_of_each():
    """Products of columns of rank 5 to 2, and of nothing, in any units."""
    rng = np.random.default_rng(13)
    rows = [rng.normal(size=(30, r)) @ rng.normal(size=(r, 5)) * UNITS for r in (5, 4, 3, 2)]
    N = np.stack([one.T @ one for one in [*rows, np.zeros((30, 5))]])

    assert linear.ranks(N).tolist() == [linear.rank(one) for one in N] == [5, 4, 3, 2, 0]
    assert linear.ranks(N[:1]).tolist() == [5]
    assert linear.ranks(N.reshape(1, 5, 5, 5)).shape == (1, 5)
    for one, products, r in zip(rows, N, (5, 4, 3, 2), strict=False):
        mixes = linear.determined(products)
        assert mixes.shape == (5, r)
        assert mixes.T @ mixes == pytest.approx(np.eye(r), abs=1e-9)
        lost = np.linalg.svd(one / UNITS)[2][r:].T / UNITS[:, None]
        assert np.abs(mixes.T @ lost / np.linalg.norm(lost, axis=0)).max(initial=0) < 1e-6


def test_a_direction_whose_components_cancel_is_lost_with_each_of_its_parameters():
    """Parameters of which only sums are determined: each by itself is not, whatever the signs."""
    rng = np.random.default_rng(14)
    A = rng.normal(size=(30, 4))
    A[:, 3] = -A[:, 0] + A[:, 1]
    cov = linear.covariance(A.T @ A)

    assert np.isinf(np.diag(cov)).tolist() == [True, True, False, True]
    Q = np.linalg.qr(A[:, [0, 1, 2]])[0]
    alone = A[:, 2] - Q[:, :2] @ (Q[:, :2].T @ A[:, 2])
    assert cov[2, 2] == pytest.approx(1 / (alone @ alone))
    assert linear.inverse(A.T @ A) == pytest.approx(np.linalg.pinv(A.T @ A), abs=0.2)


def test_a_cholesky_factor_solves_and_inverts():
    """As numpy, in any units, for one right side and for several; another matrix has none."""
    rng = np.random.default_rng(15)
    A = rng.normal(size=(30, 5)) * UNITS
    N, y = A.T @ A, rng.normal(size=(5, 2)) * UNITS[:, None]
    found = linear.cholesky(N)
    scaled = np.linalg.inv(N / np.outer(UNITS, UNITS))

    for inverse in (found.inverse, found.root @ found.root.T):
        assert inverse * np.outer(UNITS, UNITS) == pytest.approx(scaled, rel=1e-9, abs=1e-13)
    assert not np.tril(found.root, -1).any()
    expected = scaled @ (y / UNITS[:, None]) / UNITS[:, None]
    np.testing.assert_allclose(found.solve(y), expected, rtol=1e-9)
    np.testing.assert_allclose(found.solve(y[:, 0]), expected[:, 0], rtol=1e-9)
    assert found.log_det == pytest.approx(np.linalg.slogdet(N)[1])
    with pytest.raises(np.linalg.LinAlgError):
        linear.cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))


def test_directions_longer_than_a_length_are_spanned():
    """In absolute terms: of 3, 2 and 0.5 two exceed one; a basis of independent columns is one."""
    rng = np.random.default_rng(17)
    Q = np.linalg.qr(rng.normal(size=(9, 3)))[0]
    P = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = linear.span(Q * [3.0, 2.0, 0.5] @ P, 1.0)

    assert found @ found.T == pytest.approx(Q[:, :2] @ Q[:, :2].T, abs=1e-12)
    basis = linear.independent(Q * [3.0, 2.0, 0.5] @ P)
    assert basis.shape == (9, 3)
    assert basis @ basis.T == pytest.approx(Q @ Q.T, abs=1e-12)


def test_zero_is_told_beside_the_longest_column():
    """Lengths are relative: a billionth of the longest is nothing, a bit more is something."""
    A = np.diag([2.0, 3e-9, 1e-9, 0.0])
    assert linear.nothing(A).tolist() == [False, False, True, True]
    assert linear.nothing(1e12 * A).tolist() == [False, False, True, True]
    N, size = linear.unit(A.T @ A)
    assert np.isinf(size).tolist() == [False, False, True, True]
    assert np.diag(N) == pytest.approx([1, 1, 0, 0])


def test_a_small_rotation_moves_a_lever_by_the_cross_product():
    """By numpy's cross product, and by the rotation itself, for any number of levers."""
    rng = np.random.default_rng(18)
    levers, w = rng.normal(size=(2, 4, 3)), 1e-6 * rng.normal(size=3)
    found = linear.turning(levers) @ w

    np.testing.assert_allclose(found, np.cross(w, levers), rtol=1e-12)
    exact = Rotation.from_rotvec(w).apply(levers.reshape(-1, 3)).reshape(levers.shape) - levers
    np.testing.assert_allclose(found, exact, atol=1e-11)


def test_the_root_mean_square_of_three_and_four():
    """sqrt((9 + 16) / 2), whatever the shape."""
    assert linear.rms(np.array([[3.0], [-4.0]])) == pytest.approx(np.sqrt(12.5))


@pytest.mark.parametrize("found", ["orthonormal", "complement", "span"])
def test_divide_and_conquer_that_does_not_converge_is_replaced(found, monkeypatch):
    """LAPACK's gesdd gives up on some finite matrices; QR iterations span the same space."""
    X = np.random.default_rng(5).standard_normal((7, 4)) @ np.diag([1.0, 1.0, 1.0, 0.0])
    more = {"span": (1e-9,)}.get(found, ())
    due = getattr(linear, found)(X, *more)

    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    got = getattr(linear, found)(X, *more)

    assert got.shape == due.shape
    np.testing.assert_allclose(got @ got.T, due @ due.T, atol=1e-12)
