"""Typing errors in numbers: the intended one is found, none if the value is merely inaccurate."""

import numpy as np
import pytest

from pipeline.faults.scale_reading import _meant
from pipeline.faults.typing_errors import factor, intended


@pytest.mark.parametrize(
    ("given", "meant", "slip"),
    [
        (2894.6, 2984.6, "two digits exchanged"),
        (298.46, 2984.6, "the decimal point in the wrong place"),
        (120792.0, 1207.92, "the decimal point in the wrong place"),
        (12079.2, 1207.92, "the decimal point in the wrong place"),
        (1984.6, 2984.6, "one digit wrong"),
        (284.6, 2984.6, "one digit lost"),
        (23984.6, 2984.6, "one digit too many"),
    ],
)
def test_the_number_that_was_meant(given, meant, slip):
    """The pulls determine it to a few newtons; the typing error follows from that."""
    found = intended(given, meant + 3.0, 4.0)
    assert found is not None
    assert found[0] == pytest.approx(meant)
    assert found[1] == slip


@pytest.mark.parametrize(
    ("fits", "meant", "slip"),
    [(91.3, 893 / 9.80665, "read in N"), (89.1, 89.3, "the decimal point in the wrong place")],
)
def test_a_unit_competes_with_a_decimal_point(fits, meant, slip):
    """893 below a title in kgf, known to 2 kgf: 91.1 kgf or 89.3 kgf, whichever is nearer."""
    found = intended(893.0, fits, 2.0, {"N": 1 / 9.80665, "lbf": 0.45359237})

    assert found == (pytest.approx(meant), slip)


def test_a_number_that_no_slip_explains_has_no_other_meaning():
    """Between the numbers that one typing error can produce, nothing is proposed."""
    assert intended(2984.6, 2451.0, 2.0) is None
    rng = np.random.default_rng(1)
    hits = [intended(2984.6, fits, 0.05) for fits in rng.uniform(1000, 2900, 300)]
    assert sum(one is not None for one in hits) < 10


@pytest.mark.parametrize(
    ("given", "fits", "times"),
    [(2736.0, 2487.0, 1.1), (2736.0, 2350.0, None), (2487.0, 2487.0, None), (4974.0, 2487.0, None)],
)
def test_a_factor_in_tenths_may_fit_as_well(given, fits, times):
    """2487 N logged times 1.1; no factor in between, and neither 1 nor 2."""
    assert factor(given, fits, 10.0) == times


def test_a_wrong_digit_is_no_more_likely_than_a_factor_that_fits():
    """Where 2510 N fit, 2536 N by one digit or 2487 N times 1.1; where 2550 N fit, the former."""
    both = _meant(2736.0, 2510.0, 10.0, "N", {})
    assert both == (
        "; one digit wrong, 2536 N may have been meant, but 2487 N times 1.1 agrees as well"
    )
    assert _meant(2736.0, 2550.0, 10.0, "N", {}).endswith("2536 N may have been meant")
