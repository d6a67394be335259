"""Scatter of the readings about the model: joint errors at each pose, and instrument noise.

Rows of a pose have the covariance V = Z diag(s_j^2) Z' + diag(n^2), with n the noise of positions
or of rotations. The variances maximise the restricted likelihood (Patterson and Thompson,
Biometrika 58, 1971) by expectation-maximisation: products of residuals, corrected for what the
estimate has absorbed, take the place of those of the true errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.geometry.unloaded import START
from pipeline.machine.robot import Robot
from pipeline.positions.mechanism import Linear

_NOISE = (3e-5, 5e-5)
"""Initial noise of positions [m] and rotations [rad]."""

_AWAY = 2e-5
"""Minimum starting value of a standard deviation in the search [m or rad]; at zero the gradient
vanishes as well."""

_UPHILL = 15
"""Maximum number of optimiser iterations before the products are updated."""

_LEAST, _MOST = -36.0, -4.0
"""Bounds of the log variances [1]: standard deviations between 1e-8 and 0.1 m or rad."""


@dataclass(frozen=True, eq=False)
class PoseScatter(Locked):
    """Standard deviations of the readings about the model.

    Attributes:
        joints: Error of each joint at a pose [m] or [rad], shape (n,).
        position: Noise of a coordinate [m].
        rotation: Noise of a rotation [rad].
        stated: Whether `position` is stated, and therefore not estimated.
    """

    joints: Array
    position: float
    rotation: float
    stated: bool = False

    def factors(self, rows: Linear) -> tuple[Array, Array]:
        """L and W = L^-1 with V = L L' of each pose, over the rows read at any, (m, r, r) each."""
        of = _RowsByPose.of(rows, len(self.joints))
        pair = linear.triangular(of.cov(np.append(self.joints, [self.position, self.rotation])))
        L, W = (np.ascontiguousarray(np.moveaxis(one, 2, 0)) for one in pair)
        return L, W

    def better(self, rows: Linear, products: Array) -> PoseScatter:
        """Maximum-likelihood scatter given the products of residuals (m, r, r)."""
        n, m = len(self.joints), len(rows.y)
        free = np.ones(n + 2, dtype=bool)
        free[n] = not self.stated
        free[n + 1] = bool(rows.read[:, 3::6].any())
        now = np.append(self.joints, [self.position, self.rotation])
        start = 2 * np.log(np.where(free, np.maximum(now, _AWAY), now))
        of = _Likelihood(rows, products, n)

        def short(values: Array) -> tuple[float, Array]:
            whole = start.copy()
            whole[free] = values
            f, slope = of(whole)
            return f / m, slope[free] / m

        found = optimize.minimize(
            short,
            start[free],
            jac=True,
            method="L-BFGS-B",
            bounds=[(_LEAST, _MOST)] * free.sum(),
            options={"maxiter": _UPHILL},
        )
        whole = start.copy()
        whole[free] = found.x
        s = np.exp(whole / 2)
        return PoseScatter(s[:n], float(s[n]), float(s[n + 1]), self.stated)


def start(robot: Robot, sigma_m: float | None) -> PoseScatter:
    """Initial scatter; `sigma_m` is the stated noise of a coordinate [m], or None."""
    joints = np.array([START[joint.prismatic] for joint in robot.joints])
    return PoseScatter(joints, sigma_m or _NOISE[0], _NOISE[1], sigma_m is not None)


class _RowsByPose(NamedTuple):
    """Rows of all poses, the poses along the last axis.

    Attributes:
        Z: Derivatives by the joints, shape (r, n, m).
        read: Which rows were read at each pose, shape (r, m).
        turns: Which rows are rotations, shape (r,).
    """

    Z: Array
    read: Bools
    turns: Bools

    @classmethod
    def of(cls, rows: Linear, n: int) -> _RowsByPose:
        _, _, Z, read = rows.seen
        last = np.ascontiguousarray(np.moveaxis(Z[:, :, :n], 0, 2))
        return cls(last, np.asarray(read.T, dtype=bool), rows.used % 6 >= 3)

    def cov(self, s: Array) -> Array:
        """V of each pose, (r, r, m), for s (n + 2,); 1 on the diagonal for rows not read."""
        n = self.Z.shape[1]
        V = np.einsum("ikm,jkm->ijm", self.Z * s[:n, None] ** 2, self.Z)
        each = np.arange(len(V))
        V[each, each] += np.where(self.read, s[n + self.turns.astype(int), None] ** 2, 1.0)
        return np.asarray(V)


class _Likelihood:
    """Negative log likelihood of the products, and its gradient by the log variances.

    f = 1/2 sum over poses (log det V + tr V^-1 P), and by a variance with columns z of V
    1/2 sum z' (V^-1 - V^-1 P V^-1) z.
    """

    def __init__(self, rows: Linear, products: Array, n: int) -> None:
        self.rows = _RowsByPose.of(rows, n)
        self.products = np.ascontiguousarray(np.moveaxis(products, 0, 2))

    def __call__(self, logs: Array) -> tuple[float, Array]:
        s = np.exp(logs / 2)
        Z, read, turns = self.rows
        _, W = linear.triangular(self.rows.cov(s))
        each, P = np.arange(len(W)), self.products
        inverse = _times(np.swapaxes(W, 0, 1), W)
        inner, along = _times(inverse, P), _times(inverse, Z)
        f = 0.5 * float(inner[each, each].sum()) - float(np.log(W[each, each]).sum())
        slope = np.empty(len(s))
        slope[:-2] = 0.5 * np.einsum("ijm,ijm->j", Z - _times(P, along), along)
        own = inverse[each, each] - np.einsum("ikm,ikm->im", inner, inverse)
        diagonal = np.where(read, own, 0.0).sum(axis=1)
        for k in range(2):
            slope[k - 2] = 0.5 * diagonal[turns == k].sum()
        return f, slope * s**2


def _times(A: Array, B: Array) -> Array:
    """Products of matrices along the last axis, (i, j, m) of (i, k, m) and (k, j, m)."""
    return np.einsum("ikm,kjm->ijm", A, B)
