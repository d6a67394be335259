"""Anchors whose place in campaign.toml, or whose column in the log, is wrong."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from anchored_campaign import Anchored

import pipeline
from pipeline.check.misplaced_anchors import _Claim, _of_one_pose, _Pulls, misplaced
from pipeline.faults.anchor import wrong_anchors
from pipeline.faults.fault import Screening
from pipeline.reduction.register import XYZ
from pipeline.run import ingested
from pipeline.store.campaign import in_memory


def asked(one):
    """A campaign under test with the paper's model."""
    case = ingested(in_memory(one.files()), plausible=False)
    return Screening(case, case.cell, case.robot.nominal_compliance)


def off(one, name, axis, by):
    """The same with one number of an anchor wrong."""
    at = list(one.true[name])
    at[axis] = round(at[axis] + by, 3)
    return one.stating(name, *at)


def shifted(one, begin, late):
    """The same with a cell of the column twice, or left out, from which on all rows are off."""
    named = list(one.named)
    here = [named[begin], *named[begin:-1]] if late else [*named[begin + 1 :], named[-1]]
    return one.naming([*named[:begin], *here])


@pytest.mark.parametrize(
    ("axis", "wrong", "slip"),
    [
        (0, lambda x: -x, "the wrong sign"),
        (1, lambda x: 10 * x, "the decimal point in the wrong place"),
        (2, lambda x: float(f"{x:.3f}"[:-2] + f"{x:.3f}"[:-3:-1]), "two digits exchanged"),
    ],
)
def test_a_mistyped_number_is_named_with_the_one_that_was_meant(axis, wrong, slip):
    one = Anchored.of(41, anchors=3, noise=2e-6)
    name = max(one.true, key=lambda key: abs(one.true[key][axis]))
    at = list(one.true[name])
    at[axis] = round(wrong(at[axis]), 3)
    given = asked(one.stating(name, *at))

    (found,) = misplaced(given)

    assert (found.name, found.where, found.entry) == ("outlier", name, ("anchors", name))
    assert f"{one.true[name][axis]:g} was probably meant by its {'xyz'[axis]}, " in found.evidence
    assert f"{at[axis]:g}: {slip}" in found.evidence
    right = found.correct(given.case).settings.anchors
    assert right[name] == pytest.approx(one.true[name], abs=1e-9)
    assert {key: [*at] for key, at in right.items() if key != name} == {
        key: at for key, at in one.true.items() if key != name
    }


SIZES = [*product((0.3, 0.7, 2.0), (2, 3, 5), (12,)), *product((0.4,), (1, 4), (8, 16))]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("size", "anchors", "poses"), SIZES)
def test_a_place_is_found_whatever_its_error_and_the_number_of_anchors(size, anchors, poses):
    """Within four standard uncertainties, in all three coordinates."""
    one = Anchored.of(int(100 * size) + anchors, anchors=anchors, poses=poses)
    by = size * np.array([0.6, -0.64, 0.48])
    given = asked(one.stating("K1", *(np.array(one.true["K1"]) + by)))

    (found,) = misplaced(given)

    assert found.where == "K1"
    at = np.array(found.correct(given.case).settings.anchors["K1"])
    std_mm = float(found.evidence.partition("± ")[2].partition(" mm")[0])
    assert np.abs(at - one.true["K1"]).max() < 4e-3 * std_mm
    assert 1e-3 * std_mm < max(0.15 * size, 0.03)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(20))
def test_right_anchors_are_not_accused(seed):
    """Every fifth robot has lost motion in a joint, which no springs explain."""
    one = Anchored.of(100 + seed, 2 + seed % 4, (8, 12, 16)[seed % 3], 3 - seed % 2, 2e-5,
                      lost=2e-4 if seed % 5 == 4 else 0.0)  # fmt: skip
    given = asked(one)
    assert misplaced(given) == wrong_anchors(given) == []


def test_lost_motion_is_no_place_and_hides_none_that_is_a_metre_off():
    """Beside that of the first, another place of K1 is likelier by odds of e^34."""
    assert misplaced(asked(Anchored.of(104, anchors=2, lost=2e-4))) == []

    one = Anchored.of(602, poses=14, lost=3e-4)
    (found,) = misplaced(asked(off(one, "K2", 2, 1.0)))

    assert found.where == "K2"


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("begin", "late"), [*product((0, 6, 20), (True, False))])
def test_a_column_that_is_off_by_one_is_put_back(begin, late):
    """Also where most or all rows are off, from which compliances would be learnt."""
    one = Anchored.of(701)
    given = asked(shifted(one, begin, late))

    (found,) = misplaced(given)

    assert found.name == "exchanged"
    assert found.where.endswith("off by one")
    assert f"stand one row too {'late' if late else 'early'}" in found.evidence
    true = dict(zip(given.case.anchors, one.went, strict=True))
    assert found.correct(given.case).anchors == true
    wrong = [k for k, (a, b) in enumerate(zip(one.went, shifted(one, begin, late).named,
                                              strict=True)) if a != b]  # fmt: skip
    assert found.at[0] == f"loads.csv:{wrong[0] + 2}"
    assert found.at[-1] == f"loads.csv:{wrong[-1] + 2}"


def test_one_wrong_row_moves_no_anchor():
    one = Anchored.of(900)
    named = list(one.named)
    named[10] = {"K1": "K2", "K2": "K3", "K3": "K1"}[named[10]]
    given = asked(one.naming(named))

    assert misplaced(given) == []
    (found,) = wrong_anchors(given)

    assert found.where == "pose04_rep2_loaded"
    assert found.correct(given.case).anchors[4, 2] == one.went[10]


@pytest.mark.parametrize("named", [True, False])
def test_a_reflector_of_the_base_is_an_anchor_among_the_others(named):
    """A row names one by mistake, or the chain went there and the row names another.

    The chain of another pull is hooked there, and its row says so.
    """
    one = Anchored.of(800)
    went, wrong = [*one.went], [*one.went]
    went[20] = wrong[20] = (went if not named else wrong)[7] = "B1"
    one = replace(one, went=tuple(went), named=tuple(wrong))
    given = asked(one)
    assert misplaced(given) == []

    (found,) = wrong_anchors(given)

    assert found.where == "pose03_rep2_loaded"
    assert found.correct(given.case).anchors[3, 2] == one.went[7]


@pytest.mark.whole
def test_a_run_tells_the_line_of_the_anchor_and_identifies_the_springs_with_the_right_place():
    one = Anchored.of(43)
    files = off(one, "K2", 0, 0.45).files()

    answer = pipeline.identify(pipeline.load_campaign(files)).answer

    (found,) = answer.diagnosis.causes
    lines = files["campaign.toml"].decode().splitlines()
    line = 1 + next(k for k, text in enumerate(lines) if text.startswith("K2 = "))
    assert (found.name, found.where) == ("outlier", "K2")
    assert found.readings == (f"campaign.toml:{line}",)
    right = pipeline.identify(pipeline.load_campaign(one.files())).answer
    for joint, known in zip(answer.stiffness, right.stiffness, strict=True):
        assert abs(joint.compliance - known.compliance) < 2 * known.compliance_std


@pytest.mark.parametrize("seed", [4, 7])
def test_a_pose_that_is_wrong_moves_no_anchor(seed):
    """Its unloaded readings are in the place of a pull's, so all its displacements are off."""
    given = asked(Anchored.of(seed, anchors=3, poses=8))
    rows, of = given.case.readings.copy(), given.case.readings["group"]
    groups = of[rows["pose"] == 3].unique()
    seen = rows["target"].isin(given.case.settings.measured)
    zero, pull = (seen & (of == group) for group in (groups[0], groups[-1]))
    there = rows.loc[pull, [*XYZ]].to_numpy()
    rows.loc[pull, [*XYZ]], rows.loc[zero, [*XYZ]] = rows.loc[zero, [*XYZ]].to_numpy(), there
    case = replace(given.case, readings=rows)

    assert misplaced(Screening(case, case.cell, case.robot.nominal_compliance)) == []


def test_a_campaign_of_one_pose_has_no_other_to_ask():
    """Nothing is left without it."""
    given = asked(Anchored.of(3, anchors=3, poses=2))
    case = given.case
    one = {
        name: rows[rows["pose"].isna() | (rows["pose"] == 1)]
        for name, rows in (
            ("readings", case.readings),
            ("loads", case.loads),
            ("joints", case.joints),
        )
    }
    case = replace(case, **one)
    pulls = _Pulls.of(Screening(case, case.cell, case.robot.nominal_compliance))

    assert pulls is None or not _of_one_pose(pulls, _Claim(pulls.place, step=1))
