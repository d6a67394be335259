"""Units of length: every word for one is that unit, and both ways lead back."""

import numpy as np
import pytest

from pipeline.dialects._unit_words import UNIT_WORDS
from pipeline.readers._units import in_unit, metres

RAIL = {  # 18 m in each unit, by the definitions of 1893 and 1959
    "mm": 18000.0, "cm": 1800.0, "m": 18.0, "um": 18e6,
    "in": 18 / 0.0254, "ft": 18 / (12 * 0.0254), "ftUS": 18 * 39.37 / 12,
}  # fmt: skip


@pytest.mark.parametrize("unit", sorted({*UNIT_WORDS.values()}))
def test_a_rail_has_its_length_in_every_unit(unit):
    """There and back."""
    assert metres(np.array([RAIL[unit]]), unit) == pytest.approx([18.0], rel=1e-15)
    assert in_unit(np.array([18.0]), unit) == pytest.approx([RAIL[unit]], rel=1e-15)


def test_a_survey_foot_is_not_a_foot():
    """Two millionths longer: 36 um of this rail."""
    assert metres(np.array([RAIL["ft"]]), "ftUS")[0] - 18 == pytest.approx(36e-6, rel=1e-3)


def test_millimetres_are_rounded_once():
    """0.001 is no number of a computer: times 0.001 would be rounded twice."""
    assert metres(np.array([1234.567]), "mm")[0] == 1.234567
