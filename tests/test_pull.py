"""Mistakes in all forces at once: estimates made by hand, on either side of every threshold."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from small_case import asked, small

from pipeline.faults.pull import REVERSED, UNIT, force_unit, reversed_pull, times

KGF, LBF = 9.80665, 4.4482216152605


@pytest.fixture(scope="module")
def case():
    return small(2)


def estimate(value, std=None):
    value = np.asarray(value, float)
    std = np.abs(value) / 100 if std is None else np.asarray(std, float)
    return SimpleNamespace(value=value, std=std)


def without_chain(case):
    """The same of which nobody read the chain."""
    names = case.settings.naming.chain
    return replace(case, readings=case.readings[~case.readings["target"].isin(names)])


def test_a_robot_that_moves_against_the_force_is_pulled_the_other_way(case):
    """All compliances negative and certain, and the first end the farther one: exchanged."""
    swapped = exchanged(case)

    (found,) = reversed_pull(swapped, estimate([-1.0, -2.0, -1.0, -3.0, -1.0, -2.0, -1.0]))

    assert (found.name, found.where) == ("sign_or_convention", "pull_reversed")
    assert "7 of 7 clear compliances" in found.evidence
    assert "100% of the pulls" in found.evidence
    assert (found.before, found.after) == (1.0, 0.0)
    names = swapped.settings.naming.chain
    assert list(found.correct(swapped).settings.naming.chain) == [names[1], names[0]]
    # a reading says who is the farther one
    assert reversed_pull(case, estimate([-1.0] * 7)) == []


def exchanged(case):
    """Both ends of the chain carry each other's names in all readings."""
    near, far = case.settings.naming.chain
    target = case.readings["target"].astype(str).replace({near: far, far: near})
    return replace(case, readings=case.readings.assign(target=target))


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        ([-1, -1, -1, -1, -1, 1, 1], [0.01] * 5 + [0.1] * 2, True),
        ([-1, -1, -1, -1, 1, 1, 1], [0.01] * 4 + [0.1] * 3, False),
        ([-1, -1, -1, -1, -1, -1, 1], [0.1] * 6 + [0.05] * 1, False),
        ([-1, -1, -1, -1, -1, -1, 1], [0.1] * 6 + [0.13] * 1, True),
        ([-1] * 7, [0.3] * 7, False),
        ([-1] * 7, [0.2] * 7, True),
        ([1] * 7, [0.01] * 7, False),
        ([-1] * 5 + [5, 5], [0.1] * 5 + [np.inf] * 2, True),
    ],
    ids=["five of seven", "four", "one weighs more", "one weighs less", "unclear", "clear",
         "forwards", "two unknown"],
)  # fmt: skip
def test_most_of_the_clear_compliances_must_be_negative(case, value, std, said):
    """Nine tenths of the certainty, six tenths of the joints, four sigma each."""
    assert bool(reversed_pull(without_chain(case), estimate(value, std))) is said


def test_forces_that_arrive_reduced_are_turned_round(case):
    """There are no names to exchange then."""
    forces = pa.table({"pose": [1, 2], **{f"f{a}_n": [1.0, -2.5] for a in "xyz"}})
    given = replace(case, forces=forces, loads=case.loads)

    (found,) = reversed_pull(without_chain(given), estimate([-1.0] * 7))
    right = found.correct(given)

    for axis in "xyz":
        assert right.forces[f"f{axis}_n"].to_pylist() == [-1.0, 2.5]
    assert right.forces["pose"].to_pylist() == [1, 2]
    assert right.forces.schema == forces.schema
    assert right.settings.naming.chain == given.settings.naming.chain


@pytest.mark.parametrize(
    ("softer", "where", "factor"),
    [
        (KGF, "kgf", KGF),
        (1 / KGF, "n", 1 / KGF),
        (LBF, "lbf", LBF),
        (1 / LBF, "n", 1 / LBF),
        (1e-3, "n", None),
        (1e3, "kn", None),
    ],
)
def test_a_machine_many_times_too_soft_had_its_forces_in_another_unit(case, softer, where, factor):
    """Numbers in kgf read as N make the force too small and every joint too soft by g."""
    nominal = case.robot.nominal_compliance

    (found,) = force_unit(case, estimate(softer * nominal))

    factor = factor or softer
    right = found.correct(case)
    np.testing.assert_allclose(right.loads["force_n"], factor * case.loads["force_n"])
    assert found.name == "unit_mixup"
    assert found.where.lower() == where
    assert found.before == pytest.approx(softer)
    assert found.after == pytest.approx(1.0)
    assert ("too small" in found.evidence) is (softer > 1)
    times_off = f"{max(softer, 1 / softer):.2g}"
    assert f"come out {times_off} times" in found.evidence


@pytest.mark.parametrize(
    ("softer", "spread", "said"),
    [
        (KGF * np.exp(0.34), 0.0, True),
        (KGF * np.exp(0.36), 0.0, False),
        (LBF * np.exp(-0.34), 0.0, True),
        (LBF * np.exp(-0.36), 0.0, False),
        (1.0, 0.0, False),
        (2.5, 0.0, False),
        (KGF, 0.59, True),
        (KGF, 0.61, False),
    ],
)
def test_a_machine_of_another_make_had_not(case, softer, spread, said):
    """As near as 1.4 times to a unit's factor, and joints alike to 1.8 times."""
    off = spread * np.array([-1.0, 1.0, -1.0, 0.0, 1.0, 1.0, -1.0])
    value = softer * np.exp(off) * case.robot.nominal_compliance

    assert bool(force_unit(case, estimate(value))) is said


def test_three_certain_joints_are_enough_and_two_are_not(case):
    """Joints that are known to less than three sigma, or not at all, do not vote."""
    value = KGF * case.robot.nominal_compliance
    std = value / 100
    std[4:] = np.inf
    std[3] = value[3] / 2.9

    assert force_unit(case, estimate(value, std))
    std[2] = value[2] / 2.9
    assert not force_unit(case, estimate(value, std))
    std[2] = value[2] / 3.1
    assert force_unit(case, estimate(value, std))


def test_a_multiple_of_all_forces_reaches_both_tables(case):
    """The scale's log, and forces that arrived reduced; the campaign as given stays."""
    forces = pa.table({"fx_n": [1.0], "fy_n": [2.0], "fz_n": [3.0], "reading_n": [7.0]})
    given = replace(case, forces=forces)
    before = given.loads.copy()

    right = times(2.5)(given)

    assert right.forces.to_pylist() == [{"fx_n": 2.5, "fy_n": 5.0, "fz_n": 7.5, "reading_n": 7.0}]
    pd.testing.assert_frame_equal(given.loads, before)
    assert times(2.0)(case).forces is None


@pytest.mark.parametrize("factor", [KGF, -1.0])
def test_in_a_campaign_the_estimate_itself_tells(case, factor):
    """The scale in kgf, the chain's names exchanged; as they should be, nothing is said."""
    wrong = times(1 / factor)(case) if factor > 0 else exchanged(case)

    found = [*REVERSED.find(asked(wrong)), *UNIT.find(asked(wrong))]

    assert [one.where for one in found] == ["kgf" if factor > 0 else "pull_reversed"]
    right = asked(found[0].correct(wrong))
    expected = asked(case).estimate.value
    np.testing.assert_allclose(right.estimate.value, expected, rtol=5e-3, atol=1e-9)
    assert [*REVERSED.find(right), *UNIT.find(right)] == []
