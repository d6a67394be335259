"""Sums of squares after some columns are estimated: the algebra of every test."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Ints

_CUT = 1e-11
"""Relative size of an eigenvalue of products of scaled columns that is rounding."""

NULL = 1e-7
"""What is left of a column relative to the whole column when it is a mix of others."""


def coefficients(M: Array, base: Ints) -> Array:
    """Least-squares coefficients of the last column by the base, shape (..., b).

    b = N^+ g with N = M[base, base], g = M[base, last]; the pseudo-inverse is taken of N scaled to
    a unit diagonal.

    Columns that cannot be separated share the coefficient equally.
    """
    scaled, size = _scaled(M, base)
    inverse = np.linalg.pinv(scaled, rcond=_CUT, hermitian=True)
    found = np.einsum("...ij,...j->...i", inverse, M[..., base, -1] / size) / size
    return np.asarray(found)


def eliminate(M: Array, base: Ints) -> Array:
    """Products of all columns after the base is taken out of them: the Schur complement.

    S = M - M[:, base] M[base, base]^+ M[base, :]. With M = A'A that is A' P A, where P projects
    onto what is orthogonal to the base's columns of A; S[last, last] is the sum of squares left.

    Args:
        M: Products, shape (..., W, W).
        base: Columns that are estimated along.

    Returns:
        Shape (..., W, W); rows and columns of the base are zero but for rounding.
    """
    scaled, size = _scaled(M, base)
    values, vectors = np.linalg.eigh(scaled)
    kept = values > _CUT
    inverse = np.where(kept, 1 / np.where(kept, values, 1), 0)
    side = M[..., base, :] / size[..., :, None]
    half = np.swapaxes(vectors, -1, -2) @ side
    return np.asarray(M - np.swapaxes(half, -1, -2) @ (inverse[..., :, None] * half))


def _scaled(M: Array, base: Ints) -> tuple[Array, Array]:
    """Products of the base's columns, each of length one, shape (..., b, b); their lengths."""
    N = M[..., base[:, None], base]
    size = np.sqrt(np.maximum(np.einsum("...ii->...i", N), 1e-300))
    return N / (size[..., :, None] * size[..., None, :]), size
