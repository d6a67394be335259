"""The mean of a target's readings in two faces."""

import numpy as np
import pytest

from pipeline.dialects._export import _face_mean


def test_the_mean_of_two_readings_has_half_their_variance():
    """Variances 2 and 4 um^2: (2 + 4) / 4 = 1.5 um^2; the second reading stays as it is."""
    position = np.array([[1.0, 0.0, 0.0], [1.002, 0.0, 0.0]])
    covariance = np.outer([2e-12, 4e-12], [1.0, 0, 0, 1, 0, 1])
    found, cov = _face_mean(position, covariance, np.array([[0, 1]]))

    assert found[0] == pytest.approx([1.001, 0.0, 0.0])
    assert cov[0] == pytest.approx(1.5e-12 * np.array([1.0, 0, 0, 1, 0, 1]))
    assert cov[1] == pytest.approx(covariance[1])
