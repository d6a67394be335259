"""Registration without a base reading that is grossly off."""

import numpy as np
import pandas as pd

from pipeline.base import covariance
from pipeline.reduction.register import agreed, register
from pipeline.reduction.settings import parse

SETTINGS = """
format = 1
name = "t"
robot = "kr500_rail"
[tracker]
files = ["t.csv"]
sigma_m = 3e-5
[scale]
sigma_n = 2.0
sigma_rel = 0.001
[base_frame]
B1 = [0.6, -0.5, -0.30]
B2 = [0.6, 18.5, -0.30]
B3 = [-0.6, 18.5, -0.28]
B4 = [2.0, 9.0, 3.0]
B5 = [3.0, 2.0, 1.0]
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
"""


def test_a_reading_that_is_left_out_takes_its_three_coordinates_with_it():
    """Five reflectors, one of them half a metre off: 4 * 3 - 6 degrees of freedom are left."""
    settings = parse(SETTINGS)
    places = np.array(list(settings.base_frame.values()))
    places[4, 2] += 0.5
    n = len(places)
    readings = pd.DataFrame(
        {
            "file": "t.csv",
            "line": np.arange(2, n + 2),
            "group": "base_start",
            "target": list(settings.base_frame),
            "pose": [None] * n,
            "repeat": [None] * n,
            "state": [None] * n,
            **dict(zip(("x_m", "y_m", "z_m"), places.T, strict=True)),
            **dict(zip(covariance.columns(), covariance.flat(
                np.tile(9e-10 * np.eye(3), (n, 1, 1))).T, strict=True)),
            "covariance_from": "stated",
            "time": pd.Timestamp("2026-11-03T08:00:00") + pd.to_timedelta(np.arange(n), unit="s"),
        }
    )  # fmt: skip
    found, agree = agreed(register(settings, readings))

    assert agree.tolist() == [True] * 4 + [False]
    assert found.dof == 4 * 3 - 6
    assert np.abs(found.t).max() < 1e-9
