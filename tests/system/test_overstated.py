"""Noise stated far too large is detected and reported, and intervals no longer rely on it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pipeline.base.errors import InputError
from pipeline.reduction.settings import parse as settings_of
from pipeline.run import campaign_answer
from pipeline.store.campaign import in_memory

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"


def campaign(**stated):
    """The demo with other statements in campaign.toml; its true noise is 0.03 mm and 2 N."""
    files = {path.name: path.read_bytes() for path in DEMO.iterdir() if path.is_file()}
    text = files["campaign.toml"].decode()
    for key, value in stated.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        assert count == 1
    return in_memory(files | {"campaign.toml": text.encode()})


@pytest.fixture(scope="module")
def right():
    return campaign_answer("right", campaign()).answer


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"sigma_m": 3e-2}, ["[tracker] sigma_m states 30.0 mm", "scatter by 0.030 mm"]),
        ({"sigma_n": 2000.0}, ["[scale] states 2000 N for a reading", "times less"]),
        ({"sigma_rel": 0.5}, ["[scale] states 2.00 N and 50.000% for a reading"]),
    ],
)
def test_a_statement_a_thousand_times_too_large_is_told_and_not_used(right, stated, said):
    """The statement is reported with the noise found.

    Intervals are nearly those of the true noise.
    """
    answer = campaign_answer("wrong", campaign(**stated)).answer

    (told,) = [one for one in answer.findings if "every interval rests on" in one]
    assert all(part in told for part in said)
    assert told in answer.verdict_sentence
    for mine, true in zip(answer.stiffness, right.stiffness, strict=True):
        if true.identifiable:
            assert mine.identifiable
            off = abs(mine.compliance - true.compliance)
            assert off < 0.5 * true.compliance_std
            assert 0.8 < mine.compliance_std / true.compliance_std < 1.5


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("stated", [{}, {"sigma_m": 9e-5}, {"sigma_m": 1.5e-4, "sigma_n": 10.0}])
def test_a_cautious_statement_is_believed(right, stated):
    """A maximum permissible error as standard uncertainty, three to five times the scatter."""
    answer = campaign_answer("cautious", campaign(**stated)).answer if stated else right

    assert answer.fit.noise_from == "stated"
    assert not [one for one in answer.findings if "every interval rests on" in one]


@pytest.mark.parametrize("key", ["sigma_rel", "gain_sigma"])
def test_per_cent_are_no_relative_uncertainty(key):
    """One per cent is 0.01; with 1, not even the sign of a force would be known."""
    text = (DEMO / "campaign.toml").read_text()

    with pytest.raises(InputError, match=f"scale.{key}: 1.0 should be less than 1"):
        settings_of(text.replace(f"{key} = 0.0", f"{key} = 1.0"))
