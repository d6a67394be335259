"""Numbers as people read them: prefixes of columns, and values to the digits of their U."""

import pytest

from pipeline.base.quantities import common_prefix, with_uncertainty


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ([80.0, 3.8e6, 5.1e6], (1e6, "M")),  # a single soft joint does not rule the column
        ([2.0e-9, None, 4.0e-9], (1e-9, "n")),
        ([0.0, float("nan")], (1.0, "")),
        ([1e14], (1e9, "G")),  # beyond the largest prefix
    ],
)
def test_a_column_has_the_prefix_of_its_median(values, found):
    factor, letter = common_prefix(values)

    assert (factor, letter) == (pytest.approx(found[0]), found[1])


@pytest.mark.parametrize(
    ("value", "expanded", "texts"),
    [
        (0.92437, 0.0716, ("0.924", "0.072")),
        (1234.5, 96.0, ("1234", "96")),
        (1234.5, 996.0, ("1200", "1000")),
        (0.5, 0.0, ("0.500", "0")),
    ],
)
def test_value_and_expanded_uncertainty_end_at_the_same_place(value, expanded, texts):
    assert with_uncertainty(value, expanded) == texts
