"""Sentence on a tracker that is stated noisier than it is."""

from types import SimpleNamespace

from pipeline.answer.contradictions import _tracker


def test_the_scatter_that_was_found_is_the_factor_times_the_stated_one():
    """30 mm stated for 30 um: the readings scatter by a thousandth, 0.03 mm."""
    said = SimpleNamespace(tracker=SimpleNamespace(sigma_m=0.03), displacements=None)
    text = _tracker(said, 1e-3)

    assert "states 30.0 mm" in text
    assert "scatter by 0.030 mm" in text
