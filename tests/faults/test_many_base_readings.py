"""Continuous readings of base reflectors: combined into few rounds without loss."""

import warnings

import numpy as np
import pandas as pd
import pytest
from small_case import small

from pipeline.diagnosis.drift import in_rounds
from pipeline.faults.base_reading import _courses, _stands_out, base_outlier
from pipeline.reduction.register import XYZ, register

CORNERS = {"B1": [1, -0.5, -0.3], "B2": [1, 15, -0.3], "B3": [-1, 15, 0.2], "B4": [-1, -0.5, 0]}
SIX = ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"]
NUMBERS = [*XYZ, "dx_m", "dy_m", "dz_m"]


def table(count):
    """Readings of three reflectors in turn, each with its own covariance."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(count, 3, 3))
    C = A @ np.swapaxes(A, 1, 2) + np.eye(3)
    out = pd.DataFrame(rng.normal(size=(count, 6)), columns=NUMBERS)
    out[SIX] = np.stack([C[:, i, j] for i, j in zip(*np.triu_indices(3), strict=True)]).T
    out["target"] = pd.Categorical([f"B{1 + k % 3}" for k in range(count)])
    out["group"] = pd.Categorical([f"base_{k // 3}" for k in range(count)])
    return out.assign(since=np.arange(count) * 8.0), C


def test_a_thousand_readings_stay_as_they_are():
    """No note about rounds that were not formed."""
    rows, _ = table(1000)

    assert in_rounds(rows) is rows


def test_the_readings_of_a_round_are_their_weighted_mean():
    """One mean per reflector and time span is as certain as its hundreds of readings."""
    rows, C = table(3000)
    means = in_rounds(rows)

    assert len(means) == 300
    assert means["group"].nunique() == 100
    one = means[means["target"] == "B2"].iloc[7]
    mine = np.flatnonzero((rows["target"] == "B2") & (rows["since"] // (2999 * 8 / 100) == 7))
    W = [np.linalg.inv(C[k]) for k in mine]
    whole = np.linalg.inv(np.sum(W, axis=0))
    for names in (XYZ, ["dx_m", "dy_m", "dz_m"]):
        said = whole @ sum(w @ rows[names].to_numpy()[k] for w, k in zip(W, mine, strict=True))
        np.testing.assert_allclose(one[names].to_numpy(float), said, rtol=1e-9)
    np.testing.assert_allclose(one[SIX].to_numpy(float), whole[np.triu_indices(3)], rtol=1e-9)
    assert one["since"] == pytest.approx(rows["since"].to_numpy()[mine].mean())


def test_readings_of_one_time_are_one_round():
    """For example of one group without times: one mean of each reflector, and no warning."""
    rows, _ = table(3000)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        means = in_rounds(rows.assign(since=0.0))

    assert sorted(means["target"]) == ["B1", "B2", "B3"]
    assert means[NUMBERS].notna().all(axis=None)


def watched(rounds, drift_m=0.0):
    """Registration of a campaign with this number of rounds and this total drift."""
    made = small(4, base_frame=CORNERS)
    rows = made.readings[made.readings["pose"].isna()]
    first = rows.drop_duplicates("target")
    many = pd.concat([first] * rounds, ignore_index=True)
    rng = np.random.default_rng(5)
    sigma = np.sqrt(first[SIX[0]].to_numpy()[0])
    turn = np.repeat(np.arange(rounds), len(first))
    many[XYZ] += rng.normal(0, sigma, (len(many), 3)) + drift_m * turn[:, None] / rounds
    many["group"] = [f"base_{k}" for k in turn]
    return register(made.settings, many)


@pytest.mark.whole
def test_many_rounds_are_looked_at_in_no_time():
    """Without a motion of the tracker before each of them, a cost quadratic in their number."""
    assert base_outlier(watched(2000), 1.0) == []


def test_a_drift_of_many_rounds_is_laid_on_no_reading():
    """Drift has a test of its own."""
    assert base_outlier(watched(150, drift_m=5e-4), 1.0) == []


def test_what_stands_out_is_what_an_exact_look_finds():
    """The quick test says no only if the exact one does, whatever the limit."""
    one = next(_courses(watched(3), 1.0))
    most = one.each(np.ones(len(one.y), dtype=bool)).drop.max()

    assert [_stands_out(one, most * part) for part in (0.5, 0.999, 1.001, 2.0)] == [
        True, True, False, False,
    ]  # fmt: skip
