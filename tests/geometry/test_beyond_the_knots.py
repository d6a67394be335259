"""A curve of a joint's error outside the range of its data."""

import numpy as np
import pytest

from pipeline.geometry.random_curve import over


def test_beyond_its_knots_a_curve_has_the_variance_of_its_prior():
    """S = 2e-4 rad: variance 4e-8 rad^2 far outside, none added between the knots."""
    curve = over(2, np.deg2rad([-30.0, 40.0]), False, np.deg2rad(10.0), 2e-4)

    assert curve.beyond(np.deg2rad([-90.0, 0.0, 90.0])) == pytest.approx([4e-8, 0.0, 4e-8])
