"""Report of readings that are far off and stay in use."""

from pipeline.answer.inputs import doubt_findings


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
