"""Numbers as reports print them: digits, prefixes and limits, against arithmetic by hand."""

import math

import numpy as np
import pytest

from pipeline.base import quantities as q

NONE = (None, math.nan, math.inf, True, "1")


@pytest.mark.parametrize("value", NONE)
def test_what_is_no_finite_number_is_missing(value: object) -> None:
    """A dash in every form."""
    assert not q.known(value)
    said = [q.with_std(value, 1.0), q.plain(value), q.percent(value), q.probability(value)]
    assert said == [q.MISSING] * 4
    assert q.p_value(value) == "p unknown"


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (80.04, 1.64, "80.0 ± 1.6"),
        (-80.04, 1.64, "-80.0 ± 1.6"),
        (1234.5, 160.0, "1230 ± 160"),
        (0.5, 2000.0, "0 ± 2000"),
        (2.5e-8, 1.2e-9, "(2.50 ± 0.12) × 10⁻⁸"),
        (1.2e-9, 2.5e-8, "(0.1 ± 2.5) × 10⁻⁸"),
        (2.5e7, 1.2e6, "(2.50 ± 0.12) × 10⁷"),
        (5.0, 3e6, "(0.0 ± 3.0) × 10⁶"),
        (999999.0, 12000.0, "1000000 ± 12000"),
        (1e6, 12000.0, "(1.000 ± 0.012) × 10⁶"),
        (9.9e-4, 1e-5, "(9.90 ± 0.10) × 10⁻⁴"),
        (1e-3, 1e-5, "0.001000 ± 0.000010"),
        (1e-5, 1e-3, "0.0000 ± 0.0010"),
        (5.0, 0.0, "5.00"),
        (5.0, math.inf, "5.00"),
    ],
)
def test_two_digits_of_the_uncertainty_decide_those_of_the_value(
    value: float, std: float, text: str
) -> None:
    """Written out from 0.001 to a million, by the larger of both, else with a power of ten."""
    assert q.with_std(value, std) == text
    inside = text.startswith("(") or "±" not in text
    assert q.bracketed(value, std) == (text if inside else f"({text})")


@pytest.mark.parametrize(
    ("value", "expanded", "both"),
    [
        (1.23456, 0.0321, ("1.235", "0.032")),
        (1234.5, 321.0, ("1230", "320")),
        (1.5, 0.0, ("1.50", "0")),
        (1.5, 1e-16, ("1.50", "1.00 × 10⁻¹⁶")),
        (1.5, math.inf, ("1.50", q.MISSING)),
    ],
)
def test_a_value_has_the_place_of_its_expanded_uncertainty(
    value: float, expanded: float, both: tuple[str, str]
) -> None:
    """Also where that is nothing or unknown."""
    assert q.with_uncertainty(value, expanded) == both


@pytest.mark.parametrize(
    ("bounds", "std", "text"),
    [
        ((76.91, 83.13), 1.6, "76.9 to 83.1"),
        ((76.91, None), 1.6, "above 76.9"),
        ((None, 83.13), 1.6, "below 83.1"),
        ((76.91, math.inf), 1.6, "above 76.9"),
        ((76.912, 83.129), None, "76.9 to 83.1"),
        ((76.912, 83.129), 0.0, "76.9 to 83.1"),
        ((0.76912, 83.129), None, "0.769 to 83.1"),
        ((None, None), 1.6, q.MISSING),
        (None, 1.6, q.MISSING),
    ],
)
def test_an_interval_has_the_ends_that_it_has(
    bounds: tuple[float | None, float | None] | None, std: float | None, text: str
) -> None:
    """In the digits of the uncertainty, or three of each end."""
    assert q.interval(bounds, std) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (1234.5, "1230"),
        (0.00012345, "0.000123"),
        (0.000099, "9.90 × 10⁻⁵"),
        (999_900.0, "1000000"),
        (1e6, "1.00 × 10⁶"),
        (-2.5, "-2.50"),
    ],
)
def test_three_digits_of_a_number_by_itself(value: float, text: str) -> None:
    """From a ten-thousandth to a million without a power of ten."""
    assert q.plain(value) == text


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (0.9991, "over 99.9 %"),
        (0.9989, "99.9 %"),
        (0.9912, "99.1 %"),
        (0.9876, "99 %"),
        (0.123, "12 %"),
        (0.001, "0.10 %"),
        (0.00099, "below 0.1 %"),
    ],
)
def test_nothing_is_quite_certain(p: float, text: str) -> None:
    """Above 99 % a third digit, at both ends a bound."""
    assert q.probability(p) == text


def test_ratios_and_p_values() -> None:
    """Two digits; a p-value no smaller than a millionth."""
    assert [q.percent(0.0123), q.percent(2.5, 3)] == ["1.2 %", "250 %"]
    assert [q.p_value(0.333), q.p_value(1e-6), q.p_value(9e-7)] == [
        "p = 0.33",
        "p = 1.0 × 10⁻⁶",
        "p < 10⁻⁶",
    ]


@pytest.mark.parametrize(
    ("values", "factor", "letter"),
    [
        ([1.0, 20.0, 999.0], 1.0, ""),
        ([1000.0], 1e3, "k"),
        ([-2.5e6, None, 0.0, 4e6, math.nan], 1e6, "M"),
        ([1e-9, 2e-8, 3e-8], 1e-9, "n"),
        ([5e-4], 1e-6, "µ"),
        ([1e-3], 1e-3, "m"),
        ([1e-20], 1e-9, "n"),
        ([1e20], 1e9, "G"),
        ([1.0, 2.0, 3e4, 4e4], 1e3, "k"),
        ([0.0, None], 1.0, ""),
        ([], 1.0, ""),
    ],
)
def test_a_column_has_the_prefix_of_its_middle(
    values: list[float | None], factor: float, letter: str
) -> None:
    """In thousands, within the prefixes that there are: the middle is 1 to 999 of the unit."""
    assert q.common_prefix(values) == (pytest.approx(factor), letter)


def test_units_with_a_prefix() -> None:
    """On the first factor; a value is divided by the same number, what is none stays so."""
    assert q.prefixed("N m/rad", "M") == "MN·m/rad"
    assert q.prefixed("", "M") == ""
    assert q.scaled(2500.0, 1e3) == 2.5
    assert q.scaled(None, 1e3) is None


def test_a_mix_begins_with_its_own_sign() -> None:
    """Weights of one are left out."""
    assert q.mix([-1.0, 0.5], ["a", "b"]) == "-a + 0.500 b"
    assert q.mix([-2.0], ["a"]) == "-2.00 a"
    assert q.mix([], []) == ""


def test_a_quantity_is_typeset_in_one_piece() -> None:
    """Powers as people write them, no line break between number and unit; names stay."""
    hard = "\N{NO-BREAK SPACE}"
    assert q.typeset("3e-08 m/N") == f"3{hard}×{hard}10⁻⁸{hard}m/N"
    assert q.typeset("5 +- 1 mm") == f"5{hard}±{hard}1{hard}mm"
    assert q.typeset("file 1e-05 stays") == "file 1e-05 stays"


def test_numbers_are_compared_by_six_digits() -> None:
    """Half a unit of the sixth digit: what differs by less is one number, by more two."""
    from pipeline.base.arrays import compared

    rng = np.random.default_rng(1)
    x = rng.uniform(1, 10, 500) * 10.0 ** rng.integers(-12, 12, 500) * rng.choice([-1, 1], 500)
    expected = [float(f"{one:.5e}") for one in x]
    np.testing.assert_allclose(compared(x), expected, rtol=1e-12)
    assert compared([0.0, np.inf, -np.inf]).tolist() == [0.0, np.inf, -np.inf]
    assert np.isnan(compared(np.nan))
