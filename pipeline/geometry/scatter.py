"""What no model holds: an error of each joint at each pose, and the noise of the instrument.

Rows of a pose have the covariance V = Z diag(s_j^2) Z' + diag(n^2), n that of positions or of
rotations. The variances make the restricted likelihood largest (Patterson and Thompson, Biometrika
58, 1971), by steps of expectation and maximisation: the residuals' products, with what the estimate
has taken out of them put back, stand in place of the true errors'.
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
"""Error of a sliding joint [m] and of another [rad] that no table holds, before any data."""

_NOISE = (3e-5, 5e-5)
"""Noise of positions [m] and rotations [rad], before any data."""

_AWAY = 2e-5
"""Where to begin again with what was as good as zero [m] or [rad]: there the slope is zero, too."""

_UPHILL = 15
"""Steps uphill that are enough before the products are made anew."""

_LEAST, _MOST = -36.0, -4.0
"""Logarithms of variances between 1e-8 and 0.1 [m] or [rad]."""


@dataclass(frozen=True, eq=False)
class PoseScatter(Locked):
    """Standard deviations.

    Attributes:
        joints: Error of each joint at a pose [m] or [rad], shape (n,).
        position: Noise of a coordinate [m].
        rotation: Noise of a rotation [rad].
        stated: The noise of a coordinate is given, and not estimated.
    """

    joints: Array
    position: float
    rotation: float
    stated: bool = False

    def cov(self, Z: Array, read: Bools, turns: Bools) -> Array:
        """V of each pose, shape (m, r, r); 1 in the diagonal for rows that were not read."""
        V = (Z * self.joints**2) @ np.swapaxes(Z, 1, 2)
        rows = np.arange(Z.shape[1])
        noise = np.where(turns, self.rotation, self.position)
        V[:, rows, rows] += np.where(read, noise**2, 1.0)
        return np.asarray(V)

    def whitening(self, rows: Linear) -> Array:
        """W with W V W' = 1 of each pose over the rows that any pose has, shape (m, r, r)."""
        used = rows.used
        Z = rows.Z[:, used, : len(self.joints)]
        return linear.whitening(self.cov(Z, rows.read[:, used], used % 6 >= 3))

    def better(self, rows: Linear, products: Array) -> PoseScatter:
        """The scatter that makes products of residuals (m, r, r) likeliest."""
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
    """Before any data."""
    joints = np.array([START[joint.prismatic] for joint in robot.joints])
    return PoseScatter(joints, sigma_m or _NOISE[0], _NOISE[1], sigma_m is not None)


class _Likelihood:
    """Half of minus twice the log likelihood of products, and its slope by log variances."""

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
