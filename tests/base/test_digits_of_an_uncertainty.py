"""Digits that an uncertainty justifies."""

import pytest

from pipeline.base.quantities import with_std


@pytest.mark.parametrize(
    ("std", "text"), [(0.0994, "1.234 ± 0.099"), (0.0996, "1.23 ± 0.10"), (9.96, "1 ± 10")]
)
def test_an_uncertainty_that_rounds_up_to_a_power_of_ten_loses_a_digit(std, text):
    assert with_std(1.2344, std) == text
