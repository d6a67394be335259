"""The first estimate of tool points and frames, from readings with gross errors."""

from dataclasses import replace

import numpy as np
import pytest
from made_positions import ROBOT, read

from pipeline.positions.initial import begin


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [0.02, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_quarter_of_readings_far_off_hardly_moves_the_start(size, seed):
    """Tool points and frame stay within 0.15 mm, however far these readings are off."""
    readings, rng = read(100, seed=seed, targets=2), np.random.default_rng(seed)
    bad = rng.random(readings.at.shape[:2]) < 0.25
    at = readings.at + np.where(
        bad[..., None], size * (1 + rng.normal(size=readings.at.shape)), 0.0
    )
    sound, moved = (begin(ROBOT, replace(readings, at=one), {}) for one in (readings.at, at))

    np.testing.assert_allclose(moved.frames[..., :3, 3], sound.frames[..., :3, 3], atol=1.5e-4)
    np.testing.assert_allclose(moved.tool[:, :3, 3], sound.tool[:, :3, 3], atol=1.5e-4)
