"""Pulls at every pose and the scatter of their readings: how information adds up.

With T the covariance of one reading, z T that of the pose's zero, F_s the load steps with variance
v_s of their force and d the displacement per newton, the pulls of one pose have the covariance

    V_st = delta_st (T + v_s d d') + z T.

Both parts of V share T, so that the information of the pose is a scalar function of N = A' T^-1 A:

    information = alpha N - gamma(h) n n',   n = N 1,  h = 1' N 1,

in units in which the nominal compliances are one (then d = A 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.base.covariance import symmetric
from pipeline.machine.instrument import InstrumentNoise, beam_covariance

_STEP = 1e-30
"""Imaginary step of the complex-step derivative [1]: exact to rounding, without cancellation."""


@dataclass(frozen=True, eq=False)
class TrackerBeam:
    """A tracker whose scatter depends on range and direction.

    Attributes:
        noise: Parts along and across the beam.
        position: Of the tracker in F_b [m].
    """

    noise: InstrumentNoise
    position: tuple[float, float, float]

    def at(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Beams to points in F_b [m], shape (t, 3, m).

        Returns:
            Unit vectors from tracker to points, (t, 3, m), distances [m], (t, m), and 1 / variance
            with its derivative by the distance, (2, t, m), across the beam and along it.
        """
        ray = points - np.array(self.position)[:, None]
        reach = np.sqrt((ray * ray).sum(axis=1))
        across = _inverse_square(self.noise.transverse_m, self.noise.transverse_per_m, reach)
        along = _inverse_square(self.noise.range_m, self.noise.range_per_m, reach)
        return ray / reach[:, None], reach, across, along


@dataclass(frozen=True, eq=False)
class PulledReadings(Locked):
    """Pulls at each pose and the scatter of their readings.

    Attributes:
        force: Load steps [N], shape (s,).
        repeats: Number of pulls of each step at a pose, shape (s,).
        force_std: Standard uncertainty of the force at each step [N], shape (s,).
        zero: Variance of the pose's zero over that of a reading; 0 when displacements are assumed
            independent, as in the paper.
        tracker: Covariance of a reading in F_b [m^2], shape (3, 3), or a tracker with scatter along
            and across its beam.
    """

    force: Array
    repeats: Array
    force_std: Array
    zero: float
    tracker: Array | TrackerBeam

    @property
    def pulls(self) -> float:
        """Number of pulls at each pose."""
        return float(self.repeats.sum())

    @property
    def alpha(self) -> float:
        """Factor of N: sum of squared forces, minus the loss due to the shared zero [N^2]."""
        squared = float(self.repeats @ self.force**2)
        if self.zero == 0:
            return squared
        return squared - float(self.repeats @ self.force) ** 2 / (self.pulls + 1 / self.zero)

    def gamma(self, h: Array) -> Array:
        """Loss due to the uncertainty of the force, shape of h (which may be complex)."""
        variance = self.force_std**2
        beta = variance / (1 + variance * h[..., None])
        lost = beta @ (self.repeats * self.force**2)
        if self.zero == 0:
            return lost
        a = self.pulls + 1 / self.zero
        b, g = beta @ self.repeats, beta @ (self.repeats * self.force)
        f = float(self.repeats @ self.force)
        back = (b / a**2) / (1 - b * h / a)
        return lost + (g * g * h - 2 * f * g) / a + back * (f - g * h) ** 2

    def reading(self, points: Array) -> Array:
        """Covariance of one reading of all points [m^2], block diagonal, (m, 3 t, 3 t).

        Args:
            points: In F_b [m], shape (t, 3, m).
        """
        t, _, m = points.shape
        out = np.zeros((m, t, 3, t, 3))
        each = np.arange(t)
        if isinstance(self.tracker, TrackerBeam):
            ray = np.moveaxis(points, -1, 1) - np.array(self.tracker.position)
            six = beam_covariance(ray.reshape(-1, 3), self.tracker.noise)
            out[:, each, :, each] = symmetric(six).reshape(t, m, 3, 3)
        else:
            out[:, each, :, each] = self.tracker
        return out.reshape(m, 3 * t, 3 * t)

    def weighted(self, points: Array, A: Array) -> Array:
        """T^-1 A, shape (t, n, 3, m).

        Args:
            points: Measured points in F_b [m], shape (t, 3, m).
            A: Shape (t, n, 3, m).
        """
        if not isinstance(self.tracker, TrackerBeam):
            C = self.tracker
            if np.array_equal(C, C[0, 0] * np.eye(3)):
                return A / C[0, 0]
            return np.einsum("ij,tnjm->tnim", linear.inverse(C), A)
        beam, _, across, along = self.tracker.at(points)
        inward = (A * beam[:, None]).sum(axis=2)
        extra = ((along[0] - across[0])[:, None] * inward)[:, :, None] * beam[:, None]
        return A * across[0][:, None, None] + extra

    def inform(self, N: Array) -> Array:
        """Information of the pulls of a pose from N = A' T^-1 A, shapes (m, n, n)."""
        if not self.force_std.any():
            return self.alpha * N
        n = N.sum(axis=-1)
        return (
            self.alpha * N - self.gamma(n.sum(axis=-1))[:, None, None] * n[:, :, None] * n[:, None]
        )

    def combine(self, N: Array, W: Array) -> tuple[Array, Array]:
        """Sum of W * information, shape (m,), and its derivative by N, shape (m, n, n)."""
        n = N.sum(axis=-1)
        h = n.sum(axis=-1)
        Wn = (W @ n[:, :, None])[:, :, 0]
        cost = (n * Wn).sum(axis=1)
        gamma, slope = self.gamma(h), self.gamma(h + 1j * _STEP).imag / _STEP
        both = gamma[:, None] * Wn
        V = self.alpha * W - both[:, :, None] - both[:, None] - (slope * cost)[:, None, None]
        return self.alpha * (W * N).sum(axis=(1, 2)) - gamma * cost, V

    def slope(self, points: Array, A: Array, V: Array) -> Array | None:
        """Derivative of sum(V * A' T^-1 A) by the points through T, (t, 3, m), or None.

        Args:
            points: Measured points in F_b [m], shape (t, 3, m).
            A: Shape (t, n, 3, m).
            V: Shape (n, n) or (m, n, n).
        """
        if not isinstance(self.tracker, TrackerBeam):
            return None
        e, reach, across, along = self.tracker.at(points)
        Q = np.einsum("tnim,tnjm->tijm", A, weigh(A, V))
        Qe = np.einsum("tijm,tjm->tim", Q, e)
        inside = (Qe * e).sum(axis=1)
        outside = np.einsum("tiim->tm", Q) - inside
        stretch = across[1] * outside + along[1] * inside
        turn = 2 * (along[0] - across[0]) / reach
        return stretch[:, None] * e + turn[:, None] * (Qe - inside[:, None] * e)


def _inverse_square(constant: float, per_metre: float, reach: Array) -> Array:
    """1 / (constant + per_metre reach)^2 and its derivative by reach, shape (2, ...)."""
    std = constant + per_metre * reach
    return np.stack([std**-2, -2 * per_metre * std**-3])


def gram(A: Array, weighted: Array) -> Array:
    """N = A' T^-1 A, shape (m, n, n), from (t, n, 3, m)."""
    rows = A.transpose(3, 1, 0, 2).reshape(A.shape[-1], A.shape[1], -1)
    other = weighted.transpose(3, 0, 2, 1).reshape(A.shape[-1], -1, A.shape[1])
    return rows @ other


def weigh(A: Array, V: Array) -> Array:
    """A V over the columns of A: (t, n, 3, m) with V (n, n) or one per pose (m, n, n)."""
    if V.ndim == 2:
        t, n, _, m = A.shape
        return (V @ A.reshape(t, n, 3 * m)).reshape(A.shape)
    return np.moveaxis(V[:, None] @ A.transpose(3, 0, 1, 2), 0, -1)
