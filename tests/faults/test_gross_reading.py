"""Readings of the effector off by centimetres or metres: named against the median, nothing else."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from small_case import moved, small, where

from pipeline.faults.entries import _base
from pipeline.faults.gross_reading import gross
from pipeline.reduction.register import XYZ


@pytest.fixture(scope="module")
def case():
    """Six poses, two pulls and two zeros to each."""
    return small(3)


def put(case, places):
    """Readings moved to other positions, by group and target [m]."""
    for (group, target), place in places.items():
        rows = case.readings.copy()
        rows.loc[where(case, group, target), XYZ] = place
        case = replace(case, readings=rows)
    return case


def place_of(case, group, target):
    return case.readings.loc[where(case, group, target), XYZ].to_numpy(float)[0]


def named(case):
    return {one.where for one in gross(case)}


@pytest.mark.parametrize("group", ["pose04_rep1_loaded", "pose02_rep0_unloaded"])
@pytest.mark.parametrize("target", ["P1", "P2", "P3"])
def test_a_failed_lock_and_a_stale_reading_are_named(case, group, target):
    """(0, 0, 0), and the position of another target; the size is the distance."""
    true = place_of(case, group, target)
    other = place_of(case, group, {"P1": "P2"}.get(target, "P1"))
    for place in (np.zeros(3), other):
        (found,) = gross(put(case, {(group, target): place}))

        assert found.where == f"{group}/{target}"
        assert found.size == pytest.approx(np.linalg.norm(place - true), abs=0.02)
        assert found.p_value is None
        assert gross(found.correct(put(case, {(group, target): place}))) == []


def test_two_of_one_pose_are_both_named(case):
    """In different states, or two of three targets of one state, where no distance is right."""
    one, other = ("pose03_rep1_loaded", "P1"), ("pose03_rep2_loaded", "P3")
    same = ("pose03_rep1_loaded", "P2")

    assert named(put(case, dict.fromkeys((one, other), np.zeros(3)))) == {
        "/".join(one),
        "/".join(other),
    }
    assert named(put(case, {one: np.zeros(3), same: np.ones(3)})) == {"/".join(one), "/".join(same)}


def test_what_moves_as_a_whole_is_no_reading(case):
    """A robot that was elsewhere in one state keeps the distances.

    A clean campaign has no fault.
    """
    rows = (case.readings["group"] == "pose03_rep1_loaded").to_numpy()

    assert gross(case) == []
    assert gross(moved(case, rows, np.array([0.2, 0.1, 0.0]))) == []


def test_a_soft_robot_gives_way_by_centimetres(case):
    """Ten times the usual is required: 2 cm in every pull and 5 cm in one are not enough."""
    rows = case.readings
    pulled = (rows["state"] == "loaded").to_numpy()
    soft = moved(case, pulled, np.array([0.0, 0.0, 0.02]))

    assert gross(moved(soft, where(case, "pose04_rep1_loaded", "P1"), np.array([0, 0, 0.03]))) == []
    assert named(moved(soft, where(case, "pose04_rep1_loaded", "P1"), np.array([0, 0, 3.0])))


def test_with_one_pull_to_a_pose_the_distances_tell(case):
    """One zero, one pull: no median in the pose, and two of three distances are wrong."""
    rows = case.readings
    few = replace(case, readings=rows[rows["group"].str.contains("rep0|rep1|base")])
    spot = ("pose05_rep1_loaded", "P2")

    assert named(put(few, {spot: np.zeros(3)})) == {"/".join(spot)}
    assert named(put(few, {spot: np.zeros(3), (spot[0], "P1"): np.ones(3)})) == set()
    assert gross(few) == []


def test_without_stated_noise_a_gross_reading_is_named_all_the_same(case):
    """No standard deviation is known, but a metre is clear without."""
    blank = case.readings.filter(regex="^c.._m2$").columns
    unknown = replace(case, readings=case.readings.assign(**dict.fromkeys(blank, np.nan)))

    (found,) = gross(put(unknown, {("pose04_rep1_loaded", "P1"): np.zeros(3)}))

    assert found.before == np.inf
    assert gross(replace(case, readings=pd.DataFrame(columns=case.readings.columns))) == []


def test_a_base_reflector_is_where_most_of_its_readings_have_it(case):
    """Of three rounds one reads it metres off: entries are judged by the other two."""
    rows = case.readings
    base = rows["pose"].isna()
    third = rows[base].drop_duplicates("target").assign(group="base_third")
    whole = replace(case, readings=pd.concat([rows, third], ignore_index=True))
    names, right = _base(whole)
    rows = whole.readings.copy()
    hit = rows.index[rows["pose"].isna() & (rows["target"] == names[1])][0]
    rows.loc[hit, XYZ] += np.array([5.0, -2.0, 3.0])

    again, found = _base(replace(whole, readings=rows))

    assert again == names == list(case.settings.base_frame)
    assert np.abs(found - right).max() < 2e-4
