"""Bootstrap intervals from poses drawn with replacement."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.tails import at_most

_DRAWS = 2000
"""Number of bootstrap samples: the ends of a 95 % interval are known to some per cent of its
length."""


def interval(
    before: Array, after: Array, pose: Ints, rng: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Reduction of the rms and its 95 % interval, poses drawn with replacement.

    1 - sqrt(sum_p A_p / sum_p B_p), where B_p and A_p are the sums of squared residuals [m^2] of
    pose p before and after; the interval is given by the 2.5 and 97.5 % quantiles of `_DRAWS`
    bootstrap samples of the poses (Efron, Annals of Statistics 7, 1979).
    """
    whole, drawn = _reductions(before, after, pose, rng)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return whole, (float(low), float(high))


def unproven(before: Array, after: Array, pose: Ints, rng: np.random.Generator) -> float:
    """Probability that the rms is not really reduced; 0 where the 95 % interval says that it is.

    At least 1 - P, with P the bound of `at_most` for the fraction p of samples of the poses without
    a reduction: 0.2 where p is 0.025, a half from p = 0.37 on.
    """
    drawn = _reductions(before, after, pose, rng)[1]
    if np.quantile(drawn, 0.025) > 0:
        return 0.0
    return 1.0 - at_most(float(np.mean(drawn <= 0)))


def _reductions(
    before: Array, after: Array, pose: Ints, rng: np.random.Generator
) -> tuple[float, Array]:
    """Reduction of the rms over all poses, and over each of the samples."""
    poses = pose.max() + 1
    squares = np.stack([np.bincount(pose, r**2, poses) for r in (before, after)])
    drawn = rng.integers(poses, size=(_DRAWS, poses))
    old, new = squares[0][drawn].sum(axis=1), squares[1][drawn].sum(axis=1)
    whole = squares.sum(axis=1)
    every = 1 - np.sqrt(new / np.maximum(old, 1e-300))
    return float(1 - np.sqrt(whole[1] / max(whole[0], 1e-300))), every
