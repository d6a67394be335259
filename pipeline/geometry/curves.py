"""The transmission error of a joint over its angle, of whatever shape: a random smooth curve.

A joint turns by f(q) more than its encoder says. f is a Gaussian process with the covariance

    k(d) = s^2 (1 + a) exp(-a),   a = sqrt(3) |d| / l

(Matern 3/2: continuous with a continuous slope), held at knots and linear between them. Far from
where it was taught, over several lengths l, it is zero with standard uncertainty s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pipeline.base.arrays import Array, Ints, Locked

SPACING = {True: 0.025, False: float(np.deg2rad(2.5))}
"""Knots of a sliding joint [m] and of another [rad] at least: half the shortest length."""

_TO_A_LENGTH = 4
"""Knots that are enough to a length l: what a curve does between them is 1e-2 of its size."""

LENGTHS = {
    True: (0.05, 0.1, 0.2, 0.4),
    False: tuple(np.deg2rad((5.0, 10.0, 20.0, 40.0, 80.0)).tolist()),
}
"""Lengths l that are tried, the likeliest of which is taken: a gear of a robot has some ten to
forty errors per turn of its joint."""

BED = (0.5, 1.0, 2.0, 4.0)
"""The same of the bed of a rail [m]: it is laid in pieces of some metres."""

_NUGGET = 1e-9
"""Part of the variance that no neighbour knows of, against rounding."""


@dataclass(frozen=True, eq=False)
class Curve(Locked):
    """Knots of one joint.

    Attributes:
        joint: Whose value it is of, from 0.
        first: Joint value of the first knot [m] or [rad].
        spacing: Between knots.
        count: Number of knots.
        length: l, in the same unit.
        size: s, the standard deviation of the curve before any data [m] or [rad].
        screw: What it moves: a joint from 0, or beyond them one of six motions of the rail's bed.
    """

    joint: int
    first: float
    spacing: float
    count: int
    length: float
    size: float
    screw: int

    @property
    def knots(self) -> Array:
        """Joint values of the knots, shape (count,)."""
        return np.asarray(self.first + self.spacing * np.arange(self.count, dtype=float))

    def shape(self) -> Array:
        """Covariance of the knots over s^2, shape (count, count)."""
        x = self.knots
        return matern(x[:, None] - x, self.length) + _NUGGET * np.eye(self.count)

    def between(self, q: Array) -> tuple[Ints, Array, Array]:
        """Knot before each joint value (m,), and the weights of it and of the next one, (m,) each.

        Beyond the knots both weights are zero: nobody knows anything of the curve there.
        """
        along = (q - self.first) / self.spacing
        knot = np.clip(np.floor(along).astype(np.int64), 0, self.count - 2)
        behind = along - knot
        inside = (behind >= 0) & (behind <= 1)
        return knot, np.where(inside, 1 - behind, 0.0), np.where(inside, behind, 0.0)

    def beyond(self, q: Array) -> Array:
        """Variance of the curve where it has no knots, (m,)."""
        _, one, two = self.between(q)
        return self.size**2 * (one + two == 0)

    def rows(self, q: Array) -> sparse.csr_array:
        """What the curve is at joint values (m,) by its knots, shape (m, count)."""
        knot, one, two = self.between(q)
        m = len(q)
        at = (np.tile(np.arange(m), 2), np.concatenate([knot, knot + 1]))
        return sparse.csr_array((np.concatenate([one, two]), at), shape=(m, self.count))

    def value(self, q: Array, knots: Array) -> Array:
        """The curve at joint values (m,), given its values at the knots (count,)."""
        knot, one, two = self.between(q)
        return np.asarray(one * knots[knot] + two * knots[knot + 1])


def matern(distance: Array, length: float) -> Array:
    """Correlation of the curve at two joint values so far apart."""
    a = np.sqrt(3.0) * np.abs(distance) / length
    return np.asarray((1 + a) * np.exp(-a))


def over(
    joint: int, q: Array, slides: bool, length: float, size: float, screw: int | None = None
) -> Curve:
    """A curve over the values of a joint that were taken, (m,), of its own motion or a screw's."""
    spacing = max(SPACING[slides], length / _TO_A_LENGTH)
    first = float(q.min()) - spacing
    count = int(np.ceil((q.max() - first) / spacing)) + 2
    return Curve(joint, first, spacing, count, length, size, joint if screw is None else screw)
