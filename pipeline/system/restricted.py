"""Restricted likelihood of the scales of noise components, by pose, and its maximum.

It is used for all scatter, of contrasts and of residuals alike (Patterson and Thompson, Biometrika
58 (1971) 545).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.system.blocks import Blocks
from pipeline.system.system import System

_Loss = Callable[[Array], tuple[Array, float]]
"""Minus twice a restricted log likelihood as a function of log scales: part of each pose, and the
rest."""


@dataclass(frozen=True, eq=False)
class _Together(Locked):
    """Poses of `Blocks.alike`.

    Attributes:
        rows: By pose, at most s each.
        both: Orthonormal fixed effects, errors common to all poses, and y, shape (p, s, k + r + 1).
        parts: Covariance of each component as stated, then of the rest, shape (n + 1, p, s, s).
    """

    rows: Blocks
    both: Array
    parts: Array

    def whitened(self, weights: Array) -> tuple[Array, Array]:
        """log|V_p| of each pose, shape (p,), and `both` whitened by pose, shape (p, s, k + r + 1).

        V_p = sum_k weights_k parts_kp.

        Raises:
            LinAlgError: A direction has no noise.
        """
        V = np.einsum("k,kpij->pij", weights, self.parts)
        L = self.rows.square(lambda own: np.asarray(np.linalg.cholesky(own)), V)
        return 2 * np.log(np.einsum("pii->pi", L)).sum(axis=1), self.rows.solve(L, self.both)


@dataclass(frozen=True, eq=False)
class PaddedRows(Locked):
    """Rows by pose: y, the fixed effects, and the parts of V.

    Attributes:
        together: The poses, those of one size together where one is large.
        prior: 0 for the fixed effects, 1 for the common errors, which are random, shape (k + r,).
        rough: Common log scale of all components that reproduces the residual mean square.
        dof: Rows minus fixed effects.
    """

    together: tuple[_Together, ...]
    prior: Array
    rough: float
    dof: int

    @classmethod
    def of(cls, system: System, X: Array, groups: Sequence[Sequence[str]]) -> PaddedRows:
        """The rows of a system with fixed effects X (M, k); sources of error by component.

        The fixed effects are reduced to independent ones once: if their rank were decided anew at
        every scale, a direction near the limit would come and go and pass for evidence.
        """
        return cls.beside(system, linear.orthonormal(X), groups)

    @classmethod
    def beside(cls, system: System, Q: Array, groups: Sequence[Sequence[str]]) -> PaddedRows:
        """The same with orthonormal fixed effects (M, k)."""
        errors = system.errors
        unit = linear.rms(system.c) or 1.0
        y = (system.c - Q @ (Q.T @ system.c)) / unit  # free of the fixed effects
        A = errors.G[:, errors.common].toarray() / unit
        source, own = errors.source.astype(str), ~errors.common
        rest = ~np.isin(source, [name for group in groups for name in group])
        masks = [np.isin(source, group) for group in groups] + [rest]
        both, stated = np.column_stack([Q, A, y]), 0.0
        together: list[_Together] = []
        blocks = Blocks.of(system.rows.pose)
        for mine, some in map(blocks.only, blocks.alike):
            G = errors.G[mine]
            parts = np.stack([some.covariance(G[:, mask & own]) for mask in masks]) / unit**2
            stated += float(np.einsum("kpii->", parts[:-1]))
            which, at = np.nonzero(~some.there)
            parts[-1, which, at, at] = 1.0  # padding: independent rows of zeros
            together.append(_Together(some, some.padded(both[mine]), parts))
        return cls(
            together=tuple(together),
            prior=np.repeat([0.0, 1.0], [Q.shape[1], A.shape[1]]),
            rough=0.5 * float(np.log(max(float(y @ y), linear.TINY) / max(stated, linear.TINY))),
            dof=len(Q) - Q.shape[1],
        )

    def loss(self, log_scale: Array) -> tuple[Array, float]:
        """Minus twice the restricted log likelihood: part of each pose, shape (p,), and of X.

        sum_p (log|V_p| + y_p' V_p^-1 y_p)  and  log|N| - g' N^-1 g,

        N = sum_p X_p' V_p^-1 X_p + diag(prior), g = sum_p X_p' V_p^-1 y_p, and
        V_p = sum_k exp(2 t_k) parts_kp + rest_p, t the log scales. With A the common errors that is
        log|V| + log|X' V^-1 X| + r' V^-1 r for the whole V = V_own + A A', up to a constant.
        """
        weights = np.append(np.exp(2 * log_scale), 1.0)
        try:
            found = [group.whitened(weights) for group in self.together]
        except np.linalg.LinAlgError:
            return np.full(sum(group.rows.shape[0] for group in self.together), np.inf), 0.0
        own = np.concatenate([log + (both[..., -1] ** 2).sum(axis=1) for log, both in found])
        if not len(self.prior):
            return own, 0.0
        rows = np.concatenate([both.reshape(-1, both.shape[2]) for _, both in found])
        X = rows[:, :-1]
        return own, of_fixed(X.T @ X + np.diag(self.prior), X.T @ rows[:, -1])

    def whole(self, log_scale: Array) -> float:
        """Minus twice the restricted log likelihood, up to a constant."""
        own, rest = self.loss(log_scale)
        return float(own.sum() + rest)

    def of_scales(self, determined: Bools) -> _Loss:
        """The loss as a function of the log scales in `determined`; the others stay as stated."""

        def loss(x: Array) -> tuple[Array, float]:
            full = np.zeros(len(determined))
            full[determined] = x
            return self.loss(full)

        return loss


def of_fixed(N: Array, g: Array) -> float:
    """Part of the fixed effects in the loss, log|N| - g' N^-1 g, of N (k, k) and g (k,)."""
    try:
        factor = linear.cholesky(N)
    except np.linalg.LinAlgError:  # rows with almost no noise
        return float(linear.log_det(N) - g @ linear.solve(N, g))
    return float(factor.log_det - g @ factor.solve(g))


_STEP = 3e-3
"""Step in log scale for first and second derivatives [1]."""


def maximum(blocks: PaddedRows, determined: Bools) -> tuple[Array, Array, Array]:
    """The log scales that the data determine, their standard uncertainties and p-values.

    With L the loss, H its Hessian and g_p the gradient of pose p's part, u(t)^2 is the larger of 2
    H^-1 and the sandwich H^-1 (sum_p g_p g_p') H^-1 (White, Econometrica 50, 1982), diagonals
    taken. p = P[chi2(1) > (L(t_k = 0) - min L) / f] / 2, f >= 1 their ratio, or 1 minus that where
    t_k < 0: the likelihood ratio against the component as stated. The curvature is no substitute: a
    component may stand out clearly at a scale at which it would be invisible.
    """
    loss, start = blocks.of_scales(determined), np.full(int(determined.sum()), blocks.rough)
    x = lowest(loss, start)
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
    for i, k in enumerate(np.flatnonzero(determined)):
        as_stated = blocks.of_scales(determined & (np.arange(len(determined)) != k))
        worse = _total(as_stated, lowest(as_stated, np.delete(x, i))) - best
        tail = 0.5 * chi2_beyond(max(worse, 0.0) / longer[i], 1)
        p[i] = tail if x[i] > 0 else 1 - tail
    return x, np.sqrt(information * longer), p


def lowest(loss: _Loss, start: Array) -> Array:
    """Minimum of a loss by Newton's method."""
    x = start
    for _ in range(40 if len(x) else 0):
        gradient, H, _ = _derivatives(loss, x)
        if not np.isfinite(H).all():  # rows without noise: rounding is left
            break
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
