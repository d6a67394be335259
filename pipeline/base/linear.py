"""Linear algebra with one rank rule, for everything that solves, ranks or weights.

Columns are brought to unit length before anything is called rounding, so that no unit of a
parameter decides what the data determine. A direction counts when it is longer than `ROUNDING`
times the longest. Products N = X'X hold the squares of lengths: there the limit is `PRODUCTS`.
"""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Ints

ROUNDING = 1e-9
"""Length of a mix of unit columns, over the longest, that is rounding [1]: doubles carry 1e-16,
derivatives by differences 1e-10."""

PRODUCTS = 1e-11
"""The same in products of unit columns [1]: sums of some thousand squares carry 1e-13."""

_TINY = 1e-300


def lengths(X: Array) -> Array:
    """Length of each column, at least the smallest that can be divided by, shape (k,)."""
    return np.maximum(np.linalg.norm(X, axis=0), _TINY)


def orthonormal(X: Array, least: float = ROUNDING) -> Array:
    """Orthonormal columns Q, (M, r), that span the columns of X, (M, k).

    Args:
        X: Columns of any length; those of length zero span nothing.
        least: Part of the longest mix of unit columns below which a mix is rounding.
    """
    norm = np.linalg.norm(X, axis=0)
    X = X[:, norm > 0] / norm[norm > 0]
    if not X.size:
        return np.zeros((len(X), 0))
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return np.asarray(U[:, s > least * s[0]])


def span(X: Array, least: float) -> Array:
    """Orthonormal columns that span what columns reach beyond the absolute length `least`."""
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return np.asarray(U[:, s > least])


def complement(X: Array) -> Array:
    """Orthonormal columns, (M, M - r), that no mix of the columns of X, (M, k), reaches."""
    U, s, _ = np.linalg.svd(X, full_matrices=True)
    return np.asarray(U[:, int(np.sum(s > ROUNDING * s.max(initial=_TINY))) :])


def pseudoinverse(X: Array) -> tuple[Array, int]:
    """X+ with x = X+ y the shortest least-squares solution in unit columns, (k, M), and the rank.

    Columns that cannot be separated share the coefficient equally.
    """
    size = lengths(X)
    U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
    kept = s > ROUNDING * s.max(initial=_TINY)
    return (Vt[kept].T / s[kept]) @ U[:, kept].T / size[:, None], int(kept.sum())


def least_squares(X: Array, y: Array) -> Array:
    """The x, (k,) or (k, j), for which |y - X x| is smallest; see `pseudoinverse`."""
    return np.asarray(pseudoinverse(X)[0] @ y)


def unit(N: Array) -> tuple[Array, Array]:
    """Products of columns brought to unit length, (..., k, k), and their lengths, (..., k)."""
    size = np.sqrt(np.maximum(np.einsum("...ii->...i", N), _TINY))
    return N / (size[..., :, None] * size[..., None, :]), size


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


def drop(N: Array, g: Array) -> tuple[Array, Array]:
    """How much r'r falls when columns D join the residual r: g'N+g, (...), and their sizes N+g.

    Args:
        N: Products D'D of the columns, what is fitted along taken out, shape (..., k, k).
        g: D'r, shape (..., k).
    """
    size = np.einsum("...ij,...j->...i", inverse(N), g)
    return np.einsum("...i,...i->...", size, g), size


def solve(A: Array, y: Array) -> Array:
    """X of the regular A x = y, shapes (..., k, k) and (..., k) or (..., k, j)."""
    one = y.ndim < A.ndim
    found = np.linalg.solve(A, y[..., None] if one else y)
    return np.asarray(found[..., 0] if one else found)


def whitening(V: Array) -> Array:
    """W with W V W' = 1 for positive definite V, (..., k, k): inverse Cholesky factors.

    Raises:
        LinAlgError: A covariance has no scatter in some direction.
    """
    return np.asarray(np.linalg.inv(np.linalg.cholesky(V)))


def factor(C: Array) -> Array:
    """L with L L' = C for positive semidefinite C, shape (..., k, k); rank may be less than k."""
    values, vectors = directions(C)
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :])


def log_det(N: Array) -> Array:
    """Ln det N, shape (...); NaN where the determinant is not positive."""
    sign, log = np.linalg.slogdet(N)
    return np.where(sign > 0, log, np.nan)


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """R, t for which the sum of |b - R a - t|^2 is smallest (Kabsch 1976), points (n, 3) each."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = (U @ flip @ Vt).T
    return R, b.mean(axis=0) - R @ a.mean(axis=0)


def extent(points: Array) -> Array:
    """Lengths of the three main axes of a set of points (n, 3), the longest first."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), compute_uv=False))


def numbered(key: Array) -> tuple[Ints, Ints, Ints]:
    """Index of each row's block, place of each row in its block, and rows per block."""
    _, index = np.unique(key, return_inverse=True)
    count = np.bincount(index)
    order = np.argsort(index, kind="stable")
    place = np.empty(len(index), dtype=np.int64)
    place[order] = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return index, place, count
