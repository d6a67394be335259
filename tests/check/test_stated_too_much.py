"""Sentence on a tracker that is stated noisier than it is."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.answer.values import _rests_on
from pipeline.check.contradictions import _tracker, along_the_beam
from pipeline.system.beam import BeamNoise


def test_the_scatter_that_was_found_is_the_factor_times_the_stated_one():
    """30 mm stated for 30 um: the readings scatter by a thousandth, 0.03 mm."""
    said = SimpleNamespace(tracker=SimpleNamespace(sigma_m=0.03), displacements=None)
    text = _tracker(said, 1e-3)

    assert "states 30.0 mm" in text
    assert "scatter by 0.030 mm" in text


@pytest.mark.parametrize(
    ("weighed", "noise_from", "said"),
    [
        (False, "stated", "Uncertainties, chi-squared and its p-value rest on the noise stated"),
        (True, "stated", "Uncertainties rest on the scatter found in the readings, 0.63 times the"),
        (True, "replicates", "rest on the noise found in the data, 0.63 times the noise stated"),
    ],
)
def test_what_the_uncertainties_rest_on_is_said(weighed, noise_from, said):
    """Readings weighed by their own scatter do not depend on the noise stated for them."""
    shape, noise = SimpleNamespace(weighed=weighed), SimpleNamespace(stated=True)
    fitted = SimpleNamespace(shape=shape, noise=noise, scatter=0.633)

    assert said in _rests_on(fitted, noise_from)


@pytest.mark.parametrize(
    ("model", "noise", "way"),
    [
        (None, None, "give its type as [instrument] model"),
        ("Leica AT960", None, "leave out [tracker] sigma_m"),
        ("Leica AT960", "sheet", ""),
        ("own make", None, "To state them yourself, give both parts as [tracker] noise."),
    ],
)
def test_what_is_stated_of_the_beam_is_not_asked_for(model, noise, way):
    """Both sizes are those found, and the way out is one that was not taken yet."""
    settings = SimpleNamespace(reading_noise=noise, instrument=SimpleNamespace(model=model))
    beam = BeamNoise(0.6, np.ones(3), found=(0.42, 0.67), probability=1.0, p_value=0.0)

    (said,) = along_the_beam(settings, beam)
    assert said.startswith("Along the beam the tracker scatters 2.4 times less than stated, across "
                           "it 0.67 times as much: every reading is weighed by both.")  # fmt: skip
    assert way in said
    assert ("To state" in said) == bool(way)
