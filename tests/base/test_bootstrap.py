"""Bootstrap of poses: with two poses there are three possible draws, which can be listed."""

import numpy as np
import pytest

from pipeline.base.bootstrap import interval, unproven


@pytest.mark.parametrize("turned", [False, True])
def test_every_pose_is_drawn_the_last_one_too(turned):
    """One pose is worth a half and the other nothing: the interval goes from nothing to a half."""
    pose, before = np.array([0, 0, 1, 1]), np.ones(4)
    after = np.array([0.5, 0.5, 1.0, 1.0])
    pose = 1 - pose if turned else pose

    gain, ends = interval(before, after, pose, np.random.default_rng(1))

    assert gain == pytest.approx(1 - np.sqrt(0.625))  # mean of 1/4 and 1
    assert ends == pytest.approx((0.0, 0.5))  # each pose alone is drawn in a quarter of all


def test_what_a_quarter_of_all_draws_does_not_confirm_is_not_proven():
    """Only the pose without a gain, drawn twice: 1 in 4; e / 4 ln 4 = 0.942 at even odds."""
    pose, before = np.array([0, 0, 1, 1]), np.ones(4)
    after = np.array([0.5, 0.5, 1.0, 1.0])

    left = unproven(before, after, pose, np.random.default_rng(1))

    assert left == pytest.approx(1 - 1 / 1.942, abs=0.02)
    assert unproven(before, 0.9 * after, pose, np.random.default_rng(1)) == 0.0
    assert unproven(before, 1.1 * before, pose, np.random.default_rng(1)) == 0.5


def test_the_rarer_the_draws_without_a_gain_the_less_is_unproven():
    """Of three poses one without a gain, drawn thrice: 1 in 27; e / 27 ln 27 = 0.332."""
    after = np.array([0.5, 0.5, 1.0])

    left = unproven(np.ones(3), after, np.arange(3), np.random.default_rng(1))

    assert left == pytest.approx(1 - 1 / 1.332, abs=0.04)
