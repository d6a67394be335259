"""How rough a robot's table is, and which of its parameters is off by far more than the rest.

    y ~ N(D x, V(t)),   x_k ~ N(0, s_k^2),   s_k = r_L for lengths, r_A for angles

The three scales r_L, r_A and t (the joints' errors at a pose) are integrated over a grid, each
logarithmically uniform: with a dozen poses their likeliest values are far too certain. A suspect is
a parameter, or several, that is no part of the rest: its prior is wide. What that does to every
cell of the grid follows from the cell's own covariance C,

    log N(y | free) - log N(y) = 1/2 [ x' S^-1 x - log |E S| - 2 log(w / s) ],  S = E^-1 - C,

E = s^-2 - w^-2 and w the wide prior (matrix determinant lemma), so that all suspects cost one
inverse.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.geometry.unloaded import Rows, Unloaded

_SCALES = np.geomspace(1e-2, 10.0, 7)
"""Of lengths [mm] and angles [mrad], and of the joints' errors over what they usually are: steps of
a half of a decade, over which a standard deviation found from ten numbers spreads anyway."""

_COUNTS = 1e-3
"""Cells of the grid with less than this part of the weight take no part in estimates."""


@dataclass(frozen=True)
class Suspect:
    """Unknowns that may be off by far more than a table is rough.

    Attributes:
        label: Name and place.
        columns: Which unknowns.
        wide: Standard deviation if it is off, in their units.
    """

    label: str
    columns: tuple[int, ...]
    wide: float


@dataclass(frozen=True, eq=False)
class Products(Locked):
    """Sums over poses for each size of the joints' errors.

    Attributes:
        A: D' V^-1 D, shape (t, K, K).
        b: D' V^-1 y, shape (t, K).
        square: y' V^-1 y + log det V, shape (t,).
    """

    A: Array
    b: Array
    square: Array


def products(rows: Rows) -> Products:
    """Sums of some rows."""
    each = [_sums(rows, size) for size in _SCALES]
    return Products(*(np.stack(some) for some in zip(*each, strict=True)))


def _sums(rows: Rows, size: float) -> tuple[Array, Array, Array]:
    W = linear.whitening(rows.cov(size))
    D = (W @ rows.D).reshape(-1, rows.D.shape[2])
    y = np.einsum("pij,pj->pi", W, rows.y).ravel()
    log_det = -2 * np.log(np.einsum("pii->pi", W)).sum()
    return D.T @ D, D.T @ y, np.asarray(y @ y + log_det)


@dataclass(frozen=True, eq=False)
class Cells(Locked):
    """Estimates for every size of the joints' errors and every roughness.

    Attributes:
        zeros: The readings.
        free: What was free.
        std: Standard deviations before the data, shape (c, K).
        rough: Roughness of lengths [m] and angles [rad], shape (c, 2).
        transmission: Index of the size of the joints' errors, shape (c,).
        x: Estimates, shape (c, K).
        cov: Their covariances, shape (c, K, K).
        log: Natural log of the likelihood, whatever the unknowns are, shape (c,).
    """

    zeros: Unloaded
    free: tuple[Suspect, ...]
    std: Array
    rough: Array
    transmission: Ints
    x: Array
    cov: Array
    log: Array

    @cached_property
    def weight(self) -> Array:
        """Probability of each cell, shape (c,)."""
        return np.asarray(special.softmax(self.log))

    @property
    def evidence(self) -> float:
        """Natural log of the likelihood, whatever scales and unknowns are."""
        return float(special.logsumexp(self.log))

    @property
    def best(self) -> int:
        """The likeliest cell."""
        return int(np.argmax(self.log))

    @cached_property
    def mean(self) -> Array:
        """Estimates, averaged over the cells, shape (K,)."""
        return np.asarray(self.weight @ self.x)

    @cached_property
    def covariance(self) -> Array:
        """Of the estimates, with what the cells differ by, shape (K, K)."""
        kept = self.weight > _COUNTS
        apart = self.x[kept] - self.mean
        w = self.weight[kept] / self.weight[kept].sum()
        within = np.einsum("c,cij->ij", w, self.cov[kept])
        return np.asarray(within + np.einsum("c,ci,cj->ij", w, apart, apart))

    @cached_property
    def roughness(self) -> Array:
        """Of lengths [m] and angles [rad], root of the mean square, shape (2,)."""
        return np.asarray(np.sqrt(self.weight @ self.rough**2))

    @property
    def per_letter(self) -> Array:
        """The same for each geometric parameter, shape (k,)."""
        return np.where(self.zeros.turns, self.roughness[1], self.roughness[0])

    def p_exact(self) -> float:
        """Chance of so rough a table in a robot that is as delivered.

        Likelihood ratio of two scales against their smallest values, chi-square of two degrees of
        freedom, which is too large as both lie at an end of their range.
        """
        smooth = np.all(self.rough <= self.rough.min(axis=0), axis=1)
        ratio = 2 * (self.log.max() - self.log[smooth].max())
        return float(special.chdtrc(2, ratio))

    def freed(self, one: Suspect) -> Array:
        """Likelihood with one more of the suspects free, natural log, shape (c,).

        With P = s^-2 of its unknowns before and w^-2 after, E = P - w^-2, S = E^-1 - C_kk:
        log |M'| = log |M| + log |E S| and b' M'^-1 b = b' x + x_k' S^-1 x_k.
        """
        at = list(one.columns)
        x, C = self.x[:, at], self.cov[:, at][:, :, at]
        less = self.std[:, at] ** -2 - one.wide**-2
        S = np.einsum("ck,kl->ckl", 1 / less, np.eye(len(at))) - C
        gain = np.einsum("ck,ck->c", x, linear.solve(S, x))
        occam = np.log(less).sum(axis=1) + linear.log_det(S)
        wider = 2 * (np.log(one.wide) - np.log(self.std[:, at])).sum(axis=1)
        return np.asarray(self.log + 0.5 * (gain - occam - wider))

    def p_value(self, one: Suspect, beside: Array) -> float:
        """Chance of unknowns of so much if they were of one kind with the rest.

        |x|^2 in (C + r^2), the roughness r found without them, is chi2 in each cell.

        Args:
            one: A suspect that is free.
            beside: Roughness that they would have, shape (c, columns).
        """
        at = list(one.columns)
        x, C = self.x[:, at], self.cov[:, at][:, :, at]
        whole = C + np.einsum("ck,kl->ckl", beside**2, np.eye(len(at)))
        far = np.einsum("ck,ck->c", x, linear.solve(whole, x))
        return float(self.weight @ special.chdtrc(len(at), far))


def cells(zeros: Unloaded, sums: Products, free: Sequence[Suspect] = ()) -> Cells:
    """Estimates for every cell of the grid.

    Args:
        zeros: The readings.
        sums: Their products.
        free: Suspects that are off.
    """
    t, L, A = np.meshgrid(np.arange(len(_SCALES)), _SCALES, _SCALES, indexing="ij")
    rough = 1e-3 * np.column_stack([L.ravel(), A.ravel()])
    return _estimated(zeros, sums, free, _std(zeros, rough, free), rough, t.ravel())


def straight(zeros: Unloaded, sums: Products) -> Cells:
    """The table as it is, its joints without errors: only place, stated turn and tool are free."""
    still = np.zeros((1, 2))
    std = zeros.held()[None]
    return _estimated(zeros, sums, (), std, still, np.zeros(1, dtype=np.int64))


def _std(zeros: Unloaded, rough: Array, free: Iterable[Suspect]) -> Array:
    std = np.tile(zeros.held(), (len(rough), 1))
    std[:, zeros.columns.table] = np.hypot(rough[:, zeros.turns.astype(int)], zeros.stated)
    std[:, zeros.columns.loose] = rough[:, 1:]  # how the rail lies in F_b is an angle like others
    for one in free:
        std[:, list(one.columns)] = one.wide
    return std


def _estimated(
    zeros: Unloaded,
    sums: Products,
    free: Sequence[Suspect],
    std: Array,
    rough: Array,
    transmission: Ints,
) -> Cells:
    """Estimates with unknowns in units of their standard deviations, which numbers like better."""
    A, b = sums.A[transmission], sums.b[transmission]
    M = np.eye(std.shape[1]) + std[:, :, None] * A * std[:, None, :]
    size = np.sqrt(np.einsum("cii->ci", M))
    scaled = M / (size[:, :, None] * size[:, None, :])
    inverse = linear.regular_inverse(scaled)
    unit = std / size
    cov = unit[:, :, None] * inverse * unit[:, None, :]
    x = np.einsum("cij,cj->ci", cov, b)
    log_det = linear.log_det(scaled) + 2 * np.log(size).sum(axis=1)
    log = -0.5 * (sums.square[transmission] - np.einsum("ci,ci->c", b, x) + log_det)
    return Cells(zeros, tuple(free), std, rough, transmission, x, cov, log)


def left_out(found: Cells, rows: Rows) -> Array:
    """What each pose is missed by when the rest predicts it [m], the likeliest scales, (z, 3).

    e_i / (1 - H_i), H_i = X_i C X_i' in whitened rows: the estimate without pose i, exactly.
    """
    cell = found.best
    W = linear.whitening(rows.cov(_SCALES[found.transmission[cell]]))
    X = W @ rows.D
    e = np.einsum("pij,pj->pi", W, rows.y) - X @ found.x[cell]
    rest = np.eye(X.shape[1]) - X @ found.cov[cell] @ np.swapaxes(X, 1, 2)
    missed = linear.solve(W, linear.solve(rest, e))
    return np.asarray(missed[rows.place])


def same(zeros: Unloaded, sums: Products, one: Suspect, other: Suspect) -> bool:
    """Whether no pose tells two parameters apart: place and tool estimated, they move alike."""
    if len(one.columns) > 1 or len(other.columns) > 1:
        return False
    where = zeros.columns
    at = np.r_[where.shift, where.tool, one.columns[0], other.columns[0]]
    N = linear.unit(sums.A[0][np.ix_(at, at)])[0]
    k = len(at) - 2
    S = N[k:, k:] - N[k:, :k] @ linear.inverse(N[:k, :k]) @ N[:k, k:]
    there = S[0, 0] > _ALIKE and S[1, 1] > _ALIKE  # else it only says where F_b or the tool is
    return bool(there and S[0, 1] ** 2 > (1 - _ALIKE) * S[0, 0] * S[1, 1])


_ALIKE = 1e-6
"""Two columns whose squared cosine is nearer to one than this are one."""
