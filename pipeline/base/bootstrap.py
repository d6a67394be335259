"""Bootstrap intervals from poses drawn with replacement."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array, Ints

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
    poses = pose.max() + 1
    squares = np.stack([np.bincount(pose, r**2, poses) for r in (before, after)])
    drawn = rng.integers(poses, size=(_DRAWS, poses))
    old, new = squares[0][drawn].sum(axis=1), squares[1][drawn].sum(axis=1)
    low, high = np.quantile(1 - np.sqrt(new / np.maximum(old, 1e-300)), [0.025, 0.975])
    whole = squares.sum(axis=1)
    return float(1 - np.sqrt(whole[1] / max(whole[0], 1e-300))), (float(low), float(high))
