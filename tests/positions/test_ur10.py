"""The UR10 that ships with the project: real positions, predicted for left-out poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.library.kinematic_model import kinematic_model
from pipeline.library.target_model import predict
from pipeline.positions import law_tests
from pipeline.positions.estimate import solved
from pipeline.positions.positioned import as_read, usable
from pipeline.positions.study import study
from pipeline.store.campaign import find
from pipeline.system import alarms

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def campaign():
    raw = find(ROOT, "ur10_ipa").read()
    return raw, usable(raw.settings, raw.robot, *as_read(raw.settings, raw.robot, raw.files))


def taught(campaign, which):
    raw, read = campaign
    rows = np.flatnonzero(which)
    found = study(
        raw.robot, read.readings.part(rows), read.weights.part(rows), {}, None, (np.nan, np.nan),
        np.random.default_rng(1),
    )  # fmt: skip
    return found, kinematic_model("ur10", found.final)


def judged(model, readings):
    """Error of each target [m] after alignment of its series with the prediction (Kabsch)."""
    m = len(readings)
    told = predict(
        model, readings.q, np.zeros((m, 3)), np.zeros(m, dtype=np.int64), readings.temperature
    )
    off = np.empty((m, 3))
    for series in np.unique(readings.series):
        mine = readings.series == series
        a, b = told.at[mine, 0], readings.at[mine, 0]
        U, _, Vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
        R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
        off[mine] = a - ((b - b.mean(0)) @ R.T + a.mean(0))
    return off, told.std[:, 0, :3]


@pytest.mark.whole
def test_every_twentieth_pose_tells_the_table(campaign):
    """Too few for curves: with DH parameters and springs, other poses are nearer than nominal."""
    _, read = campaign
    few = np.arange(len(read.readings)) % 20 == 0

    found, model = taught(campaign, few)
    off, _ = judged(model, read.readings.part(~few))

    assert np.linalg.norm(off, axis=1).mean() < 0.45e-3
    letters = found.final.mechanism
    upper_arm = next(k for k, one in enumerate(letters.letters) if one.label == "link_length:3")
    assert letters.values[upper_arm] == pytest.approx(-0.8e-3, abs=0.15e-3)


@pytest.mark.slow
def test_poses_between_are_predicted_to_a_quarter_of_a_millimetre(campaign):
    _, read = campaign
    every = read.readings
    second = np.zeros(len(every), dtype=bool)
    for series in np.unique(every.series):
        second[np.flatnonzero(every.series == series)[::2]] = True

    _, model = taught(campaign, second)
    off, std = judged(model, every.part(~second))

    between = every.series[~second]
    for series in np.unique(between):
        assert np.linalg.norm(off[between == series], axis=1).mean() < 0.25e-3
    noise = 2.0e-5  # of a reading, from the standard deviations that the instrument gave
    inside = np.abs(off) < 1.96 * np.hypot(std, noise)
    assert 0.93 < inside.mean() < 0.97


@pytest.mark.slow
def test_one_series_predicts_the_other(campaign):
    _, read = campaign
    first = read.readings.series == 0

    found, model = taught(campaign, first)
    off, _ = judged(model, read.readings.part(~first))

    assert found.laws
    assert np.linalg.norm(off, axis=1).mean() < 0.41e-3
    for cause in found.causes:  # of other masses, or of tilts no larger than their uncertainty
        assert cause.name != "gravity_sag"
        assert max(abs(one.value) / one.std for one in cause.amounts) > 2


@pytest.mark.slow
def test_residuals_with_flipped_signs_name_no_law(campaign):
    """40 copies, estimated anew: the largest of all statistics is as large as by chance.

    Their robot is as its table says: the moments by these readings are 4.5 standard deviations from
    those of the table, which would be an effect in every copy.
    """
    _, read = campaign
    found, _ = taught(campaign, read.readings.series == 0)
    springs = found.stages[2].found
    known = springs.known
    known = replace(known, mean=springs.solution.x[: len(known.mean)].copy())
    rng = np.random.default_rng(3)
    slides = springs.mechanism.table.prismatic
    laws = list(law_tests.candidates(springs.linear.inputs, slides))
    plain = law_tests.score(springs, np.zeros((0, len(springs.readings)))).copied
    p = []
    for turned in law_tests.flips(springs.readings, rng, 40):
        rows = springs.rows
        again = replace(rows, y=rows.along(springs.solution.x) + turned[:, None] * plain)
        solution = solved(again, springs.mechanism, known)
        copy = replace(springs, rows=again, solution=solution, known=known)
        signs = law_tests.flips(copy.readings, rng, 200)
        first = law_tests.law_tests(copy, signs, laws, slides.tolist())
        p.append(min(clue.p for clue in first))
    assert min(p) >= alarms.LAW
    # uniform, or larger: Bonferroni's bound of two families
    assert np.mean(np.array(p) < 0.2) < 0.2 + 2.58 * np.sqrt(0.2 * 0.8 / 40)
