"""How strongly the data speak for each suspect: F tests, and evidence with physical priors.

Model j adds the columns Z_j of suspect j to the base X of springs, common errors and accepted
causes, all rows whitened, parameters z in their typical sizes:

    y = X b + Z_j z + s e,    e ~ N(0, I),    y = whitened c.

What the base leaves is G = Z_j' P Z_j, h = Z_j' P y and rest = y' P y, P the projection orthogonal
to X. The evidence integrates the parameters out,

    ln p(y | M_j) = ln of the integral of p(y | b, z, s) p(b) p(z | s) p(s) over b, z and s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.system.elimination import eliminate
from pipeline.system.whitened import Whitened

WIDTHS = np.array([0.4, 1.0, 2.5, 6.0])
"""Prior standard deviations of a parameter in its typical size; each has the same weight."""


ROUNDING = 1e-4
"""Mean square in units of the noise below which residuals are rounding and no evidence."""


@dataclass(frozen=True, eq=False)
class Scores(Locked):
    """Statistics of every suspect added to one base.

    Attributes:
        T: Drop of the sum of squares when the suspect joins, h' G^+ h, shape (n,). Over the
            variance it is also Rao's score statistic (Rao, Proc. Cambridge Phil. Soc. 44, 1948).
        rank: Number of parameters that the data can tell from the base, shape (n,).
        log_evidence: Natural log of the evidence for it, over the base alone, shape (n,).
        rest: Sum of squares of the base alone.
        dof: Its degrees of freedom.
    """

    T: Array
    rank: Ints
    log_evidence: Array
    rest: float
    dof: int

    @property
    def p(self) -> Array:
        """Probability of a drop this large by chance, shape (n,).

        F = (T / rank) / ((rest - T) / (dof - rank)), with rank and dof - rank degrees of freedom.
        """
        left = np.maximum(self.rest - self.T, 1e-300)
        dof = np.maximum(self.dof - self.rank, 1)
        rank = np.maximum(self.rank, 1)
        F = (self.T / rank) / (left / dof)
        return np.where(self.rank > 0, special.fdtrc(rank, dof, F), 1.0)


def scores(view: Whitened, base: Ints, dof: int, M: Array | None = None) -> Scores:
    """Score every suspect added to a base.

    Args:
        view: The campaign, whitened.
        base: Columns of the base.
        dof: Rows minus parameters of the base.
        M: Products to use instead of the whole campaign's.
    """
    whole = view.M if M is None else M
    S = eliminate(whole, base)
    n = len(view.suspects)
    T, rank = np.zeros(n), np.zeros(n, dtype=np.int64)
    log_evidence = np.zeros(n)
    rest = max(float(S[-1, -1]), ROUNDING * dof)
    size = np.bincount(view.owner, minlength=n)
    first = view.first + np.concatenate([[0], np.cumsum(size)[:-1]])
    for k in np.unique(size):
        members = np.flatnonzero(size == k)
        columns = first[members][:, None] + np.arange(k)
        G = S[columns[:, :, None], columns[:, None, :]]
        h = S[columns, -1]
        left, rank[members] = linear.left(G, whole[columns, columns])
        T[members] = np.einsum("ni,nij,nj->n", h, left, h)
        G, h = _clean(G, h, whole[columns, columns])
        log_evidence[members] = _evidence(G, h, rest, dof, *_bounds(view, members))
    return Scores(T, rank, log_evidence, rest, dof)


def _clean(G: Array, h: Array, full: Array) -> tuple[Array, Array]:
    """G and h without directions that are rounding.

    Directions are judged in units of the whole columns: what the base explains to seven digits
    is the base.
    """
    size = np.sqrt(np.maximum(full, 1e-100))
    values, vectors = linear.directions(G / (size[:, :, None] * size[:, None, :]))
    kept = values > linear.LEFT
    seen = vectors * kept[:, None, :]
    along = np.einsum("nij,ni->nj", seen, h / size)
    G = np.einsum("nij,nj,nkj->nik", seen, values, seen) * size[:, :, None] * size[:, None, :]
    return G, np.einsum("nij,nj->ni", seen, along) * size


def _evidence(G: Array, h: Array, rest: float, dof: int, lower: Array, upper: Array) -> Array:
    """Log of p(y | M_j) / p(y | base), shape (n,).

    Priors: p(b) flat, p(s) ~ 1/s, z | s ~ N(0, s^2 w^2 I) between the physical bounds, averaged
    over w in `WIDTHS`. The ratio is

        mean over w of |I + w^2 G|^(-1/2) (1 - q / rest)^(-dof / 2) prod_i (post_i / prior_i),
        q = h' (G + I / w^2)^-1 h.

    The integral is exact but for the bounds: post_i and prior_i are the parts of the normal
    marginals of z_i between them, s put at its estimate after and at 1 before the data. MacKay,
    Neural Computation 4 (1992) 415; unknown s: Zellner, Bayesian Inference in Econometrics (1971).
    """
    k = G.shape[-1]
    width = WIDTHS[:, None, None]
    inverse = linear.inverse(G + np.eye(k) / width[..., None] ** 2)  # (widths, n, k, k)
    mean = np.einsum("wnij,nj->wni", inverse, h)
    q = np.minimum(np.einsum("nj,wnj->wn", h, mean), rest * (1 - 1e-12))
    logdet = linear.log_det(np.eye(k) + width[..., None] ** 2 * G)
    scatter = np.sqrt(((rest - q) / max(dof, 1))[..., None] * np.einsum("wnii->wni", inverse))
    inside = _log_share(lower, upper, mean, scatter) - _log_share(lower, upper, 0.0, width)
    out = -0.5 * logdet - 0.5 * dof * np.log1p(-q / rest) + inside.sum(axis=-1)
    return np.asarray(special.logsumexp(out, axis=0) - np.log(len(WIDTHS)))


def _log_share(lower: Array, upper: Array, mean: Array | float, scatter: Array | float) -> Array:
    """Log of the part of a normal distribution between two bounds."""
    low, high = (lower - mean) / scatter, (upper - mean) / scatter
    flipped = low > 0  # work in the lower tail, where differences keep their digits
    low, high = np.where(flipped, -high, low), np.where(flipped, -low, high)
    top, bottom = special.log_ndtr(high), special.log_ndtr(low)
    return np.asarray(top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-12))))


def _bounds(view: Whitened, members: Ints) -> tuple[Array, Array]:
    """Physical bounds in typical sizes, both shape (n, k)."""
    suspects = [view.suspects[i].parameters for i in members]
    lower = np.array([[p.lower / p.typical for p in parameters] for parameters in suspects])
    upper = np.array([[p.upper / p.typical for p in parameters] for parameters in suspects])
    return lower, upper
