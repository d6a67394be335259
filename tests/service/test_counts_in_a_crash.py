"""Integers in the report of an internal error."""

from pipeline.service.crash import shareable


def test_counts_below_a_thousand_stay_and_others_do_not():
    """250 rows may be a shape; 1234 and a force of 17.5 may be a measurement."""
    sent = shareable(ValueError("index 250 is out of bounds for size 64 not 1234 or 17.5"))

    assert "index 250 is out of bounds for" in sent
    assert "64" in sent
    assert "1234" not in sent
    assert "17.5" not in sent
