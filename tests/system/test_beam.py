"""Noise along and across the beam: found in campaigns of another machine, and only if present."""

from dataclasses import replace

import numpy as np
import pytest
from world_files import written

from bench.worlds.run import asked
from bench.worlds.worlds import SHEETS
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.store.campaign import in_memory
from pipeline.system.beam import BeamNoise, _taken
from pipeline.system.fit import beside_everything, fit
from pipeline.system.linearised import CurrentModel, linearise
from pipeline.system.noise_shape import shape


def fitted(world):
    """Fit the joint springs to a campaign of a world."""
    case = ingested(in_memory(written(world)[3]))
    return fit(case, bring(case))


@pytest.fixture(scope="module")
def polar():
    """A tracker with a range four times more accurate than its angles, stated as an rms."""
    return fitted("ot2_rms")


@pytest.fixture(scope="module")
def calm():
    """A tracker with isotropic noise, as stated."""
    return fitted("normal")


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("world", ["ot2_rms", "at960_angles", "vantage_rms"])
def test_a_tracker_of_its_data_sheet_has_no_tails(world):
    """One figure stated for range and angles: adequate, with a note that they differ."""
    answer = asked(written(world)[3]).answer

    assert answer["diagnosis"]["verdict"] == "adequate"
    assert "heavy_tails" not in [cause["name"] for cause in answer["diagnosis"]["causes"]]
    assert any("Along the beam the tracker scatters" in text for text in answer["findings"])
    parts = {one["name"]: one for one in answer["noise"]["components"]}
    assert parts["along_beam"]["found_over_stated"] < parts["across_beam"]["found_over_stated"]


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("world", "tailed"), [("at960_student3", True), ("vantage_bursts", True), ("ot2_rms", False)]
)
def test_tails_are_seen_beside_the_beam(world, tailed):
    """Tails or bursts in the readings of such a tracker are distinguished from others."""
    found = fitted(world)
    springs = CurrentModel(found.case.cell, found.estimate.value, found.case.robot.n)

    seen = shape(linearise(springs, found.plain, ()), ())

    assert seen.beam.better
    assert seen.tailed is tailed


@pytest.mark.slow
@pytest.mark.parametrize("world", ["at960_student3", "vantage_bursts"])
def test_tails_beside_the_beam_are_named(world):
    """The answer names the tails and accuses nobody for them."""
    answer = asked(written(world)[3]).answer

    assert answer["diagnosis"]["verdict"] == "adequate"
    assert "heavy_tails" in [cause["name"] for cause in answer["diagnosis"]["causes"]]


def test_both_parts_are_those_of_the_data_sheet(polar):
    """And the angular noise makes distant readings less accurate."""
    data, beam, sheet = polar.plain, polar.shape.beam, SHEETS["ot2"]
    far = np.linalg.norm(data.unloaded - data.tracker, axis=1)
    stated = np.sqrt(data.loaded_cov[0, 0, 0])
    along = (sheet.range_m + sheet.range_per_m * far.mean()) / stated
    across = (sheet.across_m + sheet.across_per_m * far) / stated

    assert beam.better
    assert beam.along == pytest.approx(along, rel=5 * beam.std[0])
    assert beam.across == pytest.approx(across, rel=0.25)


def test_what_is_stated_stays_where_it_holds(calm):
    """With isotropic noise, weights change by less than their uncertainty."""
    beam = calm.shape.beam

    assert beam.probability < 0.5
    assert not beam.better
    assert beam.along == pytest.approx(1, abs=0.05)
    assert beam.across == pytest.approx(1, abs=0.05)


def test_a_far_reading_is_no_blunder_for_its_angles(polar):
    """A reading far off in stated uncertainties is less so if noise across the beam is larger."""
    plain, of_beam = replace(polar.shape.family, widest=1.0), polar.shape.family

    assert of_beam.widest == pytest.approx(polar.shape.beam.across.max() ** 2)
    assert of_beam.widest > 1.5
    assert of_beam.mistaken(36.0 * of_beam.widest) == pytest.approx(plain.mistaken(36.0))


@pytest.mark.whole
def test_springs_are_known_better_by_the_range(polar):
    """Their uncertainties are smaller than with one figure for all directions."""
    case, reduced = polar.case, polar.reduced
    alone = fit(case, replace(reduced, data=replace(reduced.data, tracker=None)))
    ratio = np.sqrt(np.diag(polar.estimate.cov) / np.diag(alone.estimate.cov))

    assert alone.shape.beam.along == 1.0
    assert (ratio < 1).all()
    assert np.median(ratio) < 0.9


@pytest.mark.whole
def test_a_wrong_model_is_no_worse_angle(calm):
    """Model error across the beam is many times the noise, and changes no weight."""
    cell, data = calm.case.cell, calm.plain
    seen = linearise(CurrentModel(cell, calm.estimate.value, 7), data, ())
    beams = data.unloaded - data.tracker
    side = np.cross(beams, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    rng = np.random.default_rng(3)
    off = 2e-4 * rng.standard_normal(len(data.pulls))[data.pull, None] * side

    beam = shape(replace(seen, y=seen.y + off.ravel()), ()).beam

    assert beam.along > 0.85
    assert np.sqrt(np.mean(beam.across**2)) < 1.1
    assert not beam.better


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lost", ["tracker", "kind", "poses"])
def test_without_a_station_nothing_is_concluded(polar, lost):
    """A campaign of displacements, of a camera or of 6D poses has no beam."""
    changed = {"tracker": {"tracker": None}, "kind": {"tracked": False}, "poses": {"poses": True}}
    data = replace(polar.plain, **changed[lost])
    seen = beside_everything(polar.case.cell, polar.plain, polar.estimate.value)

    beam = shape(replace(seen, data=data)).beam

    assert (beam.along, beam.across.min(), beam.across.max()) == (1.0, 1.0, 1.0)
    assert beam.on(data) is data


def test_covariances_are_parted_by_the_beam(polar):
    """Variances along and across the beam are scaled, and scaled back exactly."""
    data = polar.plain
    across = np.linspace(0.5, 2.0, len(data.pull))
    beam = BeamNoise(0.25, across)
    weighed = beam.on(data)
    for d in (0, 17, len(across) - 1):
        u = data.unloaded[d] - data.tracker
        u /= np.linalg.norm(u)
        side = np.cross(u, [0.2, -0.4, 0.7])
        side /= np.linalg.norm(side)
        variance = data.loaded_cov[d, 0, 0]
        assert u @ weighed.loaded_cov[d] @ u == pytest.approx(variance / 16, rel=1e-9)
        assert side @ weighed.loaded_cov[d] @ side == pytest.approx(variance * across[d] ** 2)
    assert beam.off(weighed).zero_cov == pytest.approx(data.zero_cov, abs=1e-22)


@pytest.mark.parametrize(
    ("along", "across", "used"),
    [
        (0.3, 1.0, (0.3, 1.0)),  # the figure of the angles is stated
        (0.3, 1.2, (0.3, 1.2)),  # the rms over three axes
        (0.3, 3.0, (0.3, np.sqrt(1.455))),  # and an error of the model: 0.09 + 2 x 1.455 is 3
        (0.1, 0.5, (0.2, 1.0)),  # twice as much, as an MPE
        (1.0, 3.0, (1.0, 1.0)),  # an error of the model only
        (0.8, 0.8, (1.0, 1.0)),  # an overstated noise is left to other tests
    ],
)
def test_no_more_than_stated_in_all(along, across, used):
    """The smaller component is as found, the larger limited by the sum of the three variances."""
    found = _taken(along, np.full(4, across), 1.0)

    assert (found[0], found[1][0]) == pytest.approx(used)
