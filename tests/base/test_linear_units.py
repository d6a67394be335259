"""Linear algebra that does not depend on units."""

import numpy as np
import pytest

from pipeline.base.linear import cholesky


@pytest.mark.parametrize("units", [(1.0, 1.0), (10.0, 1e-3)])
def test_a_determinant_is_that_of_the_matrix_in_its_own_units(units):
    """Det [[4, 2], [2, 3]] = 8, times the square of every unit."""
    A = np.outer(units, units) * np.array([[4.0, 2.0], [2.0, 3.0]])

    assert cholesky(A).log_det == pytest.approx(np.log(8.0) + 2 * np.log(units).sum())
