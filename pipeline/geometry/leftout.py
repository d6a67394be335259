"""How well poses are predicted that took no part: one part of them left out at a time.

About one linearisation and with the scatter of all poses, an estimate without a part needs only
the sums of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.geometry.estimate import padded, precision, values
from pipeline.geometry.identify import Identified
from pipeline.geometry.mechanism import frame_of
from pipeline.geometry.readings import PositionReadings

PARTS = 10
"""Into how many the poses are cut."""

_ROUNDS = 40
"""Of Lloyd's algorithm, for parts of joint space."""

_NOT = 1e-12
"""Standard deviation of what is not estimated."""


def by_turns(readings: PositionReadings, parts: int = PARTS) -> Ints:
    """Every tenth pose in one part, so that what lies between is predicted, (m,)."""
    return np.arange(len(readings)) % parts


def by_space(readings: PositionReadings, rng: np.random.Generator, parts: int = PARTS) -> Ints:
    """Parts of joint space, by k-means of joint values over their standard deviations, (m,)."""
    q = readings.q / np.maximum(readings.q.std(axis=0), 1e-9)
    middle = q[rng.choice(len(q), parts, replace=False)]
    for _ in range(_ROUNDS):
        part = cKDTree(middle).query(q)[1]
        middle = np.stack([q[part == k].mean(axis=0) if (part == k).any() else middle[k]
                           for k in range(parts)])  # fmt: skip
    return np.asarray(part, dtype=np.int64)


def errors(found: Identified, part: Ints, without: Sequence[slice | Ints] = ()) -> Array:
    """Reading minus prediction of each pose, by an estimate without its part, (m, 6 t), F_b.

    Where a whole series is left out, its frame is fitted to its own readings.

    Args:
        found: The estimate.
        part: Part of each pose, (m,).
        without: Parameters that are held at zero.
    """
    rows, mechanism = found.rows, found.mechanism
    P, _ = precision(mechanism, found.known)
    for one in without:
        diagonal = np.arange(len(P))[one]
        P[diagonal, diagonal] += _NOT**-2
    mean = padded(found.known.mean, len(P))
    out = np.empty(found.linear.y.shape)
    for k in np.unique(part):
        mine = part == k
        own = rows.of(mine)
        alone = np.setdiff1d(found.readings.series[mine], found.readings.series[~mine])
        fixed = P.copy()
        for series in alone:
            fixed[frame_of(mechanism, series), frame_of(mechanism, series)] += _NOT**-2 * np.eye(6)
        e = own.y - own.along(values(rows.N - own.N, rows.b - own.b, fixed, mean))
        for series in alone:
            e = _aligned(own.D[:, :, frame_of(mechanism, series)], e,
                         found.readings.series[mine] == series)  # fmt: skip
        out[mine] = found.linear.spread(linear.solve(own.W, e))
    return out


def _aligned(D: Array, e: Array, mine: Bools) -> Array:
    """Whitened residuals (m, r) of a series beside a frame of its own, derivatives (m, r, 6)."""
    out = e.copy()
    K = D[mine].reshape(-1, 6)
    x = linear.least_squares(K, e[mine].reshape(-1))
    out[mine] = (e[mine].reshape(-1) - K @ x).reshape(e[mine].shape)
    return out


def distances(errors: Array, read: Bools) -> Array:
    """Length of each position's error [m], NaN where it was not read, shape (m, t)."""
    m = len(errors)
    off = errors.reshape(m, -1, 6)[..., :3]
    seen = read.reshape(m, -1, 6)[..., :3].all(axis=2)
    return np.where(seen, np.linalg.norm(off, axis=2), np.nan)
