"""Report of readings that are far off and stay in use, and of those that were left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_case import asked, moved, small

from pipeline.answer.inputs import left_out_entries, lost_told
from pipeline.base import covariance
from pipeline.check.findings import doubt_findings, return_findings
from pipeline.faults.mistake import left_out, outlying, without_pulls
from pipeline.reduction.case import UnusedReadings


def test_readings_that_are_far_off_and_used_are_counted_with_their_lines():
    """Their number and places; a campaign without any reports nothing."""
    (one,) = doubt_findings(("tracker.csv:63",))
    (many,) = doubt_findings(tuple(f"tracker.csv:{k}" for k in range(2, 22)))

    assert one.startswith("A reading is more than 10 standard uncertainties from where all others")
    assert "(tracker.csv:63)" in one
    assert many.startswith("20 readings are more than 10")
    assert "tracker.csv:2, " in many
    assert "8 more" in many
    assert doubt_findings(()) == []


@pytest.mark.parametrize(
    ("readings", "poses", "said"),
    [
        (1, (), ["1 of 40 readings was left out; see"]),
        (2, (), ["2 of 40 readings were left out; see"]),
        (6, (4,), ["6 of 40 readings were left out, all of pose 4; see"]),
        (12, (4, 7), ["12 of 40 readings were left out, all of poses 4, 7; see"]),
        (0, (), []),
    ],
)
def test_readings_that_were_left_out_are_counted_with_whole_poses(readings, poses, said):
    """One reading was, several were; one pose, several poses; nothing of none."""
    told = [*lost_told(UnusedReadings(readings, 40, poses))]

    assert [one.partition(" Rejected")[0] for one in told] == said


def test_a_target_without_a_reading_is_stated_before_what_was_left_out():
    """One has none, two have none."""
    one, rest = lost_told(UnusedReadings(2, 40, absent=("P3",)))
    (two,) = lost_told(UnusedReadings(absent=("P1", "P3")))

    assert one.startswith("P3 of naming.measured has no reading")
    assert rest.startswith("2 of 40 readings")
    assert two.startswith("P1, P3 of naming.measured have no reading")


@pytest.fixture(scope="module")
def case():
    """A campaign with zeros before and after the pulls of each pose."""
    return small(3)


def test_rows_that_mistakes_take_out_are_left_out_with_the_evidence(case):
    """The wrong reading by its evidence, what hangs on it as such, nothing that was kept."""
    rows = case.readings
    bad = rows[(rows["group"] == "pose02_rep1_loaded")].iloc[:2]
    wrong, beside = (f"{file}:{line}" for file, line in zip(bad["file"], bad["line"], strict=True))
    right = without_pulls(left_out(case, (wrong, beside)), {(3, 2)})
    mistake = outlying("P1", "P1 is 9 mm off", "without", before=9.0, correct=None, at=(wrong,))
    load = case.loads[(case.loads["pose"] == 3) & (case.loads["repeat"] == 2)].iloc[0]

    out = left_out_entries(case, right, (mistake,))

    assert [f"{one.file}:{one.line}" for one in out] == [
        wrong,
        beside,
        f"{load['file']}:{load['line']}",
    ]
    assert out[0].reason == "P1 is 9 mm off"
    assert out[1].reason == out[2].reason != out[0].reason
    assert left_out_entries(case, case, (mistake,)) == ()


def test_poses_whose_reflectors_do_not_return_are_named(case):
    """The second zero of one pose is 0.3 mm off in all targets; those of the others return."""
    rows = case.readings
    zeros = (rows["pose"] == 2) & (rows["state"] == "unloaded")
    late = zeros & (rows["time"] > rows["time"][zeros].median())

    def said(of):
        made = asked(of)
        fitted = SimpleNamespace(
            case=made.case, data=made.reduced.data, reduced=made.reduced, scatter=1.0
        )
        return return_findings(fitted)

    (one,) = said(moved(case, late.to_numpy(), np.array([0.0, 0.3e-3, 0.0])))
    assert one.startswith("The unloaded reflectors did not return in pose 2: they stand up to 0.3")
    assert said(case) == []
    nobody = replace(case, readings=rows.assign(**dict.fromkeys(covariance.columns(), np.nan)))
    assert said(moved(nobody, late.to_numpy(), np.array([0.0, 0.3e-3, 0.0]))) == []


def test_every_pull_knows_which_zeros_follow_it(case):
    """One of two in every pose."""
    assert (asked(case).reduced.data.pulls.zeros_after == 0.5).all()
