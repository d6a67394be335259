"""Reference campaigns: our estimates against values certified in 50-digit arithmetic."""

import json
from dataclasses import replace

import pytest

from bench.reference.lre import CASES, agreement, certified, compared, estimated, names

STATED = ("zeros", "common", "weights", "poses")
"""Cases whose standard uncertainties need no scatter found by iteration."""


@pytest.mark.whole
@pytest.mark.parametrize("case", names())
def test_nine_digits_are_right(case):
    """Of every estimate and of the sum of squares, however ill-conditioned the poses."""
    one = agreement(case)

    assert one.value >= 9
    assert one.squares >= 9
    assert one.std >= (9 if case in STATED else 4.9)


def test_a_wrong_ninth_digit_is_seen():
    """One compliance of seven that is off by 2e-9 is not nine digits."""
    ours = estimated("plain")
    off = replace(ours, value=(*ours.value[:6], ours.value[6] * (1 + 2e-9)))

    assert compared("plain", ours).value > 12
    assert compared("plain", off).value == pytest.approx(8.7, abs=0.01)
    assert compared("plain", off).std == compared("plain", ours).std


def test_the_cases_are_twelve_and_certified():
    """Each folder has its answer, with a value for every joint of its robot."""
    assert sorted(names()) == sorted(path.name for path in CASES.iterdir())
    assert len(names()) == 12
    assert {len(certified(case).value) for case in names()} == {2, 6, 7}


@pytest.mark.slow
@pytest.mark.parametrize("case", names())
def test_the_certified_values_follow_from_the_files(case):
    """Solved again with 50 digits, they are the same to the last digit that is written."""
    pytest.importorskip("mpmath", reason="extra `bench`")
    from bench.reference.certify.__main__ import _written
    from bench.reference.certify.answers import certify
    from bench.reference.certify.campaign import load

    said = json.loads((CASES / case / "certified.json").read_text("utf-8"))

    assert _written(case, certify(load(CASES / case))) == said
