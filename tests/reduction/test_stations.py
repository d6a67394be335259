"""A tracker moved to another station: equal to the same campaign from one station."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from small_case import small

from pipeline.reduction.bring import bring
from pipeline.reduction.register import XYZ
from pipeline.reduction.stations import one_station
from pipeline.system.estimate import identify

TURN = Rotation.from_euler("zyx", [70, 2, -1], degrees=True).as_matrix()
CARRIED = np.array([3.0, -4.0, 0.2])
SIX = ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"]


def twice(case, pose, carried=CARRIED, turn=TURN):
    """The base read again before a pose, and everything after it from another station.

    A point that the first station reads as p is read as turn' (p - carried) by the second.
    """
    rows = case.readings
    start = rows["time"][rows["pose"] == pose].min()
    base = rows[rows["group"] == "base_start"]
    late = base["time"] - base["time"].max() + start - pd.Timedelta(seconds=5)
    again = base.assign(group="base_again", time=late, line=base["line"] + 100_000)
    rows = pd.concat([rows, again], ignore_index=True)
    since = rows["time"] >= again["time"].min()
    rows.loc[since, XYZ] = (rows.loc[since, XYZ].to_numpy(float) - carried) @ turn
    return replace(case, readings=rows), since.to_numpy()


@pytest.fixture(scope="module")
def still():
    """A campaign from one station."""
    return small(3)


def compliances(case):
    return identify(case.cell, bring(case).data, case.robot.nominal_compliance)[1]


def test_one_station_is_left_alone(still):
    """Readings are the same object; a displacement of some millimetres is no new station."""
    readings, told = one_station(still.settings, still.readings)
    assert readings is still.readings
    assert told == ()

    knocked, _ = twice(still, 4, carried=np.array([3e-3, 0, 0]), turn=np.eye(3))
    assert one_station(knocked.settings, knocked.readings)[1] == ()


def test_what_is_read_from_a_second_station_comes_back_to_the_first(still):
    """To the uncertainty of the base rounds, some tenths of a millimetre; and the distance."""
    away, since = twice(still, 4)

    readings, (one,) = one_station(away.settings, away.readings)

    before = away.readings.loc[since, XYZ].to_numpy(float) @ TURN.T + CARRIED
    np.testing.assert_allclose(readings.loc[since, XYZ], before, atol=2e-4)
    pd.testing.assert_frame_equal(readings[~since], away.readings[~since])
    assert one.group == "base_again"
    assert one.moved_m == pytest.approx(np.linalg.norm(CARRIED), abs=1e-3)


def test_stated_covariances_turn_with_the_station(still):
    """A range more accurate than the angles has another direction."""
    away, since = twice(still, 4)
    rows = away.readings.assign(**dict(zip(SIX, [1e-10, 0.0, 0.0, 4e-10, 0.0, 9e-10], strict=True)))

    readings, _ = one_station(away.settings, rows)

    C = readings.loc[since, SIX].to_numpy(float)[0]
    made = np.array([[C[0], C[1], C[2]], [C[1], C[3], C[4]], [C[2], C[4], C[5]]])
    expected = TURN @ np.diag([1e-10, 4e-10, 9e-10]) @ TURN.T
    np.testing.assert_allclose(made, expected, atol=1e-3 * 9e-10)


def test_the_springs_are_those_of_one_station(still):
    """Without it every one of them is undetermined."""
    away, _ = twice(still, 4)
    whole = replace(away, readings=one_station(away.settings, away.readings)[0])

    want, got, lost = (compliances(case) for case in (still, whole, away))

    assert (np.abs(got.value - want.value) < 0.05 * want.std).all()
    assert (np.abs(lost.value - want.value) > 5 * want.std).any()


def test_a_round_that_is_wrong_by_itself_is_no_station(still):
    """Two reflectors exchanged: no rigid motion aligns that round with the others."""
    away, _ = twice(still, 4)
    rows = away.readings.copy()
    mine = rows["group"] == "base_again"
    names = rows.loc[mine, "target"].unique()
    swap = {names[0]: names[1], names[1]: names[0]}
    rows["target"] = rows["target"].astype(str)
    rows.loc[mine, "target"] = rows.loc[mine, "target"].map(lambda name: swap.get(name, name))

    _, told = one_station(away.settings, rows)

    assert "base_again" not in {one.group for one in told}
