"""Copies of residuals without a law must be as large as the noise from which residuals arise."""

import numpy as np
import pytest
from test_geometry import made

from pipeline.geometry.law_tests import _as_noise, flips

POSES, ROWS, KNOWN, DRAWS = 30, 9, 60, 300


def test_residuals_of_few_poses_are_made_as_large_as_noise():
    """With 270 readings, 60 parameters take a fifth of the noise, which is restored by pose.

    Otherwise a law found in noise exceeds copies that are all a fifth too small.
    """
    rng = np.random.default_rng(4)
    X = rng.normal(size=(POSES * ROWS, KNOWN)) * rng.uniform(0.2, 3.0, (POSES * ROWS, 1))
    hat = X @ np.linalg.pinv(X)
    blocks = np.stack([hat[k : k + ROWS, k : k + ROWS] for k in range(0, len(hat), ROWS)])
    noise = rng.normal(size=(DRAWS, len(hat)))
    left = (noise - noise @ hat).reshape(DRAWS, POSES, ROWS)
    copied = np.array([_as_noise(blocks, one) for one in left])

    assert np.mean(left**2) == pytest.approx(1 - KNOWN / len(hat), abs=0.02)
    assert np.mean(copied**2, axis=(0, 2)) == pytest.approx(1.0, abs=0.15)
    assert np.mean(copied**2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("poses", [30, 45, 90, 400])
def test_copies_of_few_poses_differ(poses):
    """A copy and its mirror image give the same T: blocks of eight of 30 poses make eight."""
    rng = np.random.default_rng(6)
    signs = flips(made(poses, rng), rng)
    kinds = np.unique(signs * signs[:, :1], axis=0)

    assert len(kinds) > 0.99 * len(signs)
