"""Digits that an uncertainty justifies."""

import pytest

from pipeline.base.quantities import mix, plain, with_std


@pytest.mark.parametrize(
    ("std", "text"), [(0.0994, "1.234 ± 0.099"), (0.0996, "1.23 ± 0.10"), (9.96, "1 ± 10")]
)
def test_an_uncertainty_that_rounds_up_to_a_power_of_ten_loses_a_digit(std, text):
    assert with_std(1.2344, std) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (9.994e-10, "9.99 × 10⁻¹⁰"),
        (9.996e-10, "1.00 × 10⁻⁹"),
        (-9.9999e6, "-1.00 × 10⁷"),
        (5e-324, "5.00 × 10⁻³²⁴"),
    ],
)
def test_the_power_of_ten_is_that_of_the_rounded_number(value, text):
    """One digit before the point, also of the smallest number that there is."""
    assert plain(value) == text


def test_a_share_of_any_size_is_written_out():
    """One and minus one are left out, also as rounded; so small a share has its power of ten."""
    names = ["k_1", "k_2", "k_3", "k_4"]

    said = mix([1.0004, -0.58, 8.81e-6, -1.0], names)

    assert said == "k_1 - 0.580 k_2 + 8.81 × 10⁻⁶ k_3 - k_4"
