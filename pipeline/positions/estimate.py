"""Regularised least squares for a mechanism: all kinematic and elastic parameters, laws and curves.

    sum over poses |W (y - D x - Z K k)|^2  +  sum ((x - x0) / sigma)^2  +  k' C^-1 k  -> minimum

with W'W = V^-1 of `scatter`, priors x0 +- sigma as stated or usual, and C the covariance of the
curves' knots k. The scales of the priors (roughness of the DH parameters, size of the curves) are
estimated, too (MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.linalg import blas

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.arm_weight import LEAST, usual
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import link_moments
from pipeline.positions.mechanism import Linear, Mechanism, Payloads, balances, layout
from pipeline.positions.positions_estimate import soften
from pipeline.positions.random_curve import Curve, between_knots
from pipeline.positions.scatter import PoseScatter
from pipeline.positions.yielding import sizes

_DELIVERED_STD = {False: 1e-3, True: 1e-3}
"""Standard deviation of lengths [m] and angles [rad] of the DH parameters as delivered, where the
robot file states none: Nubiola and Bonev (Robotics and Computer-Integrated Manufacturing 29, 2013)
found 0.1 to 2 mm and mrad on an industrial robot."""

_LOOSE = 1e3
"""Prior standard deviation of parameters of which nothing is known: frames and tool [m or rad]."""

FIXED_SIGMA = 1e-12
"""Standard deviation of a parameter that is held fixed, in its own unit."""

_WAVE = 1.5e-4
"""Prior standard deviation of a law's amplitude and of half a lost motion [m or rad]: half an arc
minute, as data sheets of reducers state transmission error and lost motion from end to end."""

_BALANCER = 1e-3
"""Prior standard deviation of what a balancer turns the shoulder by [rad]: as the arm's weight, a
nominal spring under its rated torque."""

_RACK = 1e-4
"""Upper limit of the prior scale of a rail's error of length [1], an estimate: 0.1 mm per metre,
as what steel expands by in 8 K; racks are joined every metre or two."""


@dataclass(frozen=True, eq=False)
class Prior(Locked):
    """Prior of the dense parameters, that is of all except the knots of curves.

    Attributes:
        mean: Prior mean, shape (dense,).
        std: Prior standard deviation, shape (dense,).
        turns: Which DH parameters are angles, shape (k,).
        free: DH parameters that are off by far more than the others, shape (k,).
        most: Upper limit of `std` for those of `groups`, shape (dense,).
        groups: Slices of parameters with a common scale, one per elastic element, by its
            label, and one per law.
        stated: Roughness of lengths [m] and of angles [rad] in the robot file; NaN where not
            stated.
        returning: Whether scales of groups that have vanished may grow again.
        signed: Which parameters cannot be negative: compliances of elements, lost motion, (dense,);
            empty for none.
    """

    mean: Array
    std: Array
    turns: Bools
    free: Bools
    most: Array
    groups: Mapping[Hashable, slice]
    stated: tuple[float, float]
    returning: bool = False
    signed: Bools = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def roughness(self, turns: bool) -> float:
        """Present roughness of lengths [m] or of angles [rad]."""
        mine = (self.turns == turns) & ~self.free
        return float(self.std[: len(self.turns)][mine][0]) if mine.any() else _DELIVERED_STD[turns]


def prior(mechanism: Mechanism, stated: tuple[float, float], payloads: Payloads) -> Prior:
    """Prior about the nominal DH parameters and stiffnesses, from usual and stated sizes."""
    where, robot = layout(mechanism), mechanism.table
    mean, std = np.zeros(where.dense), np.full(where.dense, _LOOSE)
    turns = np.array([letter.turns for letter in mechanism.letters], dtype=bool)
    items = [s if np.isfinite(s) else _DELIVERED_STD[k == 1] for k, s in enumerate(stated)]
    std[where.letters] = np.where(turns, items[1], items[0])
    mean[where.compliance] = robot.nominal_compliance
    std[where.compliance] = robot.nominal_compliance
    std[where.payload] = np.maximum(payloads.std.ravel(), FIXED_SIGMA)
    std[where.yields] = sizes(mechanism.elements)
    own = [_BALANCER if balances(robot, law) else _WAVE for law in mechanism.laws]
    std[where.laws] = np.repeat(own, [law.amplitudes for law in mechanism.laws])
    if mechanism.loose:
        weight = usual(robot) if mechanism.unknown else stated_moments(robot)
        mean[where.moments], std[where.moments] = (one.ravel() for one in weight)
    free = np.zeros(len(turns), dtype=bool)
    most = std.copy()
    most[where.yields] = np.where(soften(mechanism.elements), std[where.yields], _WAVE)
    return Prior(
        mean, std, turns, free, most, scale_groups(mechanism), stated, False, _signed(mechanism)
    )


def softer(known: Prior, mechanism: Mechanism) -> Prior:
    """The prior under which bearings, links and rails may turn as much as the gears of the robot.

    What is typical of them is of arms of one class, of one maker. Two stiffnesses of one gear still
    differ by no more than is typical, and play is no more than data sheets state. A rail may be
    longer by a part of its length.
    """
    where, robot = layout(mechanism), mechanism.table
    turns = [
        one.element != "gear" and p.unit.startswith("rad")
        for one in mechanism.elements
        for p in one.parameters
    ]
    softest = robot.nominal_compliance[~robot.prismatic].max(initial=0.0)
    most = known.most.copy()
    own = most[where.yields]
    most[where.yields] = np.where(turns, np.maximum(own, softest), own)
    for law in mechanism.laws:
        if robot.prismatic[law.joint - 1] and (law.kind, law.variable) == ("smooth", "angle"):
            most[known.groups[law]] = max(_WAVE, _RACK * law.scale)
    return replace(known, most=most)


def _signed(mechanism: Mechanism) -> Bools:
    """Dense parameters that the catalogue bounds at zero."""
    where = layout(mechanism)
    out = np.zeros(where.dense, dtype=bool)
    out[where.yields] = [p.lower == 0 for one in mechanism.elements for p in one.parameters]
    return out


def scale_groups(mechanism: Mechanism) -> dict[Hashable, slice]:
    """Slices of the parameters of each elastic element, by its label, and of each law."""
    where, elements, laws = layout(mechanism), mechanism.elements, mechanism.laws
    counts = [len(one.parameters) for one in elements], [law.amplitudes for law in laws]
    ends = np.cumsum([where.yields.start, *counts[0]]), np.cumsum([where.laws.start, *counts[1]])
    slices = (slice(a, b) for one in ends for a, b in pairwise(one.tolist()))
    return dict(zip([*(one.label for one in elements), *laws], slices, strict=True))


@dataclass(frozen=True, eq=False)
class ReadRows(Locked):
    """Whitened rows of all poses, and the products that every solution needs.

    All rows of a pose lie between the same two knots of each of c curves.

    Attributes:
        D: Derivatives by all parameters except the knots, shape (m, r, dense).
        K: Derivatives by the two knots of each curve, shape (m, r, 2 c).
        at: Indices of these knots, shape (m, 2 c).
        knots: Total number of knots.
        y: Left-hand side in absolute parameters: residual + X x at the linearisation point, (m, r).
        W: Whitening matrix of each pose, shape (m, r, r).
        L: Its inverse, shape (m, r, r).
    """

    D: Array
    K: Array
    at: Ints
    knots: int
    y: Array
    W: Array
    L: Array

    @cached_property
    def _sparse(self) -> sparse.csr_array:
        return self.by_knots(self.K)

    def by_knots(self, K: Array) -> sparse.csr_array:
        """Rows (m, r, 2 c), by the two knots of each curve, as rows by all knots, (m r, knots)."""
        m, r, two = K.shape
        starts = np.arange(0, m * r * two + 1, two) if two else np.zeros(m * r + 1, dtype=int)
        columns = np.repeat(self.at, r, axis=0).ravel()
        return sparse.csr_array((K.ravel(), columns, starts), shape=(m * r, self.knots))

    @cached_property
    def N(self) -> Array:
        """X'X with X = [D, K], shape (size, size)."""
        D, k = self.D.reshape(-1, self.D.shape[2]), self.knots
        both, own = self._sparse.T @ D, np.swapaxes(self.K, 1, 2) @ self.K
        pairs = self.at[:, :, None] * k + self.at[:, None, :]
        KK = np.bincount(pairs.ravel(), own.ravel(), k**2).reshape(k, k)
        return np.block([[D.T @ D, both.T], [both, KK]])

    @cached_property
    def b(self) -> Array:
        """X'y, shape (size,)."""
        D, y = self.D.reshape(-1, self.D.shape[2]), self.y.ravel()
        return np.concatenate([D.T @ y, self._sparse.T @ y])

    def products(self, F: Array) -> Array:
        """X'F of columns F (m, r, f), shape (size, f)."""
        dense, flat = self.D.shape[2], F.reshape(-1, F.shape[2])
        head = self.D.reshape(-1, dense).T @ flat
        return np.concatenate([head, self._sparse.T @ flat])

    def of(self, which: Bools | Ints) -> ReadRows:
        """The rows of some poses."""
        D, K, y, W, L = (v[which] for v in (self.D, self.K, self.y, self.W, self.L))
        return ReadRows(D, K, self.at[which], self.knots, y, W, L)

    def along(self, x: Array) -> Array:
        """X x, shape (m, r)."""
        dense = self.D.shape[2]
        flat = self.D.reshape(-1, dense) @ x[:dense]  # one product, not one for each pose
        out = flat.reshape(self.y.shape)
        return out + np.einsum("mrk,mk->mr", self.K, x[dense:][self.at]) if self.knots else out

    def variance(self, found: Posterior) -> Array:
        """X cov X' of each pose, shape (m, r, r), cov = R R' + C_k of the estimate."""
        half = self.by_root(found.root)
        out = half.copy() @ np.swapaxes(half, 1, 2)  # of one array, numpy takes a slower way
        if self.knots:
            own = found.knots[self.at[:, :, None], self.at[:, None, :]]
            out += self.K @ own @ np.swapaxes(self.K, 1, 2)
        return np.asarray(out)

    def by_root(self, root: Array, first: int = 0) -> Array:
        """X R of each pose, (m, r, k).

        Args:
            root: R, shape (size, k), zero below the diagonal of the dense parameters.
            first: Column before which it is zero in all knots.
        """
        dense = self.D.shape[2]
        half = by_upper(self.D.reshape(-1, dense), root[:dense])
        if self.knots:
            half[:, first:] += self._sparse @ root[dense:, first:]
        return half.reshape(*self.y.shape, -1)


def by_upper(X: Array, R: Array) -> Array:
    """X R of rows X (M, k) by upper triangular R (k, k) and any more columns, (k, j)."""
    k = len(R)
    out = np.asarray(blas.dtrmm(1.0, R[:, :k].T, X.T, lower=1).T)
    return out if R.shape[1] == k else np.column_stack([out, X @ R[:, k:]])


def rows(about: Linear, mechanism: Mechanism, scatter: PoseScatter) -> ReadRows:
    """Whitened rows linearised about a mechanism."""
    L, W = scatter.factors(about)
    y, D, Z, _ = about.seen
    K, at = between_knots(mechanism.curves, about.inputs.q, W @ Z)
    knots = sum(curve.count for curve in mechanism.curves)
    here = ReadRows(W @ D, K, at, knots, np.einsum("mij,mj->mi", W, y), W, L)
    return replace(here, y=here.y + here.along(mechanism.at(layout(mechanism))))


@dataclass(frozen=True, eq=False)
class Posterior(Locked):
    """Estimate from rows and priors.

    Attributes:
        x: The parameters.
        root: R with R R' their covariance, except for C_k, shape (size, at least dense): its first
            columns, as many as there are dense parameters, are zero below the diagonal of these.
        of_knots: C_k, covariance of the knots if all other parameters were known, (knots, knots),
            or the factor of its inverse.
        evidence: Logarithm of the marginal likelihood of the whitened rows.
    """

    x: Array
    root: Array
    of_knots: Array | linear.Cholesky
    evidence: float

    @cached_property
    def knots(self) -> Array:
        """C_k, which not every solution is asked for."""
        known = self.of_knots
        return known.inverse if isinstance(known, linear.Cholesky) else known

    @cached_property
    def cov(self) -> Array:
        """Covariance of the parameters."""
        return self.of(slice(None))

    @cached_property
    def dense_var(self) -> Array:
        """Variance of each parameter but the knots."""
        known = self.of_knots
        knots = len(known.scale if isinstance(known, linear.Cholesky) else known)
        return np.asarray(np.sum(self.root[: len(self.x) - knots] ** 2, axis=1))

    @cached_property
    def var(self) -> Array:
        """Variance of each parameter."""
        var = np.sum(self.root**2, axis=1)
        var[len(var) - len(self.knots) :] += np.diag(self.knots)
        return np.asarray(var)

    def times(self, g: Array) -> Array:
        """Covariance of the parameters times a vector (size,)."""
        out, k = self.root @ (self.root.T @ g), len(self.knots)
        out[len(g) - k :] += self.knots @ g[len(g) - k :]
        return np.asarray(out)

    def of(self, part: slice) -> Array:
        """Covariance of the parameters in a slice."""
        first, end, _ = part.indices(len(self.x))
        cov, dense = self.root[part] @ self.root[part].T, len(self.x) - len(self.knots)
        one, knots = max(dense - first, 0), slice(max(first - dense, 0), max(end - dense, 0))
        cov[one:, one:] += self.knots[knots, knots]
        return np.asarray(cov)


def precision(mechanism: Mechanism, known: Prior) -> tuple[Array, float]:
    """Prior precision of all parameters including the knots, and the log of its determinant."""
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
    """Prior precision of a curve's knots, and the log of its determinant."""
    shape = curve.first, curve.spacing, curve.count, curve.length, curve.screw != curve.joint
    own, log_det = _of_unit_size(*shape)
    return own / curve.size**2, -log_det - 2 * curve.count * float(np.log(curve.size))


@lru_cache(maxsize=64)
def _of_unit_size(
    first: float, spacing: float, count: int, length: float, bed: bool
) -> tuple[Array, float]:
    """Inverse correlation of the knots, and the log determinant of the correlation itself."""
    own = linear.cholesky(Curve(0, first, spacing, count, length, 1.0, int(bed)).shape())
    return own.solve(np.eye(count)), own.log_det


def _solve(
    N: Array, b: Array, square: float, prior_of: tuple[Array, float], mean: Array, knots: int
) -> Posterior:
    """Posterior from the products of rows and priors, the knots eliminated first.

    Args:
        N: X'X.
        b: X'y.
        square: y'y, for the evidence.
        prior_of: Prior precision, and the log of its determinant.
        mean: Prior mean.
        knots: Number of knots, the last of the parameters.
    """
    P, log = prior_of
    A, right, dense = N + P, b + P @ mean, len(b) - knots
    C: Array | linear.Cholesky
    if not knots:
        rest = factored(A)
        root = rest.root
        x, C = root @ (root.T @ right), np.zeros((0, 0))
    else:
        C = factored(A[dense:, dense:])
        B = C.solve(A[dense:, :dense])
        rest = factored(A[:dense, :dense] - A[:dense, dense:] @ B)
        root = np.concatenate([rest.root, -B @ rest.root])
        x = root @ (root.T @ right)
        x[dense:] += C.solve(right[dense:])
        log -= C.log_det
    chi2 = square + mean @ P @ mean - x @ right
    return Posterior(x, root, C, float(-0.5 * (chi2 + rest.log_det - log)))


def factored(A: Array) -> linear.Cholesky:
    """Cholesky factor of a precision; where rounding makes it indefinite, with a larger diagonal.

    This happens where readings contradict the robot.
    """
    try:
        return linear.cholesky(A)
    except np.linalg.LinAlgError:
        return linear.cholesky(A + np.diag(_ROUNDING * np.diag(A)))


_ROUNDING = 1e-9
"""Relative increase of the diagonal [1]: what rounding may lose in sums of thousands of squares of
metres in units of microns."""


def solved(rows: ReadRows, mechanism: Mechanism, known: Prior) -> Posterior:
    """Posterior from all rows; with unknown masses, their unknown common factor is damped."""
    N, b, square = rows.N, rows.b, float(np.sum(rows.y**2))
    if mechanism.unknown:
        x0, d = mechanism.at(layout(mechanism)), damping(mechanism, known)
        N, b, square = N + np.outer(d, d), b + d * (d @ x0), square + float(d @ x0) ** 2
    mean = padded(known.mean, len(b))
    return _solve(N, b, square, precision(mechanism, known), mean, rows.knots)


def held_step(
    rows: ReadRows, mechanism: Mechanism, known: Prior, slope: Array, held: float
) -> Array:
    """Step of a damped iteration: solution u of (N + P + held E) u = slope, (size,).

    E is the prior precision of what enters in products: compliances, elastic elements, moments.
    """
    P, where = precision(mechanism, known)[0], layout(mechanism)
    for part in (where.compliance, where.yields, where.moments):
        at = np.arange(part.start, part.stop)
        P[at, at] *= 1 + held
    if mechanism.unknown:
        d = damping(mechanism, known)
        P += np.outer(d, d)
    return factored(rows.N + P).solve(slope)


def damping(mechanism: Mechanism, known: Prior) -> Array:
    """Row d of the observation d u = 0 that holds the common factor in a change u, (size,)."""
    v = softened(mechanism)
    weighed = v[: len(known.std)] / known.std**2
    return padded(weighed / (weighed @ v[: len(known.std)]) / _DAMPED, len(v))


_DAMPED = 0.02
"""Standard deviation of the change of the common factor of stiffnesses and unknown masses in one
iteration [1]."""


def softened(mechanism: Mechanism) -> Array:
    """Direction in which all compliances grow by a factor and all masses fall by it.

    To first order this moves nothing, so the readings without known payloads do not determine it.
    """
    where = layout(mechanism)
    x = mechanism.at(where)
    v = np.zeros(len(x))
    for part, sign in ((where.compliance, 1.0), (where.yields, 1.0), (where.moments, -1.0)):
        v[part] = sign * x[part]
    v[where.yields] *= soften(mechanism.elements)
    return v


def by_a_factor(rows: ReadRows, mechanism: Mechanism, found: Posterior, hung: bool) -> Posterior:
    """Posterior including the uncertainty of the common factor of stiffnesses and unknown masses.

    Softer springs under masses lighter by the same factor move nothing. The priors of many links
    together would determine that factor, and so would the torque at which a gear's play is assumed
    to close, but nobody knows it. Along v, which holds the compliances and minus the moments, the
    readings give the information v'X'X v where known payloads are `hung`; otherwise its standard
    deviation is `_FACTOR`, and v - C X'X v takes its place: a torque that does not fall with the
    masses, as at a bound, would else move targets that all other parameters can put back, C being
    the posterior covariance. The rows must be linearised where v is taken: elsewhere v moves
    targets, by a factor of three.
    """
    v = softened(mechanism)
    var = 1 / (hung * float(v @ rows.N @ v) + _FACTOR**-2)
    if not hung:
        v = v - found.times(rows.N @ v)
    return replace(found, root=np.column_stack([found.root, np.sqrt(var) * v]))


_FACTOR = 1.1
"""Standard deviation of the natural logarithm of an arm's mass over the usual one for its
payload [1]: a factor of three, as between arms of long and of short reach."""


def determined_joints(mechanism: Mechanism, known: Prior, x: Array, var: Array) -> Bools:
    """Joints of whose compliance the readings take away half of the prior variance, (n,).

    Where nobody states the masses they bound a product of compliance and moment: it may vanish
    because there is no moment, and a compliance must also be more than zero by its uncertainty.

    Args:
        mechanism: The mechanism.
        known: Its priors.
        x: Compliances, shape (n,).
        var: Their variances, shape (n,).
    """
    seen = var < _HALF * known.std[layout(mechanism).compliance] ** 2
    return np.asarray(seen & (x > _ABOVE * np.sqrt(var))) if mechanism.unknown else seen


_HALF = 0.5
"""Ratio of posterior to prior variance below which a compliance counts as determined by the
weight [1]."""

_ABOVE = 2.0
"""Least compliance that is told from none, over its standard uncertainty [1]."""


def padded(head: Array, size: int) -> Array:
    """The vector `head` extended by zeros to `size`."""
    out = np.zeros(size)
    out[: len(head)] = head
    return out


def rougher(known: Prior, found: Posterior) -> Prior:
    """Prior with the roughness of the estimated DH parameters; free ones get their own."""
    k = len(known.turns)
    second = found.x[:k] ** 2 + found.dense_var[:k]
    std = known.std.copy()
    std[:k][known.free] = np.sqrt(second[known.free])
    for turns in (False, True):
        rest = np.flatnonzero((known.turns == turns) & ~known.free)
        if len(rest):
            std[rest] = max(float(np.sqrt(second[rest].mean())), 1e-6)
    for one in known.groups.values():
        scale = _scale(found.x[one], found.dense_var[one], std[one], known.returning)
        if scale != 1 and _impossible(found.x[one], known.signed[one]):
            scale = _LEAST
        std[one] = np.minimum(std[one] * scale, known.most[one])
    return replace(known, std=std)


def _impossible(x: Array, signed: Bools) -> bool:
    """Whether all that cannot be negative is."""
    return bool(signed.any()) and bool((x[signed] < 0).all())


def _scale(x: Array, var: Array, std: Array, returning: bool) -> float:
    """Factor by which the parameters exceed their prior scale (MacKay's fixed point), 0.1 to 10."""
    known = float(np.sum(1 - np.minimum(var / std**2, 1.0)))
    if std[0] <= FIXED_SIGMA or known < (_UNSEEN**2 if returning else _UNSEEN):
        return 1.0
    least = _LEAST if known > _UNSEEN else 1.0
    return float(np.clip(np.sqrt(np.sum((x / std) ** 2) / known), least, 1 / _LEAST))


_LEAST = 0.1
"""Least factor of a scale in one update [1], which is also that of what comes out negative and
cannot be: play that takes back what the weight does stands for something else."""

_UNSEEN = 1e-3
"""Minimum effective number of determined parameters [1]; below it their scale does not shrink, and
below its square, which rounding reaches, it stays as it is."""


def of_scales(known: Prior, found: Posterior) -> Array:
    """Contribution of the estimated scales of groups to the covariance of the estimate, (k, k).

    The posterior takes the scale s of each group g of elements or laws as known. The estimate
    changes with it by

        dx / d log s = 2 C E_g P_g (x_g - m_g),    var log s = 1 / (2 tr (1 - P_g C_gg)^2 + w^-2),

    with C the posterior covariance, P_g the prior precision, and w = `_SCALES` (Kass and Steffey,
    Journal of the American Statistical Association 84, 1989).
    """
    C, spread = found.cov, np.zeros_like(found.cov)
    for one in known.groups.values():
        P, off = known.std[one] ** -2, found.x[one] - known.mean[one]
        seen = np.eye(len(P)) - P[:, None] * C[one, one]
        moved = 2 * C[:, one] @ (P * off)
        spread += np.outer(moved, moved) / (2 * np.sum(seen * seen.T) + _SCALES**-2)
    return spread


_SCALES = 1.4
"""Standard deviation of the natural logarithm of the size of an element or a law over the usual one
[1], a factor of four: an estimate, which counts only where the readings hardly tell the size."""


def larger(mechanism: Mechanism, found: Posterior) -> Mechanism:
    """The mechanism with each curve's size estimated from its knots (MacKay's fixed point)."""
    at, out = layout(mechanism).dense, []
    for curve in mechanism.curves:
        part = slice(at, at + curve.count)
        own = _inverse(curve)[0]
        x, cov = found.x[part], found.of(part)
        known = curve.count - float(np.einsum("ij,ji->", own, cov))
        share = float(x @ own @ x) / max(known, 1e-3)
        out.append(replace(curve, size=max(curve.size * np.sqrt(share), _SMALLEST)))
        at += curve.count
    return replace(mechanism, curves=tuple(out))


_SMALLEST = 1e-7
"""Lower limit of a curve's size [m or rad], which amounts to no curve."""


def unwhitened(rows: ReadRows, left: Array, held: Array) -> Array:
    """Products of the errors, L (e e' + H) L', from residuals e (m, r) and what is absorbed, H."""
    products = left[:, :, None] * left[:, None, :] + held
    return np.asarray(rows.L @ products @ np.swapaxes(rows.L, 1, 2))


def promised(
    found: Posterior, before: tuple[Mechanism, Prior], after: tuple[Mechanism, Prior]
) -> float:
    """Gain of the log evidence that new scales of priors promise.

    sum over parameters s (r - 1 - log r) / 2, r the ratio of the new prior variance to the earlier
    one and s the part of this which the readings take away: that of a variance from s values.
    """
    one, two = (
        np.concatenate([known.std, *[np.full(c.count, c.size) for c in mechanism.curves]])
        for mechanism, known in (before, after)
    )
    seen = np.clip(1 - found.var / one**2, 0.0, 1.0)
    r = (two / one) ** 2
    return 0.5 * float(seen @ (r - 1 - np.log(r)))


def stated_moments(robot: Robot) -> tuple[Array, Array]:
    """Masses [kg] and first moments [kg m] of links by the robot file, with their uncertainties.

    m ~ N(m_0, (u m_0)^2), each coordinate of the first moment ~ N(f_0, (u |f_0|)^2), u = `_STATED`.

    Returns:
        Mean and standard deviation, each of shape (n, 4), the moments in the links' frames.
    """
    mean = link_moments(robot)
    size = np.linalg.norm(mean[:, 1:], axis=1)
    std = _STATED * np.column_stack([mean[:, 0], *[size] * 3])
    return mean, np.maximum(std, LEAST)


_STATED = 0.05
"""Relative standard uncertainty of the mass and first moment of a link in its robot file [1], an
estimate: drawings contain castings, whose own mass is within 5 to 20 % by grade (GB/T 11351),
but no cables, grease, hoses and dress packs."""
