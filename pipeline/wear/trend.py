"""Trends of the present lives of a robot's joints, by generalised least squares.

y = A a + B w + e: levels a, trends w of the relative compliances per year, e with the covariance
of campaigns and days. Of any columns Z beside A

    I = Z' P Z,   s = Z' P y,   P = V^-1 - V^-1 A (A' V^-1 A)^-1 A' V^-1,

so that w = I^-1 s with covariance I^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.wear.machine import Machine, products
from pipeline.wear.scatter import Scatter

_NOTHING = 1e-6
"""Part of the information on a column that is none, once the levels are estimated along [1]."""


@dataclass(frozen=True, eq=False)
class Beside(Locked):
    """Columns Z beside the levels, after the first k campaigns.

    Attributes:
        N: I, shape (m, m).
        g: s, shape (m,).
        PZ: P Z, shape (k, n, m).
        told: Columns of which something is left beside the levels, shape (m,).
    """

    N: Array
    g: Array
    PZ: Array
    told: Bools

    def variance_of_variance(self, along: Array, scatter: Scatter) -> Array:
        """How well the information along directions is known, that of the scatter being found.

        dI/dv_j = -sum_i (P Z d)_ij^2, and for what all joints have in common the square of the
        sum over joints; errors of the v_j are taken as independent.

        Args:
            along: Directions d in columns, shape (m, D).
            scatter: With the uncertainty of its variances.

        Returns:
            Variance of d' I d, shape (D,).
        """
        moved = self.PZ @ along
        by_joint = np.sum(moved**2, axis=0) ** 2
        common = np.sum(moved.sum(axis=1) ** 2, axis=0) ** 2
        return np.asarray(scatter.uncertainty[:-1] @ by_joint + scatter.uncertainty[-1] * common)


def beside(machine: Machine, W: Array, Z: Array, first: int | None = None) -> Beside:
    """Columns Z (K, n, m) beside the levels, in the first campaigns or all.

    Args:
        machine: The robot.
        W: Its `weights`.
        Z: Columns.
        first: How many campaigns.
    """
    A, W, Z, y = machine.nuisance[:first], W[:first], Z[:first], machine.y[:first]
    WA, WZ = W @ A, W @ Z
    taken = linear.regular_inverse(products(A, WA)[None])[0] @ np.einsum("kip,kim->pm", A, WZ)
    PZ = WZ - WA @ taken
    whole = np.einsum("kim,kim->m", Z, WZ)
    N = np.einsum("kim,kiq->mq", Z, PZ)
    told = np.diag(N) > _NOTHING * np.maximum(whole, _NOTHING)
    return Beside(N, np.einsum("kim,ki->m", PZ, y), PZ, told)


@dataclass(frozen=True, eq=False)
class Trends(Locked):
    """Change of each compliance per year, relative to the mean.

    Attributes:
        value: [1/year], NaN where it is not determined, shape (n,).
        cov: Covariance, NaN likewise, shape (n, n).
        dof: Degrees of freedom of the uncertainty, shape (n,).
    """

    value: Array
    cov: Array
    dof: Array

    @property
    def std(self) -> Array:
        """Standard uncertainties [1/year], shape (n,)."""
        return np.asarray(np.sqrt(np.diag(self.cov)))

    @property
    def half(self) -> Array:
        """Half width of the 95 % intervals [1/year], shape (n,)."""
        return np.asarray(special.stdtrit(self.dof, 0.975) * self.std)


def trends(machine: Machine, scatter: Scatter) -> Trends:
    """All trends of a robot's present lives, each beside all others."""
    n = machine.joints
    found = beside(machine, machine.weights(scatter.variance), machine.trend)
    value, cov, dof = np.full(n, np.nan), np.full((n, n), np.nan), np.full(n, np.nan)
    use = np.flatnonzero(found.told)
    if use.size:
        inner = linear.inverse(found.N[np.ix_(use, use)])
        value[use], cov[np.ix_(use, use)] = inner @ found.g[use], inner
        dof[use] = _dof(found, use, inner, scatter)
    return Trends(value, cov, dof)


def _dof(found: Beside, use: Ints, cov: Array, scatter: Scatter) -> Array:
    """After Satterthwaite (Biometrics Bull. 2 (1946) 110): twice the square of a variance over its.

    The variance of w_j is d' I d with d the column j of I^-1, and d of that by v moves as I does.
    """
    along = np.zeros((len(found.g), len(use)))
    along[use] = cov
    return np.asarray(2 * np.diag(cov) ** 2 / found.variance_of_variance(along, scatter))
