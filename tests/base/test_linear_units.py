"""Linear algebra that does not depend on units."""

import numpy as np
import pytest

from pipeline.base.linear import cholesky


@pytest.mark.parametrize("units", [(1.0, 1.0), (10.0, 1e-3)])
def test_a_determinant_is_that_of_the_matrix_in_its_own_units(units):
    """Det [[4, 2], [2, 3]] = 8, times the square of every unit."""
    A = np.outer(units, units) * np.array([[4.0, 2.0], [2.0, 3.0]])

    assert cholesky(A).log_det == pytest.approx(np.log(8.0) + 2 * np.log(units).sum())


def test_a_factor_is_that_of_a_matrix_with_unit_diagonal():
    """Variances of 4 and 9 with a covariance of 3: a correlation of one half."""
    found = cholesky(np.array([[4.0, 3.0], [3.0, 9.0]]))
    np.testing.assert_allclose(found.scale, [1 / 2, 1 / 3])
    np.testing.assert_allclose(np.tril(found.lower), [[1, 0], [0.5, np.sqrt(0.75)]])
