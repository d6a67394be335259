"""Evidence for each suspect: F tests, and Bayesian evidence with physical priors.

Model j adds the columns D_j of suspect j to the base X of springs, common errors and accepted
causes, all rows whitened, parameters z in their typical sizes:

    y = X b + D_j z + s e,    e ~ N(0, I),    y = whitened c.

With N, g and rest of `beside` the evidence integrates the parameters out,

    ln p(y | M_j) = ln of the integral of p(y | b, z, s) p(b) p(z | s) p(s) over b, z and s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.system.score_tests import ScoreTests
from pipeline.system.yielding import Yielding

WIDTHS = np.array([0.4, 1.0, 2.5, 6.0])
"""Prior standard deviations of a parameter in its typical size [1]; all have the same weight."""

LARGE_WIDTHS = np.array([30.0, 150.0, 750.0])
"""The same where something is broken, each five times the one before [1]: a normal distribution
gives a size of five standard deviations up, which the next one then takes over."""

_BROKEN = 0.01
"""Prior probability that a cause, if present, is broken rather than of a usual size [1]."""

_EVERY = np.concatenate([WIDTHS, LARGE_WIDTHS])
_SHARES = np.repeat(
    [(1 - _BROKEN) / len(WIDTHS), _BROKEN / len(LARGE_WIDTHS)], [len(WIDTHS), len(LARGE_WIDTHS)]
)
"""Prior probability of each width [1]."""

LEAST_EVIDENCE = 3.0
"""Minimum log evidence of a further cause [1], 20 to 1."""

ROUNDING = 1e-4
"""Mean square in units of the noise below which residuals are rounding and no evidence."""


_LEAST = 1e-100
"""Lower limit of the residual sum of squares of data that the base meets to the last digit: keeps
the logarithms finite."""


@dataclass(frozen=True, eq=False)
class Scores(ScoreTests):
    """Every suspect of the catalogue in addition to one base.

    Attributes:
        bounds: Physical bounds of each parameter, in typical sizes, shape (2, n, k).
        log_odds: Natural log of the prior odds of each suspect relative to any other, shape (n,).
        expected: Expected size of each in typical sizes, shape (n,).
        yielding: Bounds of those that change the compliance of an element; None if none does.
    """

    bounds: Array | None = None
    yielding: Yielding | None = None
    log_odds: Array | float = 0.0
    expected: Array | float = 1.0

    @cached_property
    def log_evidence(self) -> Array:
        """Natural log of the evidence for each suspect, relative to the base alone, shape (n,).

        It includes the prior odds of the suspects, which are all equal unless learnt from other
        campaigns. Directions that the base explains are projected out of N and g, as N N^+ N and N
        N^+ g.
        """
        assert self.bounds is not None  # groups of suspects have none
        N, g = self.N @ self.cov @ self.N, np.einsum("nij,nj->ni", self.N, self.size)
        lower, upper = self.bounds
        found = _evidence(N, g, self.rest, self.dof, lower, upper, self.expected, self.yielding)
        return np.asarray(found + self.log_odds)


def _evidence(
    G: Array,
    h: Array,
    rest: float,
    dof: int,
    lower: Array,
    upper: Array,
    expected: Array | float = 1.0,
    yielding: Yielding | None = None,
) -> Array:
    """Log of p(y | M_j) / p(y | base), shape (n,).

    Priors: p(b) flat, p(s) ~ 1/s, z | s ~ N(0, s^2 w^2 I) between the physical bounds, averaged
    over w in `WIDTHS` and `LARGE_WIDTHS` times the expected size: a usual size is likely, and none
    impossible, or a large cause would lose to several others that share what it does. The ratio is

        mean over w of |I + w^2 G|^(-1/2) (1 - q / rest)^(-dof / 2) prod_i (post_i / prior_i),
        q = h' (G + I / w^2)^-1 h.

    The integral is exact except for the bounds: post_i and prior_i are the probabilities of the
    normal marginals of z_i between the bounds, with s set to its estimate in the posterior and to 1
    in the prior. What changes a compliance has one more such factor, of the probabilities that
    o + n' z >= 0 (`yielding`), as if independent of the others. MacKay, Neural Computation 4 (1992)
    415; unknown s: Zellner, Bayesian Inference in Econometrics (1971).
    """
    k, rest = G.shape[-1], max(rest, _LEAST)
    width = _EVERY[:, None, None] * np.asarray(expected)[..., None]
    inverse = linear.inverse(G + np.eye(k) / width[..., None] ** 2)  # (widths, n, k, k)
    mean = np.einsum("wnij,nj->wni", inverse, h)
    q = np.minimum(np.einsum("nj,wnj->wn", h, mean), rest * (1 - 1e-12))
    logdet = linear.log_det(np.eye(k) + width[..., None] ** 2 * G)
    scatter = np.sqrt(((rest - q) / max(dof, 1))[..., None] * np.einsum("wnii->wni", inverse))
    scatter = np.maximum(scatter, _LEAST)
    inside = _log_share(lower, upper, mean, scatter) - _log_share(lower, upper, 0.0, width)
    out = -0.5 * logdet - 0.5 * dof * np.log1p(-q / rest) + inside.sum(axis=-1)
    if yielding is not None:
        post, post_std = yielding.distance(mean, inverse)
        prior, prior_std = yielding.distance(
            0 * mean, width[..., None] ** 2 * np.eye(k) + 0 * inverse
        )
        out += special.log_ndtr(post / (post_std * np.sqrt((rest - q) / max(dof, 1))))
        out -= special.log_ndtr(prior / prior_std)
    return np.asarray(special.logsumexp(out, axis=0, b=_SHARES[:, None]))


def _log_share(lower: Array, upper: Array, mean: Array | float, scatter: Array | float) -> Array:
    """Log of the probability of a normal distribution between two bounds."""
    low, high = (lower - mean) / scatter, (upper - mean) / scatter
    flipped = low > 0  # work in the lower tail, where differences keep their digits
    low, high = np.where(flipped, -high, low), np.where(flipped, -low, high)
    top, bottom = special.log_ndtr(high), special.log_ndtr(low)
    return np.asarray(top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-12))))
