"""Unloaded readings of pulls, with positions of the same robot known."""

import numpy as np

from pipeline.reduction.measured import _in_frame

AT = np.random.default_rng(1).uniform(-2, 2, (20, 3))


def test_a_frame_that_is_off_by_millimetres_is_taken_off():
    off = np.array([0.004, -0.002, 0.001])

    np.testing.assert_allclose(_in_frame(AT + off, AT), AT, atol=1e-12)


def test_targets_that_no_position_has_stay_where_they_are():
    """The relation of the frames is then unknown."""
    np.testing.assert_array_equal(_in_frame(AT, np.full(AT.shape, np.nan)), AT)
