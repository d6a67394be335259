"""Weighted least squares for a mechanism: table, tool, frames, springs, laws and curves at once.

    sum over poses |W (y - D x - Z K k)|^2  +  sum ((x - x0) / sigma)^2  +  k' C^-1 k  is smallest

with W'W = V^-1 of `scatter`, what is stated or usual x0 +- sigma, and C the covariance of the
curves' knots. The scale of the priors (how rough a table is, how large a curve) is estimated too
(MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from scipy import sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.curves import Curve
from pipeline.geometry.mechanism import Linear, Mechanism, Payloads, layout
from pipeline.geometry.scatter import PoseScatter
from pipeline.geometry.yielding import sizes, usual
from pipeline.machine.stance import soften

ROUGH = {False: 1e-3, True: 1e-3}
"""How far a length [m] and an angle [rad] of a table are off as delivered, where its file does not
say: Nubiola and Bonev (Robotics and Computer-Integrated Manufacturing 29, 2013) found 0.1 to 2 mm
and mrad on an industrial robot."""

BEYOND = 5.0
"""A letter so many times rougher than the others, or than stated, is none of them."""

_LOOSE = 1e3
"""Standard deviation of what nothing is known of: frames, tool [m] or [rad], amplitudes [rad]."""

HELD = 1e-12
"""Standard deviation of what is not estimated."""

_WAVE = 3e-4
"""Amplitude of a law before any data [m] or [rad]: an arc minute, as data sheets of reducers state
their transmission error and their lost motion."""


@dataclass(frozen=True, eq=False)
class Prior(Locked):
    """What is known of the parameters before any data.

    Attributes:
        mean: Shape (dense,).
        std: Shape (dense,).
        turns: Which letters are angles, shape (k,).
        free: Letters that are off by far more than the rest of the table, shape (k,).
        most: How rough those of groups are at most, shape (dense,).
        groups: Parameters that are rough alike, if they are there at all: elements and laws.
        stated: Roughness of lengths and of angles that the robot file states; NaN where not.
    """

    mean: Array
    std: Array
    turns: Bools
    free: Bools
    most: Array
    groups: tuple[slice, ...]
    stated: tuple[float, float]

    def roughness(self, turns: bool) -> float:
        """Of lengths [m] or of angles [rad], as found so far."""
        mine = (self.turns == turns) & ~self.free
        return float(self.std[: len(self.turns)][mine][0]) if mine.any() else ROUGH[turns]


def prior(mechanism: Mechanism, stated: tuple[float, float], payloads: Payloads) -> Prior:
    """What is usual, about the nominal table and nominal stiffnesses, and what is stated."""
    where, robot = layout(mechanism), mechanism.table
    mean, std = np.zeros(where.dense), np.full(where.dense, _LOOSE)
    turns = np.array([letter.turns for letter in mechanism.letters], dtype=bool)
    said = [s if np.isfinite(s) else ROUGH[k == 1] for k, s in enumerate(stated)]
    std[where.letters] = np.where(turns, said[1], said[0])
    mean[where.compliance] = robot.nominal_compliance
    std[where.compliance] = robot.nominal_compliance
    std[where.payload] = np.maximum(payloads.std.ravel(), HELD)
    std[where.yields], std[where.laws] = sizes(mechanism.elements), _WAVE
    if mechanism.unknown:
        mean[where.moments], std[where.moments] = (one.ravel() for one in usual(robot))
    free = np.zeros(len(turns), dtype=bool)
    most = std.copy()
    most[where.yields] = np.where(soften(mechanism.elements), std[where.yields], _WAVE)
    return Prior(mean, std, turns, free, most, tuple(_groups(mechanism)), stated)


def _groups(mechanism: Mechanism) -> Iterator[slice]:
    """Where the parameters of each element and of each law stand."""
    where = layout(mechanism)
    for start, counts in (
        (where.yields.start, [len(one.parameters) for one in mechanism.elements]),
        (where.laws.start, [law.amplitudes for law in mechanism.laws]),
    ):
        ends = np.cumsum([start, *counts]).tolist()
        yield from (slice(a, b) for a, b in pairwise(ends))


@dataclass(frozen=True, eq=False)
class ReadRows(Locked):
    """Whitened rows that were read at any pose, and the sums that every solution needs.

    All rows of a pose lie between the same two knots of each of c curves.

    Attributes:
        D: Derivatives by all parameters but the knots, shape (m, r, dense).
        K: Derivatives by the two knots of each curve, shape (m, r, 2 c).
        at: Which knots these are, shape (m, 2 c).
        knots: Number of all knots.
        y: What they are to explain, absolute: residual + X x at the point of linearisation, (m, r).
        W: Whitening of each pose, shape (m, r, r).
    """

    D: Array
    K: Array
    at: Ints
    knots: int
    y: Array
    W: Array

    @cached_property
    def _sparse(self) -> sparse.csr_array:
        m, r, two = self.K.shape
        starts = np.arange(0, m * r * two + 1, two) if two else np.zeros(m * r + 1, dtype=int)
        columns = np.repeat(self.at, r, axis=0).ravel()
        return sparse.csr_array((self.K.ravel(), columns, starts), shape=(m * r, self.knots))

    @cached_property
    def N(self) -> Array:
        """X'X."""
        D, K = self.D.reshape(-1, self.D.shape[2]), self._sparse
        both = K.T @ D
        return np.block([[D.T @ D, both.T], [both, (K.T @ K).toarray()]])

    @cached_property
    def b(self) -> Array:
        """X'y."""
        D, y = self.D.reshape(-1, self.D.shape[2]), self.y.ravel()
        return np.concatenate([D.T @ y, self._sparse.T @ y])

    def of(self, which: Bools) -> ReadRows:
        """The rows of some poses, (m,)."""
        return ReadRows(
            self.D[which],
            self.K[which],
            self.at[which],
            self.knots,
            self.y[which],
            self.W[which],
        )

    def along(self, x: Array) -> Array:
        """X x, shape (m, r)."""
        dense = self.D.shape[2]
        flat = self.D.reshape(-1, dense) @ x[:dense]  # one product, not one for each pose
        out = flat.reshape(self.y.shape)
        return out + np.einsum("mrk,mk->mr", self.K, x[dense:][self.at]) if self.knots else out

    def variance(self, cov: Array) -> Array:
        """X cov X' of each pose, shape (m, r, r)."""
        dense = self.D.shape[2]
        out = self.D @ cov[:dense, :dense] @ np.swapaxes(self.D, 1, 2)
        if self.knots:
            beside = cov[:dense, dense:].T[self.at]  # m, 2c, dense
            mixed = self.K @ beside @ np.swapaxes(self.D, 1, 2)
            own = cov[dense:, dense:][self.at[:, :, None], self.at[:, None, :]]
            out += mixed + np.swapaxes(mixed, 1, 2) + self.K @ own @ np.swapaxes(self.K, 1, 2)
        return np.asarray(out)


def rows(about: Linear, mechanism: Mechanism, scatter: PoseScatter) -> ReadRows:
    """Whitened rows about a mechanism."""
    W, used = scatter.whitening(about), about.used
    K, at = between_knots(mechanism.curves, about.inputs.q, W @ about.Z[:, used])
    knots = sum(curve.count for curve in mechanism.curves)
    y = np.einsum("mij,mj->mi", W, about.y[:, used])
    here = ReadRows(W @ about.D[:, used], K, at, knots, y, W)
    return replace(here, y=here.y + here.along(mechanism.at(layout(mechanism))))


def between_knots(curves: Sequence[Curve], q: Array, Z: Array) -> tuple[Array, Ints]:
    """Derivatives by the two knots of each curve, (m, r, 2 c), and which knots they are, (m, 2 c).

    Args:
        curves: c of them.
        q: Joint values [m] or [rad], shape (m, n).
        Z: Derivatives by joints and bed, shape (m, r, n + 6).
    """
    K = np.empty((*Z.shape[:2], 2 * len(curves)))
    at, before = np.empty((len(q), 2 * len(curves)), dtype=np.int64), 0
    for k, curve in enumerate(curves):
        knot, one, two = curve.between(q[:, curve.joint])
        K[:, :, 2 * k] = Z[:, :, curve.screw] * one[:, None]
        K[:, :, 2 * k + 1] = Z[:, :, curve.screw] * two[:, None]
        at[:, 2 * k], at[:, 2 * k + 1] = before + knot, before + knot + 1
        before += curve.count
    return K, at


@dataclass(frozen=True, eq=False)
class Posterior(Locked):
    """What rows and priors say.

    Attributes:
        x: The parameters.
        cov: Their covariance.
        evidence: Log of the likelihood of the rows, whatever the parameters are.
    """

    x: Array
    cov: Array
    evidence: float


def precision(mechanism: Mechanism, known: Prior) -> tuple[Array, float]:
    """Inverse covariance of the parameters before any data, and the log of its determinant."""
    where = layout(mechanism)
    P = np.zeros((where.size, where.size))
    head = np.arange(where.dense)
    P[head, head] = known.std**-2
    log, at = float(-2 * np.log(known.std).sum()), where.dense
    for curve in mechanism.curves:
        part, own = slice(at, at + curve.count), _inverse(curve)
        P[part, part] = own[0]
        log, at = log + own[1], at + curve.count
    return P, log


def _inverse(curve: Curve) -> tuple[Array, float]:
    """Inverse covariance of a curve's knots, and the log of its determinant."""
    own, log_det = _of_unit_size(curve.first, curve.spacing, curve.count, curve.length)
    return own / curve.size**2, -log_det - 2 * curve.count * float(np.log(curve.size))


@lru_cache(maxsize=64)
def _of_unit_size(first: float, spacing: float, count: int, length: float) -> tuple[Array, float]:
    """Inverse of the shape of such knots, which no size changes, and its log determinant."""
    own = linear.cholesky(Curve(0, first, spacing, count, length, 1.0, 0).shape())
    return own.solve(np.eye(count)), own.log_det


def solve(
    N: Array, b: Array, square: float, prior_of: tuple[Array, float], mean: Array
) -> Posterior:
    """The parameters from products of rows and priors.

    Args:
        N: X'X.
        b: X'y.
        square: y'y, for the evidence.
        prior_of: Inverse covariance before any data, and the log of its determinant.
        mean: Of the parameters before any data.
    """
    P, log = prior_of
    whole, right = factored(N + P), b + P @ mean
    x = whole.solve(right)
    chi2 = square + mean @ P @ mean - x @ right
    return Posterior(x, whole.solve(np.eye(len(b))), float(-0.5 * (chi2 + whole.log_det - log)))


def factored(A: Array) -> linear.Cholesky:
    """The factor of a precision, where rounding spoils it with each parameter known better by that.

    So it is where readings contradict the robot.
    """
    try:
        return linear.cholesky(A)
    except np.linalg.LinAlgError:
        return linear.cholesky(A + np.diag(_ROUNDING * np.diag(A)))


_ROUNDING = 1e-9
"""Part of a precision that sums of thousands of squares of metres in microns may lose."""


def solved(rows: ReadRows, mechanism: Mechanism, known: Prior) -> Posterior:
    """The parameters from all rows; a factor that nobody knows stays where it is."""
    N, b, square = rows.N, rows.b, float(np.sum(rows.y**2))
    if mechanism.unknown:
        x0, v = mechanism.at(layout(mechanism)), softened(mechanism)
        weighed = v[: len(known.std)] / known.std**2
        d = padded(weighed / (weighed @ v[: len(known.std)]) / _DAMPED, len(v))
        N, b, square = N + np.outer(d, d), b + d * (d @ x0), square + float(d @ x0) ** 2
    mean = padded(known.mean, len(b))
    return solve(N, b, square, precision(mechanism, known), mean)


_DAMPED = 0.02
"""How far springs and weights of unknown masses may part by a common factor in one step [1]."""


def softened(mechanism: Mechanism, x: Array | None = None) -> Array:
    """Parameters along which springs are softer by a factor, under masses lighter by it.

    That moves nothing, to first order.
    """
    where = layout(mechanism)
    x = mechanism.at(where) if x is None else x
    v = np.zeros(len(x))
    for part, sign in ((where.compliance, 1.0), (where.yields, 1.0), (where.moments, -1.0)):
        v[part] = sign * x[part]
    v[where.yields] *= soften(mechanism.elements)
    return v


def by_a_factor(rows: ReadRows, mechanism: Mechanism, found: Posterior) -> Posterior:
    """The solution with what springs and weights of unknown masses have in common left open.

    Springs that are softer by a factor under masses that are lighter by it move nothing. Priors of
    many links together would know that factor; nobody does. Along v, which has the compliances and
    minus the moments, the readings say v'X'X v, where payloads are known; the rest is `_FACTOR`.
    """
    about, end = softened(mechanism), softened(mechanism, found.x)
    var = 1 / (float(about @ rows.N @ about) + _FACTOR**-2)
    return replace(found, cov=found.cov + var * np.outer(end, end))


_FACTOR = 1.1
"""Natural log of how much heavier an arm is than usual for its payload, standard deviation: a
factor of three, as between arms of long and of short reach."""


def padded(head: Array, size: int) -> Array:
    """Numbers with zeros behind."""
    out = np.zeros(size)
    out[: len(head)] = head
    return out


def rougher(known: Prior, found: Posterior) -> Prior:
    """The prior with the roughness that the letters show; those far beyond it stand alone."""
    k = len(known.turns)
    x, var = found.x[:k], np.diag(found.cov)[:k]
    std, free = known.std.copy(), known.free.copy()
    for turns in (False, True):
        mine = np.flatnonzero(known.turns == turns)
        if not len(mine):
            continue
        second = x[mine] ** 2 + var[mine]
        middle = np.sqrt(np.median(second) / _MEDIAN)
        limit = BEYOND * max(middle, ROUGH[turns] if np.isnan(known.stated[turns]) else 0.0)
        far = np.sqrt(second) > limit
        rest = second[~far]
        size = np.sqrt(rest.mean()) if len(rest) else middle
        std[mine], free[mine] = np.where(far, np.sqrt(second), max(size, 1e-6)), far
    for one in known.groups:
        scale = _scale(found.x[one], np.diag(found.cov)[one], std[one])
        std[one] = np.minimum(std[one] * scale, known.most[one])
    return replace(known, std=std, free=free)


def _scale(x: Array, var: Array, std: Array) -> float:
    """By how much parameters are rougher than thought (MacKay's fixed point)."""
    if std[0] <= HELD:
        return 1.0
    known = float(np.sum(1 - np.minimum(var / std**2, 1.0)))
    if known < _UNSEEN:
        return 1.0
    return float(np.clip(np.sqrt(np.sum((x / std) ** 2) / known), 0.1, 10.0))


_UNSEEN = 1e-3
"""Parameters that are known so little better than before say nothing of how rough they are."""


_MEDIAN = 0.4549
"""Median of the square of a standard normal number."""


def larger(mechanism: Mechanism, found: Posterior) -> Mechanism:
    """The curves with the size that their knots show (MacKay's fixed point)."""
    at, out = layout(mechanism).dense, []
    for curve in mechanism.curves:
        part = slice(at, at + curve.count)
        own = _inverse(curve)[0]
        x, cov = found.x[part], found.cov[part, part]
        known = curve.count - float(np.einsum("ij,ji->", own, cov))
        share = float(x @ own @ x) / max(known, 1e-3)
        out.append(replace(curve, size=max(curve.size * np.sqrt(share), _SMALLEST)))
        at += curve.count
    return replace(mechanism, curves=tuple(out))


_SMALLEST = 1e-7
"""No curve is smaller [m] or [rad]: there is none."""


def again(rows: ReadRows, about: Linear, found: Posterior, scatter: PoseScatter) -> PoseScatter:
    """The scatter that the residuals show."""
    left = rows.y - rows.along(found.x)
    products = left[:, :, None] * left[:, None, :] + rows.variance(found.cov)
    back = linear.regular_inverse(rows.W)
    return scatter.better(about, back @ products @ np.swapaxes(back, 1, 2))
