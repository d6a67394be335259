"""Sums of squares after some columns are eliminated: the algebra of every test."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints


def coefficients(M: Array, base: Ints) -> Array:
    """Least-squares coefficients of the last column on the base, shape (..., b).

    b = N^+ g with N = M[base, base], g = M[base, last]; the pseudo-inverse is taken of N scaled to
    a unit diagonal.

    Columns that cannot be separated share the coefficient equally.
    """
    inverse = linear.inverse(M[..., base[:, None], base])
    return np.asarray(np.einsum("...ij,...j->...i", inverse, M[..., base, -1]))


def eliminate(M: Array, base: Ints) -> Array:
    """Products of all columns after the base is eliminated: the Schur complement.

    S = M - M[:, base] M[base, base]^+ M[base, :]. With M = A'A that is A' P A, where P projects
    onto what is orthogonal to the base's columns of A; S[last, last] is the residual sum of
    squares.

    Args:
        M: Products, shape (..., W, W).
        base: Columns to eliminate.

    Returns:
        Shape (..., W, W); rows and columns of the base are zero up to rounding.
    """
    scaled, size = linear.unit(M[..., base[:, None], base])
    values, vectors = linear.directions(scaled)
    kept = values > linear.PRODUCTS
    inverse = np.where(kept, 1 / np.where(kept, values, 1), 0)
    half = np.swapaxes(vectors, -1, -2) @ (M[..., base, :] / size[..., :, None])
    return np.asarray(M - np.swapaxes(half, -1, -2) @ (inverse[..., :, None] * half))
