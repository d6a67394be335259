"""Cross-validation: prediction of poses that are held out, one part at a time.

About one linearisation and with the scatter of all poses, an estimate without a part needs only the
sums over the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import FIXED_SIGMA, ReadRows, factored, padded, precision
from pipeline.positions.mechanism import frame_of
from pipeline.positions.readings import PositionReadings

PARTS = 10
"""Number of parts into which the poses are divided."""

_ROUNDS = 40
"""Number of iterations of Lloyd's algorithm for the parts of joint space."""


def by_turns(readings: PositionReadings, parts: int = PARTS) -> Ints:
    """Part of each pose, (m,): every tenth pose, so that neighbours in time remain."""
    return np.arange(len(readings)) % parts


def by_space(readings: PositionReadings, rng: np.random.Generator, parts: int = PARTS) -> Ints:
    """Part of each pose, (m,): k-means of joint values over their standard deviations."""
    q = readings.q / np.maximum(readings.q.std(axis=0), 1e-9)
    middle = q[rng.choice(len(q), parts, replace=False)]
    for _ in range(_ROUNDS):
        part = cKDTree(middle).query(q)[1]
        middle = np.stack([q[part == k].mean(axis=0) if (part == k).any() else middle[k]
                           for k in range(parts)])  # fmt: skip
    return np.asarray(part, dtype=np.int64)


def errors(found: Calibration, part: Ints) -> Array:
    """Reading minus prediction of each pose by an estimate without its part, (m, 6 t), F_b.

    Where a whole series is left out, its frame is fitted to its own readings.

    Args:
        found: The estimate.
        part: Part of each pose, (m,).
    """
    return LeftOut(found, part).errors()


class LeftOut:
    """Estimates without each part of the poses, kept for several evaluations."""

    def __init__(self, found: Calibration, part: Ints) -> None:
        self._found = found
        self._parts = [_without(found, part == k) for k in np.unique(part)]

    def errors(self, held: slice | Ints | None = None) -> Array:
        """As `errors`; parameters in `held` are held at their prior mean."""
        out = np.empty(self._found.linear.y.shape)
        for one in self._parts:
            e = one.own.y - one.own.along(one.x if held is None else one.holding(held))
            for frame, mine in one.alone:
                e = _aligned(one.own.D[:, :, frame], e, mine)
            out[one.mine] = self._found.linear.spread((one.own.L @ e[..., None])[..., 0])
        return out

    @cached_property
    def std(self) -> Array:
        """Standard uncertainty of each left-out reading minus its prediction, (m, 6 t), F_b.

        V = L (1 + X C X') L', with C the covariance of the estimate without the part.
        """
        out = np.empty(self._found.linear.y.shape)
        for one in self._parts:
            half = one.own.L @ one.own.by_root(one.known.root, one.own.D.shape[2])
            var = np.sum(one.own.L**2, axis=2) + np.einsum("mrk,mrk->mr", half, half)
            out[one.mine] = self._found.linear.spread(np.sqrt(var))
        return out

    def var_by(self, held: slice | Ints) -> Array:
        """Variance of each left-out reading by the parameters in `held`, (m, 6 t), F_b.

        It is what `std` squared loses where they are known: L X C E (E' C E)^-1 E' C X' L', with E
        their unit columns.
        """
        out = np.empty(self._found.linear.y.shape)
        for one in self._parts:
            moves = one.moves(held)
            along = moves @ linear.cholesky(moves[held]).root
            half = one.own.L @ np.stack([one.own.along(x) for x in along.T], axis=2)
            out[one.mine] = self._found.linear.spread(np.einsum("mrk,mrk->mr", half, half))
        return out


@dataclass(frozen=True, eq=False)
class _Without(Locked):
    """An estimate without one part.

    Attributes:
        mine: Mask of the poses of the part, (m,).
        own: Their rows.
        known: Cholesky factor of the precision from the other parts and the priors.
        x: The parameters estimated from them.
        mean: Prior mean of the parameters.
        alone: For each series left out as a whole, its frame, and mask of its poses.
    """

    mine: Bools
    own: ReadRows
    known: linear.Cholesky
    x: Array
    mean: Array
    alone: tuple[tuple[slice, Bools], ...]

    def holding(self, held: slice | Ints) -> Array:
        """The parameters under the condition that those in `held` equal their prior mean.

        x - C E (E' C E)^-1 E' (x - x0), where C is the covariance and E the unit columns of those
        held.
        """
        moves = self.moves(held)
        return self.x - moves @ linear.solve(moves[held], (self.x - self.mean)[held])

    def moves(self, held: slice | Ints) -> Array:
        """C E, the covariance of all parameters with those in `held`, shape (size, h)."""
        return self.known.solve(np.eye(len(self.x))[:, held])


def _without(found: Calibration, mine: Bools) -> _Without:
    rows, mechanism, series = found.rows, found.mechanism, found.readings.series
    own, (P, _) = rows.of(mine), precision(mechanism, found.known)
    alone = []
    for one in np.setdiff1d(series[mine], series[~mine]):
        frame = frame_of(mechanism, one)
        P[frame, frame] += FIXED_SIGMA**-2 * np.eye(6)
        alone.append((frame, series[mine] == one))
    mean = padded(found.known.mean, len(P))
    known = factored(rows.N - own.N + P)
    return _Without(mine, own, known, known.solve(rows.b - own.b + P @ mean), mean, tuple(alone))


def _aligned(D: Array, e: Array, mine: Bools) -> Array:
    """Whitened residuals (m, r) after fitting the series' own frame, derivatives (m, r, 6)."""
    out = e.copy()
    K = D[mine].reshape(-1, 6)
    x = linear.least_squares(K, e[mine].reshape(-1))
    out[mine] = (e[mine].reshape(-1) - K @ x).reshape(e[mine].shape)
    return out


def distances(errors: Array, read: Bools) -> Array:
    """Norm of each position error [m], NaN where it was not read, shape (m, t)."""
    m = len(errors)
    off = errors.reshape(m, -1, 6)[..., :3]
    seen = read.reshape(m, -1, 6)[..., :3].all(axis=2)
    return np.where(seen, np.linalg.norm(off, axis=2), np.nan)
