"""Which orders of waves the values of a joint can resolve."""

import numpy as np
import pytest

from pipeline.positions.law_tests import _shortest


@pytest.mark.parametrize("count", [1, 2, 21])
def test_equal_distances_resolve_two_values_per_period(count):
    q = np.repeat(np.linspace(-1.0, 1.0, count), 3)

    assert _shortest(q) == pytest.approx(np.pi * (count - 1) / 2, rel=1e-2)


def test_unequal_distances_resolve_shorter_waves_than_equal_ones():
    """Gaps of values drawn at random: their median is ln 2 of their mean."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, 400)

    assert _shortest(q) == pytest.approx(np.pi * 399 / 2 / np.log(2), rel=0.15)
