"""Rounding to the last digit of an export is an error of every coordinate."""

import csv
import io

import numpy as np
import pytest

from pipeline.reduction.bring import bring
from pipeline.reduction.digits import division, rounding
from pipeline.run import campaign_answer, ingested
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
    """With a tenth of a millimetre; with 1e-4 mm no value changes."""
    files = campaign(1)

    def variances(made):
        case = ingested(in_memory(made), plausible=False)
        return np.einsum("dii->di", bring(case).data.loaded_cov)

    before, after = variances(files), variances(rounded(files, 1))
    assert after - before == pytest.approx(np.full(before.shape, 1e-8 / 12))
    assert (variances(rounded(files, 4)) == before).all()


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(1, 7))
def test_coarse_digits_are_no_noise_of_the_tracker_and_accuse_no_reflector(seed):
    """They are reported as such."""
    said = campaign_answer("digits", in_memory(rounded(campaign(seed), 1))).answer

    assert said.diagnosis.verdict == "adequate"
    assert [one.name for one in said.diagnosis.causes] == []
    assert any("rounded to 0.1 mm" in line for line in said.findings)
    assert not any("base_" in line for line in said.findings)


@pytest.mark.parametrize("h", [0.1, 2.0, 5.0, 50.0, 5 * 9.80665, 10 * 9.80665])
def test_the_division_of_a_scale_is_found_in_newtons_and_kilograms(h):
    """The largest of which all readings are multiples; steps of the pulls are not divisions."""
    x = np.random.default_rng(2).uniform(300, 3500, 60)

    pose, steps = np.repeat(np.arange(20), 3), np.arange(500.0, 3001.0, 500.0)

    assert division(np.round(x / h) * h, pose) == pytest.approx(h)
    assert division(np.append(np.round(x / h) * h, np.nan), np.append(pose, 20)) == pytest.approx(h)
    assert division(np.tile([1000.0, 2000.0, 3000.0], 20), pose) == 0.0
    assert division(np.tile(steps, 9), np.repeat(np.arange(9), 6)) == 0.0
    assert division(np.tile(steps, 10), pose) == 0.0
    assert division(x, pose) == 0.0


def test_a_small_robot_on_a_crane_scale_shows_its_division_too():
    """Three steps in each pose, at most eighteen divisions: more values than two sets of steps."""
    rng = np.random.default_rng(4)
    full = rng.uniform(600, 900, 14)
    x = (full[:, None] * [1 / 3, 2 / 3, 1] * rng.uniform(0.97, 1.03, (14, 3))).ravel()

    assert division(50 * np.round(x / 50), np.repeat(np.arange(14), 3)) == pytest.approx(50)


def coarse(files, h):
    """The campaign read by a scale with divisions of h [N]."""
    rows = list(csv.reader(io.StringIO(files["loads.csv"].decode())))
    at = rows[0].index("force_n")
    for row in rows[1:]:
        row[at] = f"{round(float(row[at]) / h) * h:.2f}"
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return {**files, "loads.csv": text.getvalue().encode()}


def test_a_coarse_scale_makes_each_force_less_certain():
    """With a uniform distribution over a division; one finer than its scatter has no effect."""
    files = campaign(3)

    def variances(made):
        case = ingested(in_memory(made), plausible=False)
        return bring(case).data.reading_std ** 2

    before, after = variances(files), variances(coarse(files, 20.0))
    assert after == pytest.approx(400 / 12 + 4.0, rel=1e-3)
    assert before == pytest.approx(4.0, rel=1e-3)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(1, 7))
def test_many_readings_at_one_mark_of_a_coarse_scale_are_neither_copies_nor_noise(seed):
    """Divisions of 20 N where 2 N are stated; reported, and not a cause."""
    said = campaign_answer("coarse", in_memory(coarse(campaign(seed), 20.0))).answer

    assert said.diagnosis.verdict == "adequate"
    assert [one.name for one in said.diagnosis.causes] == []
    assert any("multiples of 20 N" in line for line in said.findings)
    assert not any(
        "multiples" in line
        for line in campaign_answer("x", in_memory(campaign(seed))).answer.findings
    )
