"""Two campaigns of a robot: the test of scatter is that of one difference."""

import pytest
from scipy import stats
from test_history import campaign

from pipeline.fleet.trends import trends


@pytest.mark.parametrize("sigmas", [0.3, 1.5, 3.2])
def test_the_p_value_of_two_is_that_of_their_difference(sigmas):
    """The difference over sigma sqrt 2 is normal, two-sided."""
    x, std = 2e-7, 1e-9
    both = [campaign(f"c{k}", [x + k * sigmas * std * 2**0.5], std) for k in (0, 1)]

    (found,) = trends(both)

    assert found.p_value == pytest.approx(2 * stats.norm.sf(sigmas))
