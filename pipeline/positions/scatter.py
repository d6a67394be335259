"""Scatter of the readings about the model: joint errors at each pose, and instrument noise.

Rows of a pose have the covariance V = Z diag(s_j^2) Z' + diag(n^2), with n the noise of positions
or of rotations. The variances maximise the restricted likelihood (Patterson and Thompson,
Biometrika 58, 1971) by expectation-maximisation: products of residuals, corrected for what the
estimate has absorbed, take the place of those of the true errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.unloaded import START
from pipeline.machine.robot import Robot
from pipeline.positions.mechanism import Linear

_NOISE = (3e-5, 5e-5)
"""Initial noise of positions [m] and rotations [rad]."""

_STEPS, _HALVED = 30, 12
"""Maximum numbers of scoring steps before the products are updated, and of halvings of one."""

_FLAT = 1e-2
"""Gain of the log likelihood by a step that ends the search [1]: a decision takes units."""

_LEAST, _MOST = float(np.exp(-36.0)), float(np.exp(-4.0))
"""Bounds of the variances [m^2 or rad^2]: standard deviations between 1e-8 and 0.1 m or rad."""


@dataclass(frozen=True, eq=False)
class PoseScatter(Locked):
    """Standard deviations of the readings about the model.

    Attributes:
        joints: Error of each joint at a pose [m] or [rad], shape (n,).
        position: Noise of a coordinate [m].
        rotation: Noise of a rotation [rad].
        stated: Whether `position` is stated, and therefore not estimated.
    """

    joints: Array
    position: float
    rotation: float
    stated: bool = False

    def factors(self, rows: Linear) -> tuple[Array, Array]:
        """L and W = L^-1 with V = L L' of each pose, over the rows read at any, (m, r, r) each."""
        of = _RowsByPose.of(rows, len(self.joints))
        pair = triangular(of.cov(np.append(self.joints, [self.position, self.rotation]) ** 2))
        L, W = (np.ascontiguousarray(np.moveaxis(one, 2, 0)) for one in pair)
        return L, W

    def better(self, rows: Linear, products: Array) -> tuple[PoseScatter, float]:
        """Maximum-likelihood scatter given the products of residuals (m, r, r), and its gain."""
        n = len(self.joints)
        free = np.append(np.ones(n, dtype=bool), [not self.stated, rows.read[:, 3::6].any()])
        now = np.append(self.joints, [self.position, self.rotation])
        v, gain = likeliest_variances(_Likelihood(rows, products, n), now**2, free)
        s = np.where(free, np.sqrt(v), now)
        return PoseScatter(s[:n], float(s[n]), float(s[n + 1]), self.stated), gain


def likeliest_variances(of: _Likelihood, now: Array, free: Bools) -> tuple[Array, float]:
    """The variances (n + 2,) that maximise a likelihood, by Fisher scoring, and what they gain.

    With gradient g and Fisher information F of f, each step minimises the quadratic

        g'd + d'F d / 2,    v + d >= `_LEAST`,

    by non-negative least squares, and is halved until f falls. For a single variance one step is
    exact; in the variances, unlike in their logarithms, so is one that ends at zero.

    Args:
        of: Negative log likelihood of the variances.
        now: Where to start, shape (n + 2,).
        free: Which of them are estimated, shape (n + 2,).
    """
    v = np.where(free, np.clip(now, _LEAST, _MOST), now)
    here = begun = of(v)
    for _ in range(_STEPS):
        step, gain = _scored(here, v, free)
        if gain < _FLAT:  # too little for a further evaluation
            last = np.where(free, np.clip(v + step, _LEAST, _MOST), v)
            return last, begun.value - here.value + gain
        for part in 0.5 ** np.arange(_HALVED):
            then = np.where(free, np.clip(v + part * step, _LEAST, _MOST), v)
            there = of(then)
            if there.value < here.value:
                break
        else:
            break
        v, here = then, there
    return v, begun.value - here.value


def _scored(here: _Slopes, v: Array, free: Bools) -> tuple[Array, float]:
    """A step of Fisher scoring (n + 2,), and how much it promises to gain."""
    out, told = np.zeros(len(v)), np.flatnonzero(free & (np.diag(here.information) > 0))
    if not len(told):
        return out, 0.0
    F, g = here.information[np.ix_(told, told)], here.slope[told]
    size = np.diag(F) ** -0.5
    F, g, y = F * size * size[:, None] + _ROUNDED * np.eye(len(F)), g * size, v[told] / size
    least = _LEAST / size
    known = linear.cholesky(F)
    half = known.lower.T / known.scale  # F = half' half
    new, _ = optimize.nnls(half, half @ known.solve(F @ (y - least) - g))
    d = new + least - y
    out[told] = d * size
    return out, float(-(g @ d) - 0.5 * d @ F @ d)


def start(robot: Robot, sigma_m: float | None) -> PoseScatter:
    """Initial scatter; `sigma_m` is the stated noise of a coordinate [m], or None."""
    joints = np.array([START[joint.prismatic] for joint in robot.joints])
    return PoseScatter(joints, sigma_m or _NOISE[0], _NOISE[1], sigma_m is not None)


_ROUNDED = 1e-12
"""Relative increase of a variance that is lost in the rounding of a larger one [1]."""


class _RowsByPose(NamedTuple):
    """Products of all poses by pairs of rows, a lower triangle of p = r (r + 1) / 2 at each pose.

    Attributes:
        pairs: Rows of each pair, (p,) each.
        Z: Products of derivatives by the joints, shape (n, p, m).
        read: Which rows were read at each pose, shape (r, m).
        turns: Which rows are rotations, shape (r,).
    """

    pairs: tuple[Ints, ...]
    Z: Array
    read: Bools
    turns: Bools

    @classmethod
    def of(cls, rows: Linear, n: int) -> _RowsByPose:
        read, pairs = np.asarray(rows.seen[3].T), rows.pairs
        i, j = np.tril_indices(len(read))
        return cls((i, j), pairs[:n], read, rows.used % 6 >= 3)

    def cov(self, v: Array) -> Array:
        """Lower half of V of each pose, (r, r, m), for v (n + 2,); 1 for rows not read."""
        (n, _, m), r = self.Z.shape, len(self.read)
        V, (i, j), each = np.zeros((r, r, m)), self.pairs, np.arange(r)
        V[i, j] = (v[:n] @ self.Z.reshape(n, -1)).reshape(-1, m)
        V[each, each] += np.where(self.read, v[n + self.turns.astype(int), None], 1.0)
        return V


class _Slopes(NamedTuple):
    """Negative log likelihood at some variances.

    Attributes:
        value: f.
        slope: Its gradient by the variances, shape (n + 2,).
        information: Its expected second derivatives, shape (n + 2, n + 2).
    """

    value: float
    slope: Array
    information: Array


class _Likelihood:
    """Negative log likelihood of the products, as a function of the variances.

    f = 1/2 sum over poses (log det V + tr V^-1 P), V = sum_k v_k X_k X_k', and with Y = W X, W'W =
    V^-1, and Q = W P W'

        df / dv_k = 1/2 sum (|Y_k|^2 - tr Y_k' Q Y_k),    F_kl = 1/2 sum |Y_k' Y_l|^2.
    """

    def __init__(self, rows: Linear, products: Array, n: int) -> None:
        self.rows = _RowsByPose.of(rows, n)
        self.products = products
        own = np.eye(len(rows.used)) * self.rows.read.T[:, None]
        self.columns = np.concatenate([rows.seen[2][:, :, :n], own], axis=2)
        kind = np.append(np.arange(n), n + self.rows.turns)
        self.of = (kind[:, None] == np.arange(n + 2)).astype(float)

    def __call__(self, variances: Array) -> _Slopes:
        W = np.ascontiguousarray(np.moveaxis(triangular(self.rows.cov(variances))[1], 2, 0))
        Y = W @ self.columns
        G = np.swapaxes(Y, 1, 2).copy() @ Y  # of one array, numpy takes a slower way
        Q = W @ self.products @ np.swapaxes(W, 1, 2)
        f = 0.5 * float(np.einsum("mii->", Q)) - float(np.log(np.einsum("mii->mi", W)).sum())
        slope = np.einsum("mkk->k", G) - np.einsum("mrk,mrk->k", Q @ Y, Y)
        information = np.einsum("mkl,mkl->kl", G, G)
        return _Slopes(f, 0.5 * self.of.T @ slope, 0.5 * self.of.T @ information @ self.of)


def triangular(V: Array) -> tuple[Array, Array]:
    """Cholesky factors L of positive definite V = L L', and their inverses, both (k, k, m).

    For m small matrices along the last axis, (k, k, m): all rows of a column at once are faster
    than a call for each matrix. V is regularised as in `linear.whitening`.

    Raises:
        LinAlgError: A row has no variance.
    """
    L, W = np.zeros_like(V), np.zeros_like(V)
    for j in range(len(V)):
        column = V[j:, j] - np.einsum("ikm,km->im", L[j:, :j], L[j, :j])
        if not (column[0] > 0).all():
            if not (np.einsum("iim->im", V) > 0).all():
                raise np.linalg.LinAlgError("a row has no variance")
            return triangular(V + _ROUNDED * V * np.eye(len(V))[:, :, None])
        W[j, j] = 1 / np.sqrt(column[0])
        L[j:, j] = column * W[j, j]
        W[j, :j] = -W[j, j] * np.einsum("km,kim->im", L[j, :j], W[:j, :j])
    return L, W
