"""The transmission error of a joint over its angle as a random smooth curve of any shape.

A joint moves by f(q) more than its encoder indicates. f is a Gaussian process with the covariance

    k(d) = s^2 (1 + a) exp(-a),   a = sqrt(3) |d| / l

(Matern 3/2: continuous with a continuous slope), represented at knots with linear interpolation. At
more than several lengths l from all data, it is zero with standard uncertainty s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pipeline.base.arrays import Array, Ints, Locked

_SPACING = {True: 0.025, False: float(np.deg2rad(2.5))}
"""Minimum spacing of the knots of a sliding [m] and of a rotary joint [rad]: half the shortest
length."""

_TO_A_LENGTH = 4
"""Sufficient number of knots per length l: the interpolation error is 1e-2 of the curve's size."""

LENGTHS = {
    True: (0.05, 0.1, 0.2, 0.4),
    False: tuple(np.deg2rad((5.0, 10.0, 20.0, 40.0, 80.0)).tolist()),
}
"""Lengths l that are tried, for sliding [m] and rotary joints [rad]; the likeliest is taken. A
robot's gear has some ten to forty error periods per turn of its joint."""

_BED = np.array([0.5, 1.0, 2.0, 4.0])
"""Lengths l in the covariance of a rail's bed [m], each with a variance in proportion to it: its
spectrum falls with the square of the spatial frequency, as that of roads in ISO 8608. Few stations
do not tell one length, and what lies between them depends on it."""

_NUGGET = 1e-9
"""Fraction of the variance that is independent at each knot [1], for numerical stability."""


@dataclass(frozen=True, eq=False)
class Curve(Locked):
    """The knots of one curve.

    Attributes:
        joint: Joint whose value is the argument, from 0.
        first: Joint value of the first knot [m] or [rad].
        spacing: Spacing of the knots [m] or [rad].
        count: Number of knots.
        length: Correlation length l, in the same unit; for a bed the longest of several.
        size: s, the prior standard deviation of the curve [m] or [rad].
        screw: Motion that it adds to: a joint from 0, or from n on one of six motions of the rail's
            bed.
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
        """Correlation of the knots, i.e. covariance over s^2, shape (count, count)."""
        x = self.knots
        apart = x[:, None] - x
        of = matern(apart, self.length) if self.screw == self.joint else _of_bed(apart)
        return of + _NUGGET * np.eye(self.count)

    def between(self, q: Array) -> tuple[Ints, Array, Array]:
        """Knot before each joint value (m,), and the weights of it and of the next, (m,) each.

        Beyond the knots both weights are zero: the curve is unknown there.
        """
        along = (q - self.first) / self.spacing
        knot = np.clip(np.floor(along).astype(np.int64), 0, self.count - 2)
        behind = along - knot
        inside = (behind >= 0) & (behind <= 1)
        return knot, np.where(inside, 1 - behind, 0.0), np.where(inside, behind, 0.0)

    def beyond(self, q: Array) -> Array:
        """Variance of the curve where it has no knots, zero elsewhere, (m,)."""
        _, one, two = self.between(q)
        return self.size**2 * (one + two == 0)

    def rows(self, q: Array) -> sparse.csr_array:
        """Interpolation matrix from the knots to joint values (m,), shape (m, count)."""
        knot, one, two = self.between(q)
        m = len(q)
        at = (np.tile(np.arange(m), 2), np.concatenate([knot, knot + 1]))
        return sparse.csr_array((np.concatenate([one, two]), at), shape=(m, self.count))

    def value(self, q: Array, knots: Array) -> Array:
        """The curve at joint values (m,), given its values at the knots (count,)."""
        knot, one, two = self.between(q)
        return np.asarray(one * knots[knot] + two * knots[knot + 1])


def matern(distance: Array, length: Array | float) -> Array:
    """Correlation of the curve between two joint values at a distance."""
    a = np.sqrt(3.0) * np.abs(distance) / length
    return np.asarray((1 + a) * np.exp(-a))


def _of_bed(distance: Array) -> Array:
    """Correlation of a bed's deviation between two places at a distance [m]."""
    return np.asarray(matern(distance[..., None], _BED) @ (_BED / _BED.sum()))


def over(joint: int, q: Array, slides: bool, length: float, size: float) -> Curve:
    """A curve over the range of a joint's values (m,), added to its own motion."""
    spacing = max(_SPACING[slides], length / _TO_A_LENGTH)
    return Curve(joint, *_knots(q, spacing), length, size, joint)


def along_bed(q: Array, size: float, screw: int) -> Curve:
    """A curve over the positions of a carriage (m,) [m], added to a motion of the bed."""
    return Curve(0, *_knots(q, float(_BED[0]) / _TO_A_LENGTH), float(_BED[-1]), size, screw)


def _knots(q: Array, spacing: float) -> tuple[float, float, int]:
    """First knot, spacing and number of knots over a range of values."""
    first = float(q.min()) - spacing
    return first, spacing, int(np.ceil((q.max() - first) / spacing)) + 2


def between_knots(curves: Sequence[Curve], q: Array, Z: Array) -> tuple[Array, Ints]:
    """Derivatives by the two knots of each curve, (m, r, 2 c), and these knots' indices, (m, 2 c).

    Args:
        curves: The c curves.
        q: Joint values [m] or [rad], shape (m, n).
        Z: Derivatives by motions of joints and bed, shape (m, r, n + 6).
    """
    K = np.empty((*Z.shape[:2], 2 * len(curves)))
    at, before = np.empty((len(q), 2 * len(curves)), dtype=np.int64), 0
    for k, curve in enumerate(curves):
        knot, one, two = curve.between(q[:, curve.joint])
        K[:, :, 2 * k] = Z[:, :, curve.screw] * one[:, None]
        K[:, :, 2 * k + 1] = Z[:, :, curve.screw] * two[:, None]
        at[:, 2 * k], at[:, 2 * k + 1] = before + knot, before + knot + 1
        before += curve.count
    return K, at
