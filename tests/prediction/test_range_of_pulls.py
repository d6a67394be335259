"""Forces of a path beside those that a campaign pulled with."""

import numpy as np
import pytest

from pipeline.prediction.path import against_pulls


@pytest.mark.parametrize(
    ("hardest", "said"), [(400.0, ""), (200.0, "check their unit"), (2100.0, "not tested")]
)
def test_less_than_the_smallest_pull_is_warned_of_only_by_the_ratio_of_units(hardest, said):
    """Pulls of 1 to 2 kN: 400 N are a third of a pull, 200 N may be newtons for pounds."""
    found = " ".join(against_pulls(np.array([10.0, hardest]), (1000.0, 2000.0)))

    assert (said in found) if said else not found
