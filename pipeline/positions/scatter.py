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

from pipeline.base.arrays import Array, Bools, Ints, Locked
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
        pair = triangular(of.cov(np.append(self.joints, [self.position, self.rotation])))
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


_ROUNDED = 1e-12
"""Relative increase of a variance that is lost in the rounding of a larger one [1]."""


class _RowsByPose(NamedTuple):
    """Products of all poses by pairs of rows, a lower triangle of p = r (r + 1) / 2 at each pose.

    Attributes:
        pairs: Rows of each pair, (p,) each.
        Z: Products of derivatives by the joints, shape (n, p, m).
        read: Which rows were read at each pose, shape (r, m).
        turns: Which rows are rotations, shape (r,).
    """

    pairs: tuple[Ints, ...]
    Z: Array
    read: Bools
    turns: Bools

    @classmethod
    def of(cls, rows: Linear, n: int) -> _RowsByPose:
        _, _, Z, read = rows.seen
        last = np.ascontiguousarray(np.moveaxis(Z[:, :, :n], 0, 2).swapaxes(0, 1))
        i, j = np.tril_indices(Z.shape[1])
        return cls((i, j), last[:, i] * last[:, j], np.asarray(read.T), rows.used % 6 >= 3)

    def cov(self, s: Array) -> Array:
        """Lower half of V of each pose, (r, r, m), for s (n + 2,); 1 for rows not read."""
        (n, _, m), r = self.Z.shape, len(self.read)
        V, (i, j), each = np.zeros((r, r, m)), self.pairs, np.arange(r)
        V[i, j] = (s[:n] ** 2 @ self.Z.reshape(n, -1)).reshape(-1, m)
        V[each, each] += np.where(self.read, s[n + self.turns.astype(int), None] ** 2, 1.0)
        return V


class _Likelihood:
    """Negative log likelihood of the products, and its gradient by the log variances.

    f = 1/2 sum over poses (log det V + tr V^-1 P), and by a variance with columns z of V
    1/2 sum z' (V^-1 - V^-1 P V^-1) z.
    """

    def __init__(self, rows: Linear, products: Array, n: int) -> None:
        self.rows = _RowsByPose.of(rows, n)
        self.products = products

    def __call__(self, logs: Array) -> tuple[float, Array]:
        s = np.exp(logs / 2)
        (i, j), Z, read, turns = self.rows
        W = np.ascontiguousarray(np.moveaxis(triangular(self.rows.cov(s))[1], 2, 0))
        inverse = np.swapaxes(W, 1, 2).copy() @ W  # of one array, numpy takes a slower way
        inner = inverse @ self.products
        f = 0.5 * float(np.einsum("mii->", inner)) - float(np.log(np.einsum("mii->mi", W)).sum())
        both = np.moveaxis(inverse - inner @ inverse, 0, 2)
        left = both[i, j]
        diagonal = np.where(read, left[i == j], 0.0).sum(axis=1)
        left[i != j] *= 2
        slope = np.append(
            Z.reshape(len(Z), -1) @ left.ravel(), [diagonal[~turns].sum(), diagonal[turns].sum()]
        )
        return f, 0.5 * slope * s**2


def triangular(V: Array) -> tuple[Array, Array]:
    """Cholesky factors L of positive definite V = L L', and their inverses, both (k, k, m).

    For m small matrices along the last axis, (k, k, m): all rows of a column at once are faster
    than a call for each matrix. V is regularised as in `linear.whitening`.

    Raises:
        LinAlgError: A row has no variance.
    """
    L, W = np.zeros_like(V), np.zeros_like(V)
    for j in range(len(V)):
        column = V[j:, j] - np.einsum("ikm,km->im", L[j:, :j], L[j, :j])
        if not (column[0] > 0).all():
            if not (np.einsum("iim->im", V) > 0).all():
                raise np.linalg.LinAlgError("a row has no variance")
            return triangular(V + _ROUNDED * V * np.eye(len(V))[:, :, None])
        W[j, j] = 1 / np.sqrt(column[0])
        L[j:, j] = column * W[j, j]
        W[j, :j] = -W[j, j] * np.einsum("km,kim->im", L[j, :j], W[:j, :j])
    return L, W
