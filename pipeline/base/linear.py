"""Linear algebra with one rank rule, for everything that solves, ranks or weights.

Columns are scaled to comparable units (each parameter by its typical magnitude, rows by standard
uncertainties). A column shorter than `_ROUNDING` times the longest is treated as zero: a joint that
no pull loads moves the targets by rounding only. All others are normalised to unit length, so that
units do not affect what the data determine, and a direction counts if it is longer than `_ROUNDING`
times the longest. Products N = X'X contain squared lengths: there the limit is `PRODUCTS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.linalg import lapack

from pipeline.base.arrays import Array, Bools, Ints

_ROUNDING = 1e-9
"""Relative length of a combination of unit columns that is treated as zero [1]: doubles carry
1e-16, derivatives by differences 1e-10."""

PRODUCTS = 1e-11
"""The corresponding limit in products of unit columns [1]: sums of some thousand squares carry
1e-13."""

ROUNDING_LEFT = 1e-7
"""Squared fraction of a column that remains, due to rounding, if it is a combination of others [1]:
products carry eleven digits, and a base of some tens of columns uses up four."""

_PART = 1e-8
"""Squared fraction of a parameter in undetermined directions from which the parameter itself counts
as undetermined [1]."""

_ROUNDED = 1e-12
"""Fraction of a row's variance that is rounding if hundreds of rows share one error [1]."""

TINY = 1e-300
"""Lower bound of a squared quantity that is a divisor [any]: doubles end at 1e-308."""


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, eq=False)
class _Inverse:
    """The pseudoinverse X+ = half U' of columns X, (M, k); undetermined parameters are zero.

    Attributes:
        U: Orthonormal directions of the rows, shape (M, r).
        half: Change of the parameters with each of them, shape (k, r).
        lost: Parameters with a component in undetermined directions, shape (k,).
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
        """Minimum-norm least-squares solution x = X+ y in unit columns, (k,) or (k, j).

        Columns that the data cannot separate share their contribution equally.
        """
        return np.asarray(self.half @ (self.U.T @ y))

    @property
    def cov(self) -> Array:
        """Covariance (X'X)+ of the solution, infinite variance where lost, shape (k, k)."""
        cov = self.half @ self.half.T
        cov[self.lost, self.lost] = np.inf
        return np.asarray(cov)


def _lengths(X: Array) -> Array:
    """Length of each column of (..., m, k), infinite for a zero one, shape (..., 1, k)."""
    X = np.asarray(X, float)  # squares of integers overflow silently
    square = np.einsum("...mk,...mk->...k", X, X)[..., None, :]
    least = _ROUNDING**2 * square.max(axis=-1, keepdims=True, initial=TINY)
    return np.sqrt(np.where(square > least, square, np.inf))


def orthonormal(X: Array) -> Array:
    """Orthonormal basis Q, (M, r), of the column space of X, (M, k)."""
    U, s, _ = principal(X / _lengths(X), full=False)
    return np.asarray(U[:, s > _ROUNDING * s.max(initial=TINY)])


def independent(X: Array) -> Array:
    """Orthonormal basis, (M, k), of independent columns (M, k): less work than `orthonormal`."""
    return np.asarray(scipy.linalg.qr(X, mode="economic", check_finite=False)[0])


def span(X: Array, least: float) -> Array:
    """Orthonormal basis of the directions in which X exceeds the absolute length `least`."""
    U, s, _ = principal(X, full=False)
    return np.asarray(U[:, s > least])


def spans(X: Array) -> Array:
    """`orthonormal` for many blocks at once, (p, s, k); columns beyond the rank are zero."""
    U, s, _ = np.linalg.svd(X / _lengths(X), full_matrices=False)
    return np.asarray(U * (s > _ROUNDING * s[:, :1])[:, None, :])


def complement(X: Array) -> Array:
    """Orthonormal basis, (M, M - r), of the complement of the column space of X, (M, k)."""
    U, s, _ = principal(X / _lengths(X))
    return np.asarray(U[:, int(np.sum(s > _ROUNDING * s.max(initial=TINY))) :])


def pseudoinverse(X: Array) -> _Inverse:
    """X+ with its rank, by singular values of unit columns."""
    size = _lengths(X)
    U, s, Vt = principal(X / size, full=False)
    rank = int(np.sum(s > _ROUNDING * s.max(initial=TINY)))
    half = Vt[:rank].T / (s[:rank] * size.T)
    lost = 1 - np.einsum("rk,rk->k", Vt[:rank], Vt[:rank]) > _PART
    free = complement(Vt[:rank].T) / np.where(np.isfinite(size), size, 1.0).T
    return _Inverse(U[:, :rank], half, lost, orthonormal(free))


def shortest(X: Array, least: float = _ROUNDING) -> Array:
    """X+ of matrices (..., m, k) in their original units, for which the norm is meaningful."""
    return np.asarray(np.linalg.pinv(X, rcond=least))


def least_squares(X: Array, y: Array) -> Array:
    """Least-squares solution x, (k,) or (k, j), of y = X x; see `pseudoinverse`."""
    return pseudoinverse(X)(y)


def normed(v: Array) -> Array:
    """Vectors v (..., n) at unit length, 0 where they are."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), TINY))


def unit(N: Array) -> tuple[Array, Array]:
    """Products of columns normalised to unit length, (..., k, k), and their lengths, (..., k).

    A column that is treated as zero has infinite length, and products of zero.
    """
    square = np.einsum("...ii->...i", N)
    least = _ROUNDING**2 * np.max(square, axis=-1, keepdims=True, initial=TINY)
    size = np.sqrt(np.where(square > least, square, np.inf))
    return N / (size[..., :, None] * size[..., None, :]), size


def determined(N: Array) -> Array:
    """Orthonormal combinations of parameters, (k, r), that rows with products N determine."""
    scaled, size = unit(N)
    values, vectors = directions(scaled)
    seen = vectors[:, values > PRODUCTS * values.max(initial=TINY)]
    return orthonormal(seen * np.where(np.isfinite(size), size, 0.0)[:, None])


def rank(N: Array) -> int:
    """Number of directions determined by rows with products N, (k, k)."""
    return int(ranks(N))


def ranks(N: Array) -> Ints:
    """The same for many products (..., k, k), shape (...)."""
    scaled, k = unit(N)[0], N.shape[-1]
    if _exceed(scaled, k * PRODUCTS):  # none is larger than k
        return np.full(N.shape[:-2], k)
    values = directions(scaled)[0]
    least = PRODUCTS * values.max(axis=-1, keepdims=True, initial=TINY)
    return np.asarray(np.sum(values > least, axis=-1))


def nothing(X: Array) -> Bools:
    """Columns of (M, k) that are zero relative to the longest, shape (k,)."""
    return np.asarray(np.isinf(_lengths(X))[..., 0, :], dtype=bool)


def _exceed(N: Array, least: float) -> bool:
    """Whether all eigenvalues of all matrices (..., k, k) exceed a limit: ten times as fast."""
    try:
        np.linalg.cholesky(N - least * np.eye(N.shape[-1]))
    except np.linalg.LinAlgError:
        return False
    return True


def directions(N: Array) -> tuple[Array, Array]:
    """Eigenvalues, ascending, and eigenvectors of symmetric matrices (..., k, k)."""
    values, vectors = np.linalg.eigh(N)
    return np.asarray(values), np.asarray(vectors)


def inverse(N: Array, least: float = PRODUCTS) -> Array:
    """Inverse of products (..., k, k); directions without information are left out.

    The inverse of X'X is the covariance of the least-squares solution of unit-variance rows.
    """
    scaled, size = unit(N)
    found = np.linalg.pinv(scaled, rcond=least, hermitian=True)
    return np.asarray(found / (size[..., :, None] * size[..., None, :]))


def regular_inverse(N: Array) -> Array:
    """Inverse of matrices (n, k, k) by the fastest method; NaN for a singular one."""
    try:
        return np.asarray(np.linalg.inv(N))
    except np.linalg.LinAlgError:
        singular: Bools = np.asarray(~np.isfinite(N).all(axis=(-2, -1)))
        regular = ~singular  # NaN has no rank
        singular[regular] = np.linalg.matrix_rank(N[regular], hermitian=True) < N.shape[-1]
        safe = np.where(singular[:, None, None], np.eye(N.shape[-1]), N)
        return np.where(singular[:, None, None], np.nan, np.linalg.inv(safe))


def definite_inverse(N: Array) -> tuple[Array, Array]:
    """Inverse and log det of positive definite N (n, k, k), from one Cholesky factor of each.

    N = U'U, in less than half of the time of an LU decomposition; NaN where N is not definite.
    """
    found, roots = np.empty_like(N), np.full(N.shape[:2], np.nan)
    for k, one in enumerate(N):  # while it is in the processor's cache
        U, failed = lapack.dpotrf(one.T, clean=1)
        if failed:
            found[k] = np.nan
            continue
        roots[k] = U.diagonal()
        half, _ = lapack.dpotri(U, overwrite_c=1)  # its upper triangle; the diagonal counts twice
        np.add(half, half.T, out=found[k])
    np.einsum("nkk->nk", found)[...] *= 0.5
    return found, 2 * np.log(roots).sum(axis=1)


def covariance(N: Array) -> Array:
    """Inverse of products (k, k), with infinite variance for undetermined parameters."""
    scaled, size = unit(N)
    values, vectors = directions(scaled)
    dark = values <= PRODUCTS * values.max(initial=TINY)
    half = vectors[:, ~dark] / np.sqrt(values[~dark]) / size[:, None]
    cov = half @ half.T
    lost = np.sum(vectors[:, dark] ** 2, axis=1) > _PART
    cov[lost, lost] = np.inf
    return np.asarray(cov)


def left(G: Array, whole: Array, least: float = ROUNDING_LEFT) -> tuple[Array, Ints]:
    """Inverse of the products of columns after a base is projected out, (..., k, k), and rank.

    Args:
        G: Products of the projected columns, shape (..., k, k).
        whole: Squared lengths of the columns before projection, shape (..., k).
        least: Squared fraction of a column that is treated as zero: a column that the base explains
            to seven digits belongs to the base.

    Returns:
        The inverse, shape (..., k, k), and its rank, shape (...).
    """
    size = np.sqrt(np.maximum(whole, TINY))
    outer = size[..., :, None] * size[..., None, :]
    scaled = G / outer
    if _exceed(scaled, least):
        return np.linalg.inv(scaled) / outer, np.full(G.shape[:-2], G.shape[-1])
    values, vectors = directions(scaled)
    kept = values > least
    root = vectors * np.where(kept, np.maximum(values, least) ** -0.5, 0.0)[..., None, :]
    return np.asarray(root @ np.swapaxes(root, -1, -2) / outer), kept.sum(axis=-1)


def without(x: Array, cov: Array, at: Ints) -> tuple[Array, Array]:
    """Estimate x (k,) and covariance (k, k) of the others, were those `at` known to be zero."""
    gain = solve(cov[np.ix_(at, at)], cov[at]).T
    cov = np.delete(np.delete(cov - gain @ cov[at], at, 0), at, 1)
    return np.delete(x - gain @ x[at], at), cov


def solve(A: Array, y: Array) -> Array:
    """Solution x of the regular A x = y, shapes (..., k, k) and (..., k) or (..., k, j)."""
    one = y.ndim < A.ndim
    found = np.linalg.solve(A, y[..., None] if one else y)
    return np.asarray(found[..., 0] if one else found)


@dataclass(frozen=True, eq=False)
class Cholesky:
    """Cholesky factors of a positive definite matrix scaled to unit diagonal.

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
    def root(self) -> Array:
        """Upper triangular R with R R' = A^-1."""
        return np.asarray(self.scale[:, None] * lapack.dtrtri(self.lower, lower=1)[0].T)

    @property
    def inverse(self) -> Array:
        """A^-1, from its factor in a third of the time of a solution with a unit matrix."""
        half, _ = lapack.dpotri(self.lower, lower=1)  # zero above the diagonal, as its factor
        whole = half + half.T
        whole[np.diag_indices(len(whole))] *= 0.5
        return np.asarray(whole * self.scale * self.scale[:, None])

    @property
    def log_det(self) -> float:
        """Natural log of det A."""
        return 2 * float(np.log(np.diag(self.lower)).sum() - np.log(self.scale).sum())


def cholesky(A: Array) -> Cholesky:
    """Factor a positive definite matrix (k, k), the fastest method for large ones.

    Raises:
        LinAlgError: It is not positive definite.
    """
    scale = 1 / np.sqrt(np.diag(A))
    rows = (A * scale * scale[:, None]).T  # symmetric, and transposed stored as LAPACK stores it
    lower = scipy.linalg.cholesky(rows, lower=True, overwrite_a=True, check_finite=False)
    return Cholesky(lower, scale)


def whitening(V: Array) -> Array:
    """W with W V W' = 1 for positive definite V, (..., k, k): inverse Cholesky factors.

    If one error is so large that others are lost in its rounding, V is regularised by that
    rounding.

    Raises:
        LinAlgError: A row has no variance.
    """
    try:
        L = np.linalg.cholesky(V)
    except np.linalg.LinAlgError:
        size = np.sqrt(np.einsum("...ii->...i", V))[..., None]
        if not (size > 0).all():
            raise
        unit_rows = V / (size * np.swapaxes(size, -1, -2))
        L = size * np.linalg.cholesky(unit_rows + _ROUNDED * np.eye(V.shape[-1]))
    return np.asarray(np.linalg.inv(L) if L.ndim > 2 else lapack.dtrtri(L, lower=1)[0])


def factor(C: Array) -> Array:
    """Symmetric square root L with L L' = C for positive semidefinite C, shape (..., k, k).

    It is unique: random numbers along its columns do not depend on an order or sign of eigenvectors
    chosen by rounding.
    """
    values, vectors = directions(C)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]
    return np.asarray(root @ np.swapaxes(vectors, -1, -2))


def log_det(N: Array) -> Array:
    """Natural logarithm of det N, shape (...); NaN if the determinant is not positive."""
    sign, log = np.linalg.slogdet(N)
    return np.where(sign > 0, log, np.nan)


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """R, t that minimise the sum of |b - R a - t|^2 (Kabsch 1976), points (n, 3) each."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    R = (U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt).T
    return R, b.mean(axis=0) - R @ a.mean(axis=0)


def moved_onto(a: Array, b: Array) -> Array:
    """The points a after the best rigid motion onto b, (n, 3) each."""
    R, t = rigid(a, b)
    return a @ R.T + t


def principal(X: Array, full: bool = True) -> tuple[Array, Array, Array]:
    """Singular value decomposition U, s, V' of matrices (..., m, k).

    By QR iterations where divide and conquer does not converge for a matrix (m, k).
    """
    try:
        return np.linalg.svd(X, full_matrices=full)
    except np.linalg.LinAlgError:
        if not np.isfinite(X).all():
            raise
        U, s, Vt = scipy.linalg.svd(X, full_matrices=full, lapack_driver="gesvd")
        return U, s, Vt


def extent(points: Array) -> Array:
    """Singular values of a centred set of points (n, 3), the largest first."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), compute_uv=False))


def motions(levers: Array) -> Array:
    """Motion of points by a shift and by a small rotation [rad] about the origin of their levers.

    (..., 3) -> (..., 3, 6).
    """
    turns = turning(levers)
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=-1)


def turning(levers: Array) -> Array:
    """Matrices from a small rotation w [rad] to the shift w x lever, (..., 3, 3) of (..., 3)."""
    x, y, z = np.moveaxis(levers, -1, 0)
    out = np.zeros((*levers.shape, 3))
    out[..., 0, 1], out[..., 1, 2], out[..., 2, 0] = z, x, y
    out[..., 0, 2], out[..., 1, 0], out[..., 2, 1] = -y, -z, -x
    return out
