"""Scatter of the readings about the model: joint errors at each pose, and instrument noise.

Rows of a pose have the covariance V = Z diag(s_j^2) Z' + diag(n^2), with n the noise of positions
or of rotations. The variances maximise the restricted likelihood (Patterson and Thompson,
Biometrika 58, 1971) by expectation-maximisation: products of residuals, corrected for what the
estimate has absorbed, take the place of those of the true errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.geometry.mechanism import Linear
from pipeline.machine.robot import Robot

START = {True: 5e-5, False: 1e-4}
"""Initial standard deviation of the unmodelled error of a sliding joint [m] and of a rotary
one [rad]."""

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

    def cov(self, Z: Array, read: Bools, turns: Bools) -> Array:
        """V of each pose, shape (m, r, r); 1 on the diagonal for rows that were not read."""
        V = (Z * self.joints**2) @ np.swapaxes(Z, 1, 2)
        rows = np.arange(Z.shape[1])
        noise = np.where(turns, self.rotation, self.position)
        V[:, rows, rows] += np.where(read, noise**2, 1.0)
        return np.asarray(V)

    def whitening(self, rows: Linear) -> Array:
        """W with W V W' = 1 of each pose, over the rows read at any pose, shape (m, r, r)."""
        used = rows.used
        Z = rows.Z[:, used, : len(self.joints)]
        return linear.whitening(self.cov(Z, rows.read[:, used], used % 6 >= 3))

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


class _Likelihood:
    """Negative log likelihood of the products, and its gradient by the log variances."""

    def __init__(self, rows: Linear, products: Array, n: int) -> None:
        used = rows.used
        self.products, self.n = products, n
        self.Z, self.read, self.turns = rows.Z[:, used, :n], rows.read[:, used], used % 6 >= 3

    def __call__(self, logs: Array) -> tuple[float, Array]:
        s = np.exp(logs / 2)
        one = PoseScatter(s[: self.n], float(s[self.n]), float(s[self.n + 1]))
        V = one.cov(self.Z, self.read, self.turns)
        inverse = linear.regular_inverse(V)
        inner = inverse @ self.products
        f = 0.5 * (linear.log_det(V).sum() + np.trace(inner, axis1=1, axis2=2).sum())
        Q = inverse - inner @ inverse
        slope = np.empty(self.n + 2)
        slope[: self.n] = 0.5 * np.einsum("mij,mij->j", Q @ self.Z, self.Z)
        diagonal = np.where(self.read, np.einsum("mii->mi", Q), 0.0).sum(axis=0)
        for k in range(2):
            slope[self.n + k] = 0.5 * diagonal[self.turns == k].sum()
        return float(f), slope * s**2
