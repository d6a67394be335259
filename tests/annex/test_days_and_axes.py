"""Dates and axes as a report writes them."""

from types import SimpleNamespace

import pytest

from pipeline.annex.identity import _when
from pipeline.annex.words import at, from_label


@pytest.mark.parametrize(
    ("last", "said"),
    [
        ("2026-11-03T17:45:10", "2026-11-03 08:10 to 17:45"),
        ("2026-11-04T09:05:00", "2026-11-03 08:10 to 2026-11-04 09:05"),
    ],
)
def test_the_day_of_the_last_reading_is_given_if_it_is_another(last, said):
    found = SimpleNamespace(first="2026-11-03T08:10:00", last=last)

    assert _when(None, found) == said


def test_the_place_of_a_label_is_the_axis_of_the_controller():
    """`joint_tilt:3` is at joint 3, A2 of the controller; a place in letters stays."""
    axes = {3: "A2"}

    assert "A2" in from_label("joint_tilt:3", axes)
    assert from_label("joint_tilt:3", axes) == at("joint_tilt", 3, axes)
