"""Rounds of base reflectors between which all distances changed by one factor."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from small_case import small

from pipeline.reduction.register import XYZ, place, register

GROWTH = {"base_start": 0.0, "base_mid": 6e-5, "base_end": 1e-4}
"""Relative growth since the first round, as of steel by 9 K."""


@cache
def case():
    """Six poses on the rail, with a round of the base amid them, and no growth."""
    whole = small(3)
    rows = whole.readings
    first, last = (rows[rows["group"] == name] for name in ("base_start", "base_end"))
    amid = first["time"].min() + (last["time"].min() - first["time"].min()) / 2
    at = first[XYZ].to_numpy(float) + np.random.default_rng(5).normal(0, 2e-5, (len(first), 3))
    more = first.assign(group="base_mid", time=amid, **dict(zip(XYZ, at.T, strict=True)))
    return replace(whole, readings=pd.concat([rows, more], ignore_index=True))


def grown(along=(1, 1, 1), turn=0.0, size=1.0):
    """The readings with points at p (1 + g), g in proportion to time between the rounds.

    Args:
        along: Share of the growth along each axis of F_b.
        turn: Rotation of the tracker about the vertical until the last round [rad].
        size: Multiple of `GROWTH`.
    """
    whole, rows = register(case().settings, case().readings), case().readings
    begun = rows[rows["group"].isin(GROWTH)].groupby("group", observed=True)["time"].mean()
    order = sorted(GROWTH, key=lambda name: begun[name])
    share = np.interp(
        rows["time"].astype("int64"),
        [begun[name].value / 1e3 for name in order],
        [size * GROWTH[name] for name in order],
    )
    at = rows[XYZ].to_numpy(float) @ whole.R.T + whole.t
    at = at * (1 + share[:, None] * np.array(along))
    seen = (at - whole.t) @ whole.R
    angle = turn * share / GROWTH["base_end"]
    turned = Rotation.from_rotvec(angle[:, None] * [0, 0, 1]).apply(seen)
    return rows.assign(**dict(zip(XYZ, turned.T, strict=True)))


@pytest.mark.parametrize(
    ("along", "turn", "size"),
    [((1, 1, 1), 0, 1), ((0, 1, 0), 0, -1), ((1, 1, 1), 3e-5, 0.7), ((1, 1, 1), 0, 5)],
)
def test_growth_between_rounds_is_found_and_corrected(along, turn, size):
    """With its size, and readings of the poses as without it; along a rail, beside a drift."""
    still, rows = register(case().settings, case().readings), grown(along, turn, size)

    found = register(case().settings, rows)

    assert found.course is not None
    assert found.course.groups == tuple(GROWTH)
    true = size * np.array(list(GROWTH.values()))
    assert np.all(np.abs(found.course.growth - true)[1:] < 4 * found.course.std[1:])
    assert found.course.p_value < 1e-9
    assert not found.from_scatter
    before, after = (
        place(one, of)[XYZ].to_numpy() for one, of in ((still, case().readings), (found, rows))
    )
    assert np.abs(after - before).max() < 1.2e-4 + 2 * (turn > 0) * 1e-4


@pytest.mark.parametrize("off", [(0, 0, 0), (3e-4, 0, 0), (0, 5e-3, 0), (2e-3, 0, 1e-3)])
@pytest.mark.parametrize("groups", [["base_mid"], ["base_mid", "base_end"]])
def test_a_reflector_that_is_off_is_no_growth(off, groups):
    """In one round or since one, of any size; and a sound campaign has no course."""
    rows = case().readings
    for target in ("B1", "B2"):
        knocked = rows["group"].isin(groups) & (rows["target"] == target)
        at = rows[XYZ].to_numpy(float) + knocked.to_numpy()[:, None] * np.array(off)
        bad = rows.assign(**dict(zip(XYZ, at.T, strict=True)))

        assert register(case().settings, bad).course is None


def test_where_no_noise_is_stated_the_remainder_is_its_measure():
    """The growth is found without one, and none in a campaign without growth."""
    none = {name: np.nan for name in case().readings if name.startswith("c") and name[-2:] == "m2"}

    assert register(case().settings, case().readings.assign(**none)).course is None
    found = register(case().settings, grown().assign(**none)).course
    assert found is not None
    assert found.growth[-1] == pytest.approx(1e-4, abs=1.5e-5)


def test_a_reading_without_a_time_is_that_of_the_reading_before():
    """It is corrected as the one before."""
    rows = grown()
    found = register(case().settings, rows)
    assert found.course is not None
    points = rows.iloc[[40, 40]]

    same = found.course.as_in_first(points, np.array([5000.0, np.nan]))[XYZ].to_numpy()

    assert np.array_equal(same[0], same[1])
    assert not np.allclose(same, points[XYZ].to_numpy(float), atol=1e-6)
