"""Decision on a whole path from those on its stretches."""

import pandas as pd
import pytest

from pipeline.answer.conformity import _path
from pipeline.prediction.decision import Decision

PASS, OPEN, FAIL = Decision.PASS, Decision.UNDECIDED, Decision.FAIL


@pytest.mark.parametrize(
    ("points", "whole"),
    [((PASS, PASS), PASS), ((PASS, OPEN, PASS), OPEN), ((OPEN, FAIL, PASS), FAIL)],
)
def test_a_path_passes_only_if_every_point_passes(points, whole):
    n = len(points)
    rows = pd.DataFrame({"pose": range(1, n + 1), "fx_n": 3.0, "fy_n": 4.0, "fz_n": 0.0,
                         "deflection_m": 1e-3, "std_m": 1e-4, "decision": points})  # fmt: skip

    found = _path("part.csv", rows)
    assert (found.decision, found.points, found.force_n) == (whole, n, (5.0, 5.0))
