"""Criteria of a plan, each as one number to minimise and its derivative by the information.

Every criterion is written through an information function g(M) (Pukelsheim, Optimal Design of
Experiments, 1993): concave, and g(s M) = s g(M). M (n, n) is the inverse of the covariance of the
compliances, in units of their scale. The figure of a plan is g(M)^(-1/2). For the paper's criterion
that is the root of Eq. (8), as in Table II: sigma sqrt(trace(A_0 M^-1 A_0')).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array

_Score = Callable[[Array], tuple[Array, Array]]
"""From information M (k, n, n): log g (k,) and S = d log g / dM (k, n, n), trace(S M) = 1."""


@dataclass(frozen=True, eq=False)
class Criterion:
    """One criterion over the information about scaled compliances.

    Attributes:
        name: `test_pose`, `workspace`, `D`, `A` or `E`.
        unit: Of its figure, `m` or `1`.
        meaning: Description of the figure, for tables and axes.
        score: Its information function.
        smooth: A smooth approximation from which supports are taken, where g itself has kinks.
    """

    name: str
    unit: str
    meaning: str
    score: _Score
    smooth: _Score | None = None

    def figure(self, M: Array) -> Array:
        """The figure of plans with information M (k, n, n), small is good, shape (k,)."""
        return np.exp(-self.score(M)[0] / 2)

    def support(self, M: Array) -> Array:
        """Z with g(N) <= trace(Z N) for every N, with equality or nearly so at M, (k, n, n).

        g is concave and g(s M) = s g(M), so its derivative at any M is such a Z. For the smallest
        eigenvalue any positive semidefinite Z of trace one will do; that of a high power mean is
        close.
        """
        log_g, S = (self.smooth or self.score)(M)
        if self.smooth is None:
            return np.exp(log_g)[:, None, None] * S
        return S / np.einsum("kii->k", S)[:, None, None]


def prediction(sensitivities: Array, weights: Array, name: str = "test_pose") -> Criterion:
    """Root mean square error of the predicted deflection, the root of Eq. (8).

    sqrt(trace(C M^-1)) [m] with C = sum_p w_p A_p' A_p / sum_p w_p, shape (n, n).

    Args:
        sensitivities: A_0 at each place that matters, by scaled compliances [m], (p, 3, n).
        weights: Weight of each place, shape (p,).
        name: `test_pose` or `workspace`.
    """
    share = weights / weights.sum()
    C = np.einsum("p,pia,pib->ab", share, sensitivities, sensitivities)
    meaning = "rms error of the predicted deflection"
    return Criterion(name, "m", meaning, lambda M: _trace(C, M))


def relative_std(M: Array) -> Array:
    """Standard uncertainty of each compliance in units of its scale, shape (k, n)."""
    variance = np.einsum("kii->ki", linear.regular_inverse(M))
    return np.sqrt(np.where(variance > 0, variance, np.inf))


def _trace(C: Array, M: Array) -> tuple[Array, Array]:
    """Inverse trace, g = 1 / trace(C M^-1), S = M^-1 C M^-1 / trace(C M^-1)."""
    Q = linear.regular_inverse(M)
    spread = np.einsum("ij,kji->k", C, Q)
    spread = np.where(spread > 0, spread, np.nan)
    return -np.log(spread), Q @ C @ Q / spread[:, None, None]


def _average(M: Array) -> tuple[Array, Array]:
    """Inverse mean of the variances, g = n / trace(M^-1)."""
    n = M.shape[-1]
    return _trace(np.eye(n) / n, M)


def _determinant(M: Array) -> tuple[Array, Array]:
    """Root of the determinant, g = det(M)^(1/n), S = M^-1 / n."""
    n = M.shape[-1]
    return linear.log_det(M) / n, linear.regular_inverse(M) / n


def _smallest(M: Array) -> tuple[Array, Array]:
    """Smallest eigenvalue, g = lambda, S = v v' / lambda; if it is multiple, one of its slopes."""
    values, vectors = linear.directions(M)
    least, v = values[:, 0], vectors[:, :, 0]
    least = np.where(least > 0, least, np.nan)
    return np.log(least), v[:, :, None] * v[:, None] / least[:, None, None]


def _power_mean(M: Array, power: int = 24) -> tuple[Array, Array]:
    """Power mean, g = (trace(M^-p) / n)^(-1/p), which tends to the smallest eigenvalue."""
    values, vectors = linear.directions(M)
    least = np.where(values[:, :1] > 0, values[:, :1], np.nan)
    share = (least / values) ** power
    total = share.sum(axis=1, keepdims=True)
    weights = share / (total * values)
    S = np.einsum("kij,kj,klj->kil", vectors, weights, vectors)
    return np.log(least[:, 0]) - np.log(total[:, 0] / M.shape[-1]) / power, S


CLASSIC: Mapping[str, Criterion] = {
    criterion.name: criterion
    for criterion in (
        Criterion(
            "D", "1", "geometric mean of the relative uncertainties' ellipsoid", _determinant
        ),
        Criterion("A", "1", "rms relative uncertainty", _average),
        Criterion("E", "1", "relative uncertainty of the worst mix", _smallest, _power_mean),
    )
}
"""Criteria of the relative compliances alone, by name.

D: geometric mean of the semi-axes of the confidence ellipsoid for one standard deviation,
det(M)^(-1 / 2n). A: root mean square of the relative standard uncertainties, sqrt(trace(M^-1) / n).
E: relative uncertainty of the worst determined mix of compliances, lambda_min(M)^(-1/2).
"""
