"""A pose measured as one quantity: its targets carry only six independent coordinates.

Small motions of a rigid effector are d_i = s + w x l_i at targets l_i from their centroid. The
observed coordinates are

    s = mean d_i    and    L w = L N^-1 sum l_i x d_i,    N = sum |l_i|^2 I - l_i l_i',

both in metres, F_b, with L^2 = mean |l_i|^2: six rows instead of three per target. Changes of the
distances between targets that were computed from one pose contain only rounding.
"""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array

ROWS = ("position", "rotation")
"""Names of the two observed vectors s and L w, which replace the targets."""


def radius(points: Array) -> float:
    """L: root mean square distance of the targets (t, 3) from their centroid [m]."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def coordinates(levers: Array, moved: Array, size: float) -> Array:
    """The six coordinates of small motions of the targets.

    Args:
        levers: Targets relative to their centroid, F_b [m], shape (m, t, 3).
        moved: Their displacements [m], shape (m, t, 3) or (m, t, 3, k).
        size: L [m].

    Returns:
        s and L w [m], shape (m, 2, 3) or (m, 2, 3, k).
    """
    wide = moved if moved.ndim == 4 else moved[..., None]
    N = np.einsum("mti,mti->m", levers, levers)[:, None, None] * np.eye(3)
    N = N - np.einsum("mti,mtj->mij", levers, levers)
    w = linear.solve(N, np.cross(levers[..., None], wide, axis=2).sum(axis=1))
    out = np.stack([wide.mean(axis=1), size * w], axis=1)
    return out if moved.ndim == 4 else np.asarray(out[..., 0])
