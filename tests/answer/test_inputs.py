"""Report of readings that are far off and stay in use, and of those that were left out."""

import pytest

from pipeline.answer.inputs import lost_told
from pipeline.check.findings import doubt_findings
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
