"""Two rounds of base reflectors, read from two stations, with exchanged readings."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from small_case import small

from pipeline.faults.base_rounds import base_rounds, carried, drifted
from pipeline.reduction.register import XYZ
from pipeline.reduction.stations import one_station

TURN = Rotation.from_euler("zyx", [35, -1, 2], degrees=True).as_matrix()
CARRIED = np.array([0.4, 1.1, 0.1])


@pytest.fixture(scope="module")
def shot():
    """Read from two stations, the base before each and at the end; in the tracker's frame.

    A point that the first station reads as p is read as turn' (p - carried) by the second.
    """
    case = small(3)
    rows = case.readings
    start = rows["time"][rows["pose"] == 4].min()
    base = rows[rows["group"] == "base_start"]
    late = base["time"] - base["time"].max() + start - pd.Timedelta(seconds=5)
    again = base.assign(group="base_again", time=late, line=base["line"] + 100_000)
    rows = pd.concat([rows, again], ignore_index=True)
    since = rows["time"] >= again["time"].min()
    rows.loc[since, XYZ] = (rows.loc[since, XYZ].to_numpy(float) - CARRIED) @ TURN
    return replace(case, readings=rows)


def exchanged(case, one, other):
    """The same with the coordinates of two groups exchanged, brought to one station."""
    rows = case.readings.copy()
    here, there = (rows["group"] == group for group in (one, other))
    rows.loc[here, XYZ], rows.loc[there, XYZ] = (
        rows.loc[there, XYZ].to_numpy(),
        rows.loc[here, XYZ].to_numpy(),
    )
    return brought(replace(case, readings=rows))


def brought(case):
    """The same brought to one station, as `run.ingested_with_doubt` does."""
    readings, stations = one_station(case.settings, case.readings)
    return replace(case, readings=readings, stations=stations)


@pytest.mark.parametrize("pair", [("base_start", "base_again"), ("base_start", "base_end")])
def test_the_exchange_is_found_and_undone(shot, pair):
    """With its lines; the result is the campaign without the exchange."""
    spoilt, right = exchanged(shot, *pair), brought(shot)

    (found,) = base_rounds(spoilt)

    assert found.name == "exchanged"
    assert set(found.where.split("/")) == set(pair)
    rows = shot.readings[shot.readings["group"].isin(pair)]
    assert set(found.at) == {f"{f}:{n}" for f, n in zip(rows["file"], rows["line"], strict=True)}
    assert found.before > 3 * found.after
    got = found.correct(spoilt)
    np.testing.assert_allclose(got.readings[XYZ], right.readings[XYZ], atol=1e-9)
    assert [one.group for one in got.stations] == [one.group for one in right.stations]


def test_rounds_of_one_station_may_be_exchanged(shot):
    """Such an exchange is invisible and has no effect; nor is anything wrong without one."""
    assert base_rounds(exchanged(shot, "base_again", "base_end")) == []
    assert base_rounds(brought(shot)) == []
    assert base_rounds(small(3)) == []


@pytest.mark.parametrize("mm", [0.0, 1.0, -0.8])
def test_rounds_exchanged_while_the_tracker_drifts_show_in_the_effector(mm):
    """Nothing without an exchange; with one, both rounds if the drift moves anything."""
    right = small(12)
    rows = right.readings.copy()
    hours = (rows["time"] - rows["time"].min()) / pd.Timedelta(hours=1)
    along = (hours / hours.max()).to_numpy()[:, None]
    turn = Rotation.from_rotvec(along * [0, 0, 1e-4 * mm])
    shift = 1e-3 * mm * along * [0.6, -0.7, 0.2]
    rows[XYZ] = turn.apply(rows[XYZ].to_numpy(float, copy=True)) + shift
    right = replace(right, readings=rows)
    assert drifted(right) == []

    spoilt = exchanged(right, "base_start", "base_end")

    found = drifted(spoilt)
    assert len(found) == bool(mm)
    for one in found:
        assert one.where == "base_start/base_end"
        assert one.before > 2 * one.after
        here, there = one.correct(spoilt).readings, right.readings
        np.testing.assert_allclose(here[XYZ], there[XYZ], atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_bad_round_is_not_exchanged_with_one_at_the_end(seed):
    """It does less harm there, hours after the last pose, and none where it is left out."""
    right = small(12)
    rows, rng = right.readings, np.random.default_rng(seed)
    middle = rows["time"][rows["pose"] == 6].min()
    base = rows[rows["group"] == "base_start"]
    again = base.assign(group="base_mid", line=base["line"] + 100_000)
    again["time"] = base["time"] - base["time"].max() + middle - pd.Timedelta(seconds=5)
    again[XYZ] = again[XYZ].to_numpy(float) + 2e-3 * rng.standard_normal((len(again), 3))
    rows = pd.concat([rows, again], ignore_index=True)
    rows.loc[rows["group"] == "base_end", "time"] += pd.Timedelta(hours=9)

    assert drifted(replace(right, readings=rows)) == []


def test_readings_without_a_time_show_no_drift():
    """As those of a second export: the others are judged, and by themselves too few are not."""
    right = small(12)
    for without in (right.readings["pose"] > 6, right.readings["pose"].notna()):
        rows = right.readings.copy()
        rows.loc[without, "time"] = pd.NaT
        case = exchanged(replace(right, readings=rows), "base_start", "base_end")
        assert drifted(case) == []


def read_late(shot, rounds, times):
    """As it was shot, but with rounds of the base read at other times."""
    rows = shot.readings.copy()
    for name, time in zip(rounds, times, strict=True):
        here = rows["group"] == name
        rows.loc[here, "time"] += time - rows.loc[here, "time"].min()
    return brought(replace(shot, readings=rows))


@pytest.mark.parametrize("pose", [5, 6])
def test_a_station_is_dated_back_to_the_pose_that_was_read_from_it(shot, pose):
    """Carried after pose 3, and its base read before a later pose only, or at the end."""
    right, rows = brought(shot), shot.readings
    end = rows["time"].max() + pd.Timedelta(minutes=9)
    late = end if pose == 6 else rows["time"][rows["pose"] == pose].min() - pd.Timedelta(seconds=30)
    spoilt = read_late(shot, ["base_again", "base_end"], [late, end + pd.Timedelta(minutes=5)])
    assert not carried(right)

    (found,) = carried(spoilt)

    assert (found.name, found.where) == ("tracker_moved", "after pose 3")
    assert found.size == pytest.approx(np.linalg.norm(CARRIED), abs=1e-3)
    assert "since pose 4" in found.evidence
    put = found.correct(spoilt).readings
    np.testing.assert_allclose(put[XYZ], right.readings[XYZ], atol=1e-9)
    np.testing.assert_allclose(put["cxx_m2"], right.readings["cxx_m2"], rtol=1e-9)
    assert not carried(found.correct(spoilt))


def test_a_robot_that_stands_elsewhere_dates_no_station_back(shot):
    """Where the table has poses nearer to neither station, or to both in turn."""
    right = brought(shot)
    joints = right.joints.assign(r1_m=right.joints["r1_m"] + 3.0)
    assert not carried(replace(right, joints=joints))
    rows = right.readings.copy()
    odd = rows["pose"].isin([2])
    one = right.stations[0]
    rows.loc[odd, XYZ] = rows.loc[odd, XYZ].to_numpy(float) @ one.turn.T + one.shift
    assert not carried(replace(right, readings=rows))


def test_a_tracker_carried_early_is_no_exchange_of_rounds():
    """After pose 1 of six: with the rounds exchanged all other poses would be in their places."""
    case = small(3)
    rows = case.readings.copy()
    since = rows["time"] >= rows["time"][rows["pose"] == 2].min()
    rows.loc[since, XYZ] = (rows.loc[since, XYZ].to_numpy(float) - CARRIED) @ TURN
    spoilt = brought(replace(case, readings=rows))

    assert base_rounds(spoilt) == []
    (found,) = carried(spoilt)
    assert (found.name, found.where) == ("tracker_moved", "after pose 1")
