"""Linear algebra with one rank rule, for everything that solves, ranks or weights.

Columns come in units in which they compare (each parameter in its typical size, rows in standard
uncertainties). A column that is shorter than `_ROUNDING` times the longest is nothing: a joint that
no pull loads moves the targets by rounding. All others are brought to unit length, so that no unit
decides what the data determine, and a direction counts where it is longer than `_ROUNDING` times
the longest. Products N = X'X hold the squares of lengths: there the limit is `PRODUCTS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pipeline.base.arrays import Array, Bools, Ints

_ROUNDING = 1e-9
"""Length of a mix of unit columns, over the longest, that is rounding [1]: doubles carry 1e-16,
derivatives by differences 1e-10."""

PRODUCTS = 1e-11
"""The same in products of unit columns [1]: sums of some thousand squares carry 1e-13."""

LEFT = 1e-7
"""Squared part of a column that is left of it when it is a mix of others [1]: products carry eleven
digits, and a base of some tens of columns uses up four."""

_PART = 1e-8
"""Squared part of a parameter in directions that nothing determines, from which it is one of
them [1]."""

_ROUNDED = 1e-12
"""Part of a row's variance that is rounding where hundreds of rows share one error [1]."""

TINY = 1e-300
"""What a square, divided by, is at least [any]: doubles end at 1e-308."""


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, eq=False)
class _Inverse:
    """The pseudoinverse X+ = half U' of columns X, (M, k); undetermined parameters are zero.

    Attributes:
        U: Orthonormal directions of the rows, shape (M, r).
        half: What each of them moves in the parameters, shape (k, r).
        lost: Parameters with a part in directions that nothing determines, shape (k,).
        free: These directions, orthonormal, shape (k, k - r).
    """

    U: Array
    half: Array
    lost: Bools
    free: Array

    @property
    def rank(self) -> int:
        """Number of directions that the rows determine."""
        return self.U.shape[1]

    @property
    def X(self) -> Array:
        """The pseudoinverse itself, shape (k, M)."""
        return np.asarray(self.half @ self.U.T)

    def __call__(self, y: Array) -> Array:
        """The shortest least-squares solution x = X+ y in unit columns, (k,) or (k, j).

        Columns that nothing tells apart share what is theirs equally.
        """
        return np.asarray(self.half @ (self.U.T @ y))

    @property
    def cov(self) -> Array:
        """Covariance (X'X)+ of the solution, infinite variance where lost, shape (k, k)."""
        cov = self.half @ self.half.T
        cov[self.lost, self.lost] = np.inf
        return np.asarray(cov)


def _lengths(X: Array) -> Array:
    """Length of each column of (..., m, k), infinite for one that is nothing, shape (..., 1, k)."""
    X = np.asarray(X, float)  # squares of integers overflow without a word
    square = np.einsum("...mk,...mk->...k", X, X)[..., None, :]
    least = _ROUNDING**2 * square.max(axis=-1, keepdims=True, initial=TINY)
    return np.sqrt(np.where(square > least, square, np.inf))


def orthonormal(X: Array, least: float = _ROUNDING) -> Array:
    """Orthonormal columns Q, (M, r), that span the columns of X, (M, k).

    Args:
        X: Columns.
        least: Part of the longest mix of unit columns below which a mix is rounding.
    """
    U, s, _ = np.linalg.svd(X / _lengths(X), full_matrices=False)
    return np.asarray(U[:, s > least * s.max(initial=TINY)])


def span(X: Array, least: float) -> Array:
    """Orthonormal columns that span what columns reach beyond the absolute length `least`."""
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return np.asarray(U[:, s > least])


def spans(X: Array) -> Array:
    """`orthonormal` for many blocks at once, (p, s, k): columns that are rounding are zero."""
    U, s, _ = np.linalg.svd(X / _lengths(X), full_matrices=False)
    return np.asarray(U * (s > _ROUNDING * s[:, :1])[:, None, :])


def complement(X: Array) -> Array:
    """Orthonormal columns, (M, M - r), that no mix of the columns of X, (M, k), reaches."""
    U, s, _ = np.linalg.svd(X / _lengths(X), full_matrices=True)
    return np.asarray(U[:, int(np.sum(s > _ROUNDING * s.max(initial=TINY))) :])


def pseudoinverse(X: Array) -> _Inverse:
    """X+ with its rank, by singular values of unit columns."""
    size = _lengths(X)
    U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
    rank = int(np.sum(s > _ROUNDING * s.max(initial=TINY)))
    half = Vt[:rank].T / (s[:rank] * size.T)
    lost = 1 - np.einsum("rk,rk->k", Vt[:rank], Vt[:rank]) > _PART
    free = complement(Vt[:rank].T) / np.where(np.isfinite(size), size, 1.0).T
    return _Inverse(U[:, :rank], half, lost, orthonormal(free))


def shortest(X: Array, least: float = _ROUNDING) -> Array:
    """X+ of matrices (..., m, k) in the units they come in: where length has a meaning."""
    return np.asarray(np.linalg.pinv(X, rcond=least))


def least_squares(X: Array, y: Array) -> Array:
    """The x, (k,) or (k, j), for which |y - X x| is smallest; see `pseudoinverse`."""
    return pseudoinverse(X)(y)


def unit(N: Array) -> tuple[Array, Array]:
    """Products of columns brought to unit length, (..., k, k), and their lengths, (..., k).

    A column that is nothing has infinite length, and products of zero.
    """
    square = np.einsum("...ii->...i", N)
    least = _ROUNDING**2 * np.max(square, axis=-1, keepdims=True, initial=TINY)
    size = np.sqrt(np.where(square > least, square, np.inf))
    return N / (size[..., :, None] * size[..., None, :]), size


def determined(N: Array) -> Array:
    """Orthonormal mixes of parameters, (k, r), that rows with products N, (k, k), determine."""
    scaled, size = unit(N)
    values, vectors = directions(scaled)
    seen = vectors[:, values > PRODUCTS * values.max(initial=TINY)]
    return orthonormal(seen * np.where(np.isfinite(size), size, 0.0)[:, None])


def rank(N: Array) -> int:
    """Number of directions that rows with products N, (k, k), determine."""
    return int(np.sum(directions(unit(N)[0])[0] > PRODUCTS))


def nothing(X: Array) -> Bools:
    """Columns of (M, k) that are nothing beside the longest, shape (k,)."""
    return np.asarray(np.isinf(_lengths(X))[..., 0, :], dtype=bool)


def directions(N: Array) -> tuple[Array, Array]:
    """Squared lengths, ascending, and directions of symmetric matrices (..., k, k)."""
    values, vectors = np.linalg.eigh(N)
    return np.asarray(values), np.asarray(vectors)


def inverse(N: Array, least: float = PRODUCTS) -> Array:
    """Inverse of products (..., k, k), where they have one; directions that are rounding are left.

    The inverse of X'X is the covariance of the least-squares solution of unit-variance rows.
    """
    scaled, size = unit(N)
    found = np.linalg.pinv(scaled, rcond=least, hermitian=True)
    return np.asarray(found / (size[..., :, None] * size[..., None, :]))


def regular_inverse(N: Array) -> Array:
    """Inverse of matrices (n, k, k), the fastest; NaN for one that is singular."""
    try:
        return np.asarray(np.linalg.inv(N))
    except np.linalg.LinAlgError:
        singular: Bools = np.asarray(~np.isfinite(N).all(axis=(-2, -1)))
        regular = ~singular  # NaN has no rank
        singular[regular] = np.linalg.matrix_rank(N[regular], hermitian=True) < N.shape[-1]
        safe = np.where(singular[:, None, None], np.eye(N.shape[-1]), N)
        return np.where(singular[:, None, None], np.nan, np.linalg.inv(safe))


def covariance(N: Array) -> Array:
    """Inverse of products (k, k), variances infinite where a parameter has a part in rounding."""
    scaled, size = unit(N)
    values, vectors = directions(scaled)
    dark = values <= PRODUCTS * values.max(initial=TINY)
    half = vectors[:, ~dark] / np.sqrt(values[~dark]) / size[:, None]
    cov = half @ half.T
    lost = np.sum(vectors[:, dark] ** 2, axis=1) > _PART
    cov[lost, lost] = np.inf
    return np.asarray(cov)


def left(G: Array, whole: Array, least: float = LEFT) -> tuple[Array, Ints]:
    """Inverse of what is left of columns beside a base, (..., k, k), and its rank, (...).

    Args:
        G: Products of what is left, shape (..., k, k).
        whole: Squared lengths of the columns before the base was taken out, shape (..., k).
        least: Squared part of a whole column that is none: what the base explains to seven digits
            is the base.
    """
    size = np.sqrt(np.maximum(whole, TINY))
    outer = size[..., :, None] * size[..., None, :]
    values, vectors = directions(G / outer)
    kept = values > least
    root = vectors * np.where(kept, np.maximum(values, least) ** -0.5, 0.0)[..., None, :]
    return np.asarray(root @ np.swapaxes(root, -1, -2) / outer), kept.sum(axis=-1)


def solve(A: Array, y: Array) -> Array:
    """Solution x of the regular A x = y, shapes (..., k, k) and (..., k) or (..., k, j)."""
    one = y.ndim < A.ndim
    found = np.linalg.solve(A, y[..., None] if one else y)
    return np.asarray(found[..., 0] if one else found)


@dataclass(frozen=True, eq=False)
class Cholesky:
    """Factors of a positive definite matrix whose diagonal was brought to one.

    Attributes:
        lower: L with L L' = S A S, shape (k, k).
        scale: Diagonal of S, shape (k,).
    """

    lower: Array
    scale: Array

    def solve(self, y: Array) -> Array:
        """A^-1 y, y (k,) or (k, j)."""
        scale = self.scale if y.ndim == 1 else self.scale[:, None]
        found = scipy.linalg.cho_solve((self.lower, True), scale * y, check_finite=False)
        return np.asarray(scale * found)

    @property
    def log_det(self) -> float:
        """Natural log of det A."""
        return 2 * float(np.log(np.diag(self.lower)).sum() - np.log(self.scale).sum())


def cholesky(A: Array) -> Cholesky:
    """Factors of a positive definite matrix (k, k), the fastest for large ones.

    Raises:
        LinAlgError: It is not positive definite.
    """
    scale = 1 / np.sqrt(np.diag(A))
    lower = scipy.linalg.cholesky(A * scale * scale[:, None], lower=True, check_finite=False)
    return Cholesky(lower, scale)


def whitening(V: Array) -> Array:
    """W with W V W' = 1 for positive definite V, (..., k, k): inverse Cholesky factors.

    Where one error is so large that the others are below its rounding, they count as that.

    Raises:
        LinAlgError: A row has no scatter at all.
    """
    try:
        L = np.linalg.cholesky(V)
    except np.linalg.LinAlgError:
        size = np.sqrt(np.einsum("...ii->...i", V))[..., None]
        if not (size > 0).all():
            raise
        unit_rows = V / (size * np.swapaxes(size, -1, -2))
        L = size * np.linalg.cholesky(unit_rows + _ROUNDED * np.eye(V.shape[-1]))
    return np.asarray(np.linalg.inv(L))


def factor(C: Array) -> Array:
    """The symmetric L with L L' = C for positive semidefinite C, shape (..., k, k).

    There is one of its kind: what is drawn along its columns follows no order or sign of directions
    that rounding chose.
    """
    values, vectors = directions(C)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]
    return np.asarray(root @ np.swapaxes(vectors, -1, -2))


def log_det(N: Array) -> Array:
    """Natural log of det N, shape (...); NaN where the determinant is not positive."""
    sign, log = np.linalg.slogdet(N)
    return np.where(sign > 0, log, np.nan)


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """R, t for which the sum of |b - R a - t|^2 is smallest (Kabsch 1976), points (n, 3) each."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = (U @ flip @ Vt).T
    return R, b.mean(axis=0) - R @ a.mean(axis=0)


def principal(X: Array) -> tuple[Array, Array, Array]:
    """U, s, V' of matrices (..., m, k): the directions that a map stretches most, and how much."""
    U, s, Vt = np.linalg.svd(X)
    return np.asarray(U), np.asarray(s), np.asarray(Vt)


def extent(points: Array) -> Array:
    """Lengths of the three main axes of a set of points (n, 3), the longest first."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), compute_uv=False))


def turning(levers: Array) -> Array:
    """Matrices that take a small turn w [rad] to the shift w x lever, (..., 3, 3) of (..., 3)."""
    x, y, z = np.moveaxis(levers, -1, 0)
    out = np.zeros((*levers.shape, 3))
    out[..., 0, 1], out[..., 1, 2], out[..., 2, 0] = z, x, y
    out[..., 0, 2], out[..., 1, 0], out[..., 2, 1] = -y, -z, -x
    return out
