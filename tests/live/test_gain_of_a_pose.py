"""Information in bits, and when a pose has ended."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.live.update import _worth
from pipeline.live.updates import _ended


@pytest.mark.parametrize("halvings", [1, 2])
def test_worth_counts_how_often_the_volume_of_uncertainty_is_halved(halvings):
    """A reading that halves each coordinate's uncertainty n times: 3 n bits in each direction."""
    noise_m = 3e-5
    # combined with a reading of variance s^2, C becomes C s^2 / (C + s^2) = C / 4^n
    cov = (4.0**halvings - 1) * noise_m**2 * np.eye(3)

    def predict(q, force, points):
        return SimpleNamespace(cov=np.tile(cov, (len(q), 1, 1)))

    result = SimpleNamespace(
        tables={"forces": pd.DataFrame([[0.0, 0.0, -900.0]], columns=["fx_n", "fy_n", "fz_n"])},
        answer=SimpleNamespace(fit=SimpleNamespace(residual_std_mm=1e3 * noise_m, rms_mm=None)),
        model=SimpleNamespace(identified=SimpleNamespace(predict=predict)),
    )

    assert _worth(result, np.zeros((2, 6))) == pytest.approx(9 * halvings)


@pytest.mark.parametrize(("readings", "ended"), [([6, 6, 5], [1, 2]), ([6, 6, 6], [1, 2, 3])])
def test_the_last_pose_has_ended_with_as_many_readings_as_any_other(readings, ended):
    """Not one more: it is told before the operator leaves it."""
    pose = np.repeat([1.0, 2.0, 3.0], readings)
    result = SimpleNamespace(tables={"readings": pd.DataFrame({"pose": [np.nan, *pose]})})

    assert _ended(result) == ended
