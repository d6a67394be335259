"""Laws as a file holds them, and a drift in the unit of what serves as its clock."""

from dataclasses import replace

import pytest

from pipeline.machine.effects import catalogue
from pipeline.machine.effects.tracker_drift import PER_GROUP, by_order
from pipeline.machine.law import Law, parse
from pipeline.machine.robot import load

WAVE = Law(3, "spring", "periodic", "angle", 2, 2.0, -1.5, 1.25)


@pytest.mark.parametrize(
    "law",
    [
        WAVE,
        replace(WAVE, beyond=True),
        Law("rail", "roll", "step", "position", 1, 0.0, 0.0, 12.0, at=3.5),
        replace(WAVE, more=replace(WAVE, order=4.0, beyond=True)),
    ],
    ids=["wave", "beyond", "step", "two shapes"],
)
def test_a_law_is_read_as_it_was_written(law):
    assert parse(str(law.where), law.form) == law


def test_a_drift_per_group_is_bounded_as_one_per_second_is():
    """Without times the unit changes: how far a bound is above the typical size does not."""
    drifts = [one for one in catalogue(load("kr500_rail")) if one.name == "tracker_drift"]
    (steady,) = [one for one in drifts if one.form == "steady"]
    (grouped,) = by_order(drifts)

    for before, after in zip(steady.parameters, grouped.parameters, strict=True):
        assert after.unit == PER_GROUP
        assert after.upper / after.typical == pytest.approx(before.upper / before.typical)
        assert after.lower == -after.upper
