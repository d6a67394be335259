"""Power of the tests, and readings too far off."""

import numpy as np
import pytest

from pipeline.diagnosis.blindspots import needed
from pipeline.diagnosis.bounds import Bounds
from pipeline.system.outlying import OutlyingReadings


@pytest.mark.parametrize(("k", "least"), [(1, 7.849), (2, 9.635), (3, 10.903)])
def test_the_noncentrality_of_80_percent_power_is_the_tabulated_one(k, least):
    """At the 5 % level; with one parameter (1.960 + 0.842)^2."""
    assert needed(k, 0.05) == pytest.approx(least, abs=2e-3)


@pytest.mark.parametrize(
    ("pose", "base", "scattered"), [(0, 0, False), (1, 0, False), (2, 0, True), (0, 1, True)]
)
def test_one_reading_of_a_pose_is_tolerated_and_one_of_the_base_is_not(pose, base, scattered):
    none = np.zeros(pose, np.int64)

    assert Bounds(far=OutlyingReadings(none, none, 1e-12, base)).scattered is scattered
