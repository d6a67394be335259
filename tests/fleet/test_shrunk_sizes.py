"""Sizes of causes learnt from few robots."""

import math

import pytest

from pipeline.fleet.experience import _expected_size


@pytest.mark.parametrize(("robots", "size"), [(2, 1.0), (4, 1.6158), (16, 1.8660)])
def test_a_size_of_few_robots_stays_close_to_the_typical_one(robots, size):
    """All twice as large: 2^(n / (n + (0.8 / 0.6)^2)), 1 where fewer than three have it."""
    assert _expected_size([math.log(2.0)] * robots) == pytest.approx(size, abs=1e-4)
