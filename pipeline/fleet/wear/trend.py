"""Trends of the present lives of a robot's joints, by generalised least squares.

y = A a + B w + e: levels a, trends w of the relative compliances per year, e with the covariance of
campaigns and days; w = I^-1 s with covariance I^-1, I and s as in `eliminated`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.fleet.wear.elimination import Eliminated, eliminated
from pipeline.fleet.wear.machine import Machine
from pipeline.fleet.wear.scatter import DayToDayVariances


@dataclass(frozen=True, eq=False)
class Trends(Locked):
    """Change of each compliance per year, relative to the mean.

    Attributes:
        value: [1/year], NaN if it is not determined, shape (n,).
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


def trends(machine: Machine, scatter: DayToDayVariances) -> Trends:
    """All trends of a robot's present lives, estimated together."""
    n = machine.joints
    found = eliminated(machine, machine.weights(scatter.variance), machine.trend)
    value, cov, dof = np.full(n, np.nan), np.full((n, n), np.nan), np.full(n, np.nan)
    use = np.flatnonzero(found.told)
    if use.size:
        inner = linear.inverse(found.N[np.ix_(use, use)])
        value[use], cov[np.ix_(use, use)] = inner @ found.g[use], inner
        dof[use] = _dof(found, use, inner, scatter)
    return Trends(value, cov, dof)


def _dof(found: Eliminated, use: Ints, cov: Array, scatter: DayToDayVariances) -> Array:
    """Degrees of freedom after Satterthwaite (Biometrics Bull. 2 (1946) 110).

    Twice the square of a variance over the variance of that variance. The variance of w_j is d' I
    d, where d is column j of I^-1, and its derivative with respect to v is that of I, up to the
    sign.
    """
    along = np.zeros((len(found.g), len(use)))
    along[use] = cov
    return np.asarray(
        2 * np.diag(cov) ** 2 / found.variance_of_variance(along, scatter.uncertainty)
    )
