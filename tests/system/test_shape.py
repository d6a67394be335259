"""Shape of the noise in whole campaigns of another machine, and its effect on V."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from small_case import small
from world_files import written

from bench.worlds.run import asked
from pipeline.faults.screen import Screened, ScreeningBase, singles_of
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble
from pipeline.system.beam import BeamNoise
from pipeline.system.estimate import solve
from pipeline.system.family import FREEDOM, Family
from pipeline.system.fit import fit
from pipeline.system.linearised import CurrentModel, linearise
from pipeline.system.noise_shape import NoiseShape, goodness, shape, tails
from pipeline.system.rows_by_pose import free


@pytest.fixture(scope="module")
def case():
    """Six poses, each pulled twice."""
    return small()


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("world", "name"),
    [
        ("student3", "heavy_tails"),
        ("wander10", "tracker_wander"),
        pytest.param("bursts", "heavy_tails", marks=pytest.mark.slow),
    ],
)
def test_noise_of_another_family_is_named_and_accuses_nobody(world, name):
    """Readings of a machine that shares no formula with the package.

    Adequate, with the family named.
    """
    answer = asked(written(world)[3]).answer

    assert answer["diagnosis"]["verdict"] == "adequate"
    names = [cause["name"] for cause in answer["diagnosis"]["causes"]]
    assert name in names
    assert not set(names) - {"heavy_tails", "tracker_wander"}  # and not larger noise in addition
    said = [line["text"] for line in answer["first_screen"] if line["about"] == "wrong"]
    words = {"heavy_tails": "(heavy tails)", "tracker_wander": "The instrument wanders by"}
    assert words[name] in said[0]
    assert said[-1].startswith("Nothing else detectable")


@pytest.mark.whole
def test_a_wander_within_the_stated_noise_is_no_cause():
    """The same wander of one sigma, where three times the noise is stated."""
    files = dict(written("wander10")[3])
    text, count = re.subn(rb"sigma_m *= 3e-5", b"sigma_m = 9e-5", files["campaign.toml"])
    assert count == 1

    answer = asked(files | {"campaign.toml": text}).answer

    assert answer["diagnosis"]["verdict"] == "adequate"
    assert "tracker_wander" not in [cause["name"] for cause in answer["diagnosis"]["causes"]]


@pytest.mark.whole
@pytest.mark.parametrize(("world", "out"), [("normal", True), ("student3", False)])
def test_a_reading_is_judged_by_the_tails_beside_the_accepted_model(world, out):
    """20 sigma.

    Impossible with normal noise, one reading in 5000 with Student's of 3 degrees of freedom.
    """
    case = ingested(in_memory(written(world)[3]))
    reduced = bring(case)
    row = reduced.placed[reduced.placed["state"] == "loaded"].iloc[7]
    here = (case.readings["line"] == row["line"]) & (case.readings["file"] == row["file"])
    off = np.where(here, 20 * 3e-5, 0.0)
    given = replace(case, readings=case.readings.assign(x_m=case.readings["x_m"] + off))
    right = fit(given, bring(given))
    model = CurrentModel(case.cell, right.estimate.value, 7)
    family = tails(linearise(model, bring(given).data, ()), ())[1]

    held = singles_of(
        Screened((), given), None, ScreeningBase(case.cell, right.estimate.value, family)
    )

    assert family.likely_heavy is not out
    where = f"{row['group']}/{row['target']}"
    assert ([one.where for one in held.findings] == [where]) is out
    assert (where in [one.where for one in held.doubted]) is not out


def test_a_doubt_about_the_tails_is_none_about_a_reading_far_off():
    """Tails are taken as stated if that is more probable, otherwise as large as they may be."""
    family = Family.stated()
    weight = np.zeros(len(family.weight))
    for heavy, sure in ((0.17, True), (0.6, False)):
        weight[[0, 8]] = 1 - heavy, heavy
        unsure = replace(family, weight=weight.copy())
        assert unsure.mistaken(12.0**2) < 0.9
        assert (unsure.rather.mistaken(12.0**2) > 0.9) is sure


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize("off_m", [0.0, 1e-4])
@pytest.mark.parametrize("world", ["normal", "wander10"])
def test_what_goes_with_the_pull_is_no_noise(world, off_m):
    """Random rotations of the robot in each pose, in proportion to the pull, hide no wander."""
    raw = in_memory(written(world)[3])
    case = ingested(raw)
    right = fit(case, bring(case))
    seen = linearise(CurrentModel(case.cell, right.estimate.value, 7), right.plain, ())
    columns = free(seen)
    size = off_m / np.sqrt(np.mean(np.sum(columns**2, axis=1)))
    y = seen.y + columns @ (size * np.random.default_rng(5).standard_normal(columns.shape[1]))

    beside_springs = shape(replace(seen, y=y), ())
    beside_free = shape(replace(seen, y=y), (), loose=True)

    assert beside_free.likely is (world == "wander10")
    assert beside_springs.likely is (world == "wander10" or off_m > 0)


@pytest.mark.whole
def test_a_noisy_pose_stays_one_from_round_to_round():
    """Its readings scatter three times as much; weighed so, they would say no more of that."""
    case = ingested(in_memory(written("normal")[3]))
    right = fit(case, bring(case))
    seen = linearise(CurrentModel(case.cell, right.estimate.value, 7), right.plain, ())
    pose, rng = int(np.unique(seen.rows.pose)[3]), np.random.default_rng(2)
    zero, loaded = (
        np.sqrt(8) * 3e-5 * rng.standard_normal(shape) for shape in ((3, 3), (len(seen.y), 1))
    )
    more = loaded[:, 0] - zero[seen.data.target].ravel()
    y = seen.y + np.where(seen.rows.pose == pose, more, 0.0)

    readings, found, variance, _ = tails(replace(seen, y=y), ())

    mine = (readings.state[:, 0] == pose) & (readings.state[:, 1] >= 0)
    assert found.in_spells
    assert np.median(variance[mine]) > 5 * np.median(variance[~mine])


@pytest.mark.whole
@pytest.mark.parametrize("times", [1.5, 2.0])
def test_noise_stated_too_large_is_white(times):
    """Each reading then has the variance that is there, and nothing is left for a wander."""
    case = ingested(in_memory(written("normal")[3]))
    right = fit(case, bring(case))
    d = len(right.plain.pull)
    stated = right.plain.reweighed(np.full(d, times**2), np.full(d, times**2))
    found = shape(linearise(CurrentModel(case.cell, right.estimate.value, 7), stated, ()), ())

    assert not found.likely
    assert np.median(found.variance) == pytest.approx(1 / times**2, rel=0.15)


def test_a_wander_couples_the_displacements_of_a_pose(case):
    """Covariance of two displacements from the wander alone: F F' within a pose, otherwise zero."""
    data, start = bring(case).data, case.robot.nominal_compliance
    factor = 1e-5 * np.random.default_rng(1).standard_normal((len(data.pull), 3, 2))
    without = assemble(case.cell, data, start).errors
    errors = assemble(case.cell, replace(data, wander=factor), start).errors
    V = (errors.G @ errors.G.T - without.G @ without.G.T).toarray()
    pose = data.pulls.pose[data.pull]
    for a, b in [(0, 0), (0, 2), (0, 4), (1, 5), (0, len(pose) - 1)]:
        expected = factor[a] @ factor[b].T * (pose[a] == pose[b])
        assert V[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] == pytest.approx(expected, abs=1e-18)


def test_readings_are_weighed_and_unweighed(case):
    """Weights put into a campaign can be removed again, with each reading's own variance."""
    fitted = fit(case, bring(case))
    n = len(fitted.shape.variance)
    found = replace(fitted.shape, variance=np.linspace(0.5, 4.0, n), weighed=True)
    shape = replace(found, beam=BeamNoise.stated(fitted.plain))
    weighed, d = shape.on(fitted.plain), len(fitted.plain.pull)

    assert weighed.loaded_cov == pytest.approx(
        fitted.plain.loaded_cov * shape.variance[:d, None, None]
    )
    back = shape.off(weighed)
    assert back.zero_cov == pytest.approx(fitted.plain.zero_cov)
    assert back.wander is None
    both = found.off(found.on(fitted.plain))
    assert both.loaded_cov == pytest.approx(fitted.plain.loaded_cov, abs=1e-20)


def test_a_misfit_of_normal_noise_is_chi_square(case):
    """And the misfit of Student's noise is as drawn by numpy, reading by reading."""
    fitted = fit(case, bring(case))
    system = assemble(case.cell, fitted.plain, fitted.estimate.value)
    chi2, rng = solve(system, fitted.estimate.value).chi2, np.random.default_rng(1)
    normal = NoiseShape.unseen(fitted.plain)
    dof = len(system.rows) - 7
    found = goodness(system, normal, rng)

    assert (found.chi2, found.dof) == pytest.approx((chi2, dof))
    assert found.p_value == pytest.approx(stats.chi2.sf(chi2, dof), rel=1e-9)
    stated = Family.stated()
    weight = np.zeros(len(stated.weight))
    weight[1 + FREEDOM.index(5.0)] = 1.0
    scale = np.full(len(weight), np.log(3 / 5))  # stated variances
    seen = replace(normal, family=replace(stated, weight=weight, log_scale=scale))
    high = float(stats.chi2.isf(0.01, dof))
    off = replace(system, c=system.c * np.sqrt(high / chi2))
    carried = goodness(off, replace(seen, weighed=True), rng)
    assert goodness(off, seen, rng).p_value == pytest.approx(
        stats.chi2.sf(goodness(off, seen, rng).chi2, dof)
    )
    assert 0.01 < carried.p_value < 0.15  # several times as often as with normal noise
    assert carried.dof < carried.chi2 < 1.3 * goodness(off, seen, rng).chi2
