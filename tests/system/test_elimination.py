"""Columns taken out of products, against fits of numpy's, and rows by their blocks."""

import numpy as np
import pytest
from made_system import rss, twice

from pipeline.base import linear
from pipeline.system.blocks import Blocks
from pipeline.system.elimination import coefficients, eliminate
from pipeline.system.score_tests import left_beside

RNG = np.random.default_rng(7)
X = RNG.standard_normal((40, 5))
Y = RNG.standard_normal(40)


@pytest.mark.parametrize("scale", [1.0, 1e-4, 1e6])
def test_elimination_is_the_fit_beside_a_base(scale):
    """The Schur complement gives the sum of squares of the fit, in any unit of its columns."""
    A = np.column_stack([twice(X) * scale ** (np.arange(6) / 5), Y])
    M, base = A.T @ A, np.arange(6)
    found = coefficients(M, base)

    assert eliminate(M, base)[-1, -1] == pytest.approx(rss(X, Y), rel=1e-6)
    assert np.sum((Y - A[:, :6] @ found) ** 2) == pytest.approx(rss(X, Y), rel=1e-6)


def test_what_the_base_explains_to_seven_digits_is_the_base():
    """Of two columns, one nearly a combination of the base: one direction remains, not two."""
    A = np.column_stack([X, X[:, 0] + 1e-5 * RNG.standard_normal(40), RNG.standard_normal(40), Y])
    M = A.T @ A
    S = eliminate(M, np.arange(5))
    inverse, rank = linear.left(S[5:7, 5:7], np.diag(M)[5:7])

    assert rank == 1
    drop = S[5:7, -1] @ inverse @ S[5:7, -1]
    assert drop == pytest.approx(rss(X, Y) - rss(A[:, [0, 1, 2, 3, 4, 6]], Y), rel=1e-6)


def test_rows_are_numbered_within_their_block_in_any_order():
    """Rows of a block need not be adjacent."""
    blocks = Blocks.of(np.array([30, 10, 30, 20, 10, 30]))

    assert blocks.index.tolist() == [2, 0, 2, 1, 0, 2]
    assert blocks.place.tolist() == [0, 0, 1, 0, 1, 2]
    assert blocks.count.tolist() == [2, 1, 3]
    assert blocks.there.tolist() == [[True, True, False], [True, False, False], [True] * 3]
    assert blocks.rows(blocks.padded(np.arange(6))).tolist() == list(range(6))


def test_suspects_are_what_a_base_leaves_of_their_columns_and_as_long_as_they_were():
    """Two suspects, one of two columns: products of residuals, and lengths before the fit."""
    A = np.column_stack([X, RNG.standard_normal((40, 3)) + X[:, :3]])
    at = np.array([[5, -1], [6, 7]])
    left = A - X @ np.linalg.lstsq(X, A, rcond=None)[0]

    S, N, long = left_beside(A.T @ A, np.arange(5), at)

    assert np.allclose(S[5:, 5:], left[:, 5:].T @ left[:, 5:])
    assert np.allclose(N[0], [[left[:, 5] @ left[:, 5], 0], [0, 0]])
    assert np.allclose(N[1], left[:, 6:].T @ left[:, 6:])
    assert np.allclose(long, [[A[:, 5] @ A[:, 5], 0], [A[:, 6] @ A[:, 6], A[:, 7] @ A[:, 7]]])
