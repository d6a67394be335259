"""The last digit of an export is an error of every coordinate."""

import csv
import io

import numpy as np
import pytest

from pipeline.reduction.bring import bring, conformed, plain
from pipeline.reduction.digits import rounding
from pipeline.run import answered, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

WAYS = [(1, 1e-3), (2, 1e-3), (4, 1e-3), (4, 1.0), (3, 0.0254)]


@pytest.mark.parametrize(("digits", "unit"), WAYS)
def test_the_last_digit_is_found_in_whatever_unit(digits, unit):
    """Uniform over a step h: h / sqrt(12)."""
    x = np.random.default_rng(1).uniform(-5, 5, (200, 3))
    step = unit * 10.0**-digits

    assert rounding(np.round(x / step) * step) == pytest.approx(step / np.sqrt(12))
    assert rounding(x) == 0.0
    assert rounding(np.zeros((0, 3))) == 0.0


def rounded(files, digits):
    """The campaign with fewer digits in its export."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    for row in rows[1:]:
        row[2:5] = [f"{float(x):.{digits}f}" for x in row[2:5]]
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return {**files, "tracker.csv": text.getvalue().encode()}


def campaign(seed):
    return dict(simulate(Plan(name="digits", seed=seed, poses={"count": 10})).files)


def test_the_variance_of_the_last_digit_is_in_that_of_every_reading():
    """With a tenth of a millimetre; with a ten-thousandth no number moves."""
    files = campaign(1)

    def variances(made):
        case = ingested(in_memory(made), conformed, plain, plausible=False)
        return np.einsum("dii->di", bring(case).data.loaded_cov)

    before, after = variances(files), variances(rounded(files, 1))
    assert after - before == pytest.approx(np.full(before.shape, 1e-8 / 12))
    assert (variances(rounded(files, 4)) == before).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(1, 7))
def test_coarse_digits_are_no_noise_of_the_tracker_and_accuse_no_reflector(seed):
    """They are said as what they are."""
    said = answered("digits", in_memory(rounded(campaign(seed), 1))).answer

    assert said.diagnosis.verdict == "adequate"
    assert [one.name for one in said.diagnosis.causes] == []
    assert any("rounded to 0.1 mm" in line for line in said.findings)
    assert not any("base_" in line for line in said.findings)
