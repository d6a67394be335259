"""Closest points of chain and links, by bounded least squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pipeline.design.limits import _closest


def test_the_closest_points_of_two_segments_are_on_both():
    """400 pairs of any attitude, also where the lines are closest beyond both ends."""
    rng = np.random.default_rng(8)
    a, b, c, d = rng.standard_normal((4, 3, 400))
    s, t = _closest(a, b, c, d)
    found = np.linalg.norm(a + s * (b - a) - c - t * (d - c), axis=0)

    for k in range(400):
        X = np.column_stack([(b - a)[:, k], (c - d)[:, k]])
        best = lsq_linear(X, (c - a)[:, k], (0, 1), method="bvls")
        assert found[k] == pytest.approx(np.sqrt(2 * best.cost), abs=1e-9)
