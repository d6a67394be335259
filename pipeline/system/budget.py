"""The contribution of each source of error to each parameter's uncertainty (GUM, 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked, Strings
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener


@dataclass(frozen=True, eq=False)
class _Budget(Locked):
    """Contributions to the covariance of an estimate; the sources are independent.

    Attributes:
        source: Names of the sources, in the order in which they enter, shape (s,).
        cov: What each source adds to the covariance of x, shape (s, k, k).
    """

    source: Strings
    cov: Array

    @property
    def std(self) -> Array:
        """Standard uncertainty of each parameter from each source alone, shape (s, k)."""
        return np.sqrt(np.einsum("skk->sk", self.cov))

    @property
    def share(self) -> Array:
        """Fraction of each parameter's variance, summing to one over the sources, shape (s, k)."""
        variance = np.einsum("skk->sk", self.cov)
        total = variance.sum(axis=0)
        return variance / np.where(total > 0, total, 1.0)


def budget(system: System, estimate: Estimate, white: Whitener | None = None) -> _Budget:
    """Split the covariance by source: x = K c with K = (B' V^-1 B)^-1 B' V^-1, so K G G' K'.

    The estimator K weights with the whole V; each source then contributes (K G_s)(K G_s)', and
    these add up to the covariance of x. Where G is still relative, the sum is scaled by the
    residuals, as the covariance is.

    Args:
        system: The system that the estimate is from.
        estimate: For the scale of an unstated noise.
        white: The system's whitener, if available.
    """
    white = white or whitener(system.errors, system.rows.pose)
    typical = system.typical
    K = typical[:, None] * linear.pseudoinverse(white(system.B) * typical).X
    moved = (system.errors.G.T @ white.back(K.T)).T
    names = np.array(list(dict.fromkeys(system.errors.source.tolist())), dtype=object)
    parts = [moved[:, system.errors.source == name] for name in names]
    cov = np.stack([part @ part.T for part in parts])
    if system.relative:
        cov = cov * float(np.sum(white(estimate.residual) ** 2) / max(estimate.dof, 1))
    return _Budget(names, cov)
