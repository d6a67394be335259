"""Restricted likelihood of the scales of noise components, by pose, and where it is largest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.system.system import System

_Loss = Callable[[Array], tuple[Array, float]]
"""Minus twice a restricted log likelihood by log scales: part of each pose, and the rest."""


@dataclass(frozen=True, eq=False)
class Blocks(Locked):
    """Rows by pose, padded to the largest: y, X and the parts of V.

    Attributes:
        y: Shape (p, s).
        X: Orthonormal fixed effects, shape (p, s, k).
        parts: Covariance of each component as stated, then of the rest, shape (n + 1, p, s, s).
        dof: Rows minus fixed effects.
    """

    y: Array
    X: Array
    parts: Array
    dof: int

    @classmethod
    def of(cls, system: System, X: Array, groups: Sequence[Sequence[str]]) -> Blocks:
        index, place, count = linear.numbered(system.rows.pose)
        p, s = len(count), int(count.max())
        unit = float(np.sqrt(np.mean(system.c**2))) or 1.0
        Q = linear.orthonormal(X)
        y, wide = np.zeros((p, s)), np.zeros((p, s, Q.shape[1]))
        y[index, place], wide[index, place] = (system.c - Q @ (Q.T @ system.c)) / unit, Q
        source = system.errors.source.astype(str)
        rest = ~np.isin(source, [name for group in groups for name in group])
        parts = np.zeros((len(groups) + 1, p, s, s))
        masks = [np.isin(source, group) for group in groups] + [rest]
        for k, mask in enumerate(masks):
            own = system.errors.G[:, mask & ~system.errors.common]
            V = (own @ own.T).tocoo()
            parts[k, index[V.row], place[V.row], place[V.col]] = V.data / unit**2
        empty = np.ones((p, s), dtype=bool)
        empty[index, place] = False
        which, at = np.nonzero(empty)
        parts[-1, which, at, at] = 1.0  # padding: independent rows of zeros
        return cls(y, wide, parts, len(index) - Q.shape[1])

    @property
    def rough(self) -> float:
        """Log scale that gives the rows their mean square if all components share it."""
        stated = np.einsum("kpii->", self.parts[:-1])
        return float(0.5 * np.log(np.sum(self.y**2) / stated))

    def loss(self, log_scale: Array) -> tuple[Array, float]:
        """Minus twice the restricted log likelihood: part of each pose, shape (p,), and of X.

        sum_p (log|V_p| + y_p' V_p^-1 y_p)  and  log|N| - g' N^-1 g,  N = sum_p X_p' V_p^-1 X_p,
        g = sum_p X_p' V_p^-1 y_p,  V_p = sum_k exp(2 t_k) parts_kp + rest_p, t the log scales.
        """
        weights = np.append(np.exp(2 * log_scale), 1.0)
        V = np.einsum("k,kpij->pij", weights, self.parts)
        try:
            L = np.linalg.cholesky(V)
        except np.linalg.LinAlgError:
            return np.full(len(self.y), np.inf), 0.0
        both = linear.solve(L, np.concatenate([self.X, self.y[..., None]], axis=2))
        X, y = both[..., :-1], both[..., -1]
        own = 2 * np.log(np.einsum("pii->pi", L)).sum(axis=1) + (y**2).sum(axis=1)
        if not X.shape[2]:
            return own, 0.0
        N = np.einsum("psi,psj->ij", X, X)
        g = np.einsum("psi,ps->i", X, y)
        return own, float(linear.log_det(N) - g @ linear.solve(N, g))

    def of_scales(self, told: Bools) -> _Loss:
        """The loss as a function of some log scales; the other components stay as stated."""

        def loss(x: Array) -> tuple[Array, float]:
            full = np.zeros(len(told))
            full[told] = x
            return self.loss(full)

        return loss


_STEP = 3e-3
"""Differences of log scale for first and second derivatives."""


def maximum(blocks: Blocks, told: Bools) -> tuple[Array, Array, Array]:
    """The log scales that the data determine, their standard uncertainties and p-values.

    With L the loss, H its Hessian and g_p the gradient of pose p's part, u(t)^2 is the larger of
    2 H^-1 and the sandwich H^-1 (sum_p g_p g_p') H^-1 (White, Econometrica 50, 1982), diagonals
    taken. p = P[chi2(1) > (L(t_k = 0) - min L) / f] / 2, f >= 1 their ratio, or 1 minus that where
    t_k < 0: the likelihood ratio against the component as stated. A curvature says nothing of it:
    a component may stand out clearly at a scale at which it would be invisible.
    """
    loss, start = blocks.of_scales(told), np.full(int(told.sum()), blocks.rough)
    x = _lowest(loss, start)
    _, H, scores = _derivatives(loss, x)
    values, vectors = linear.directions(H)
    if values.min() <= 0:
        weak = (vectors[:, values <= 1e-3] ** 2).sum(axis=1) > 0.1
        cov = (vectors / np.maximum(values, 1e-3)) @ vectors.T
        information, longer = 2 * np.where(weak, np.inf, np.diag(cov)), np.ones(len(x))
    else:
        inverse = (vectors / values) @ vectors.T
        sandwich = np.diag(inverse @ (scores.T @ scores) @ inverse)
        information = 2 * np.diag(inverse)
        longer = np.maximum(sandwich / information, 1.0)
    best, p = _total(loss, x), np.empty(len(x))
    for i, k in enumerate(np.flatnonzero(told)):
        others = told & (np.arange(len(told)) != k)
        as_stated = blocks.of_scales(others)
        worse = _total(as_stated, _lowest(as_stated, np.delete(x, i))) - best
        tail = 0.5 * stats.chi2.sf(max(worse, 0.0) / longer[i], 1)
        p[i] = tail if x[i] > 0 else 1 - tail
    return x, np.sqrt(information * longer), p


def _lowest(loss: _Loss, start: Array) -> Array:
    """Where a loss is lowest, by Newton's method."""
    x = start
    for _ in range(40):
        if not len(x):
            break
        gradient, H, _ = _derivatives(loss, x)
        values, vectors = linear.directions(H)
        move = vectors @ (vectors.T @ gradient / np.maximum(np.abs(values), 0.5))
        move = np.clip(move, -0.7, 0.7)
        x = np.clip(x - move, start - 4.0, start + 4.0)
        if np.abs(move).max() < 1e-4:
            break
    return x


def _derivatives(loss: _Loss, x: Array) -> tuple[Array, Array, Array]:
    """Gradient and Hessian of the loss, and gradient of each pose's part, shape (p, n)."""
    n = len(x)
    steps = _STEP * np.eye(n)
    here = _total(loss, x)
    ahead = [loss(x + d) for d in steps]
    behind = [loss(x - d) for d in steps]
    up = np.array([own.sum() + rest for own, rest in ahead])
    down = np.array([own.sum() + rest for own, rest in behind])
    scores = np.stack([(a[0] - b[0]) / (2 * _STEP) for a, b in zip(ahead, behind, strict=True)], 1)
    H = np.diag((up - 2 * here + down) / _STEP**2)
    for i in range(n):
        for j in range(i):
            both = _total(loss, x + steps[i] + steps[j])
            H[i, j] = H[j, i] = (both - up[i] - up[j] + here) / _STEP**2
    return (up - down) / (2 * _STEP), H, scores


def _total(loss: _Loss, x: Array) -> float:
    own, rest = loss(x)
    return float(own.sum() + rest)
