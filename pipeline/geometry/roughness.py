"""How rough a robot's table is, and which of its parameters is off by far more than the rest.

    y ~ N(D x, V(t)),   x_k ~ N(0, s_k^2),   s_k = r_L for lengths, r_A for angles

The three scales r_L, r_A and t (the joints' errors at a pose) are integrated over a grid, each
logarithmically uniform: with a dozen poses their likeliest values are far too certain. The grid is
refined where the likelihood changes from node to node. A suspect is
a parameter, or several, that is no part of the rest: its prior is wide. What that does to every
cell of the grid follows from the cell's own covariance C,

    log N(y | free) - log N(y) = 1/2 [ x' S^-1 x - log |E S| - 2 log(w / s) ],  S = E^-1 - C,

E = s^-2 - w^-2 and w the wide prior (matrix determinant lemma), so that all suspects cost one
inverse.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.geometry.unloaded import PoseRows, Unloaded

_SCALES = np.geomspace(1e-2, 10.0, 7)
"""Of lengths [mm] and angles [mrad], and of the joints' errors over what they usually are, before
the grid is refined."""

_HALVINGS = 2
"""From half a decade to a factor of 1.33; a standard deviation found from ten numbers is uncertain
by a factor of 1.25."""

_CHANGES = 0.5
"""Natural log of the density from one node to the next from which on the interval is halved."""

_NEGLIGIBLE = 9.0
"""Natural logs below the largest density at which a node, and its neighbours, are left out."""

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
    """Sums over poses for some sizes of the joints' errors.

    Attributes:
        rows: What they are sums of.
        sizes: Of the joints' errors, over what they usually are, shape (t,).
        A: D' V^-1 D, shape (t, K, K).
        b: D' V^-1 y, shape (t, K).
        square: y' V^-1 y + log det V, shape (t,).
    """

    rows: PoseRows
    sizes: Array
    A: Array
    b: Array
    square: Array

    def with_sizes(self, sizes: Array) -> Products:
        """The sums for other sizes."""
        known = {size: k for k, size in enumerate(self.sizes.tolist())}
        new = [size for size in sizes.tolist() if size not in known]
        if not new:
            at = [known[size] for size in sizes.tolist()]
            return Products(self.rows, sizes, self.A[at], self.b[at], self.square[at])
        more = products(self.rows, np.array(new))
        both = (np.concatenate(pair) for pair in zip(self._sums, more._sums, strict=True))
        every = Products(self.rows, np.append(self.sizes, more.sizes), *both)
        return every.with_sizes(sizes)

    @property
    def _sums(self) -> tuple[Array, Array, Array]:
        return self.A, self.b, self.square


def products(rows: PoseRows, sizes: Array = _SCALES) -> Products:
    """Sums of some rows."""
    each = [_sums(rows, size) for size in sizes.tolist()]
    return Products(rows, sizes, *(np.stack(some) for some in zip(*each, strict=True)))


def _sums(rows: PoseRows, size: float) -> tuple[Array, Array, Array]:
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
        transmission: Size of the joints' errors, over what they usually are, shape (c,).
        width: Natural log of the part of the grid that a cell stands for, shape (c,).
        x: Estimates, shape (c, K).
        cov: Their covariances, shape (c, K, K).
        log: Natural log of the likelihood, whatever the unknowns are, shape (c,).
        unrefined: The same for the whole grid; None where this is it. What has no weight now may
            have all of it with one more suspect free.
    """

    zeros: Unloaded
    free: tuple[Suspect, ...]
    std: Array
    rough: Array
    transmission: Array
    width: Array
    x: Array
    cov: Array
    log: Array
    unrefined: Cells | None = None

    @cached_property
    def weight(self) -> Array:
        """Probability of each cell, shape (c,)."""
        return np.asarray(special.softmax(self.log + self.width))

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

    def evidence(self, one: Suspect) -> float:
        """Natural log of the likelihood with one more free, whatever scales and unknowns are."""
        whole = self.unrefined or self
        return float(special.logsumexp(whole.freed(one) + whole.width))

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
    found = whole = unrefined(zeros, sums, free)
    nodes = _WHOLE
    for _ in range(_HALVINGS):
        nodes = _finer(found, nodes)
        found = _over(zeros, sums, free, nodes)
    return replace(found, unrefined=whole)


def unrefined(zeros: Unloaded, sums: Products, free: Sequence[Suspect] = ()) -> Cells:
    """The same on a coarse grid: enough for what to linearise about, and for what to ask next."""
    return _over(zeros, sums, free, _WHOLE)


_Nodes = tuple[Array, Array, Array]
"""Sizes of the joints' errors, of lengths [mm] and of angles [mrad], ascending."""

_WHOLE: _Nodes = (_SCALES, _SCALES, _SCALES)


def _over(zeros: Unloaded, sums: Products, free: Sequence[Suspect], nodes: _Nodes) -> Cells:
    """Estimates for every cell between nodes."""
    which, L, A = np.meshgrid(np.arange(len(nodes[0])), *nodes[1:], indexing="ij")
    widths = np.meshgrid(*(np.log(_widths(one)) for one in nodes), indexing="ij")
    rough = 1e-3 * np.column_stack([L.ravel(), A.ravel()])
    std = _std(zeros, rough, free)
    width = np.sum(widths, axis=0).ravel()
    return _estimated(zeros, sums.with_sizes(nodes[0]), free, std, rough, which.ravel(), width)


def _widths(nodes: Array) -> Array:
    """Part of the logarithmic axis that each node stands for, by the trapezoidal rule."""
    along = np.log(nodes)
    edges = np.concatenate([along[:1], 0.5 * (along[1:] + along[:-1]), along[-1:]])
    return np.diff(edges)


def _finer(found: Cells, nodes: _Nodes) -> _Nodes:
    """The nodes, without those of no weight, and with new ones where the density changes."""
    weight = found.weight.reshape([len(one) for one in nodes])
    return tuple(
        _halved(one, np.log(np.maximum(weight.sum(axis=rest), 1e-300) / _widths(one)))
        for one, rest in zip(nodes, ((1, 2), (0, 2), (0, 1)), strict=True)
    )  # type: ignore[return-value]


def _halved(nodes: Array, density: Array) -> Array:
    """One axis: `density` is the natural log of that at each node."""
    counts = density > density.max() - _NEGLIGIBLE
    beside = np.pad(counts, 1)
    kept = np.flatnonzero(beside[:-2] | counts | beside[2:])
    nodes, density = nodes[kept], density[kept]
    steep = np.pad(np.abs(np.diff(density)) > _CHANGES, 1)
    halve = steep[:-2] | steep[1:-1] | steep[2:]
    return np.sort(np.concatenate([nodes, np.sqrt(nodes[1:] * nodes[:-1])[halve]]))


def straight(zeros: Unloaded, sums: Products) -> Cells:
    """The table as it is, its joints without errors: only place, stated turn and tool are free."""
    std, whole = zeros.held()[None], np.zeros(1)
    return _estimated(zeros, sums, (), std, np.zeros((1, 2)), np.zeros(1, dtype=np.int64), whole)


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
    which: Ints,
    width: Array,
) -> Cells:
    """Estimates with unknowns in units of their standard deviations, which numbers like better."""
    A, b = sums.A[which], sums.b[which]
    M = np.eye(std.shape[1]) + std[:, :, None] * A * std[:, None, :]
    size = np.sqrt(np.einsum("cii->ci", M))
    scaled = M / (size[:, :, None] * size[:, None, :])
    inverse = linear.regular_inverse(scaled)
    unit = std / size
    cov = unit[:, :, None] * inverse * unit[:, None, :]
    x = np.einsum("cij,cj->ci", cov, b)
    log_det = linear.log_det(scaled) + 2 * np.log(size).sum(axis=1)
    log = -0.5 * (sums.square[which] - np.einsum("ci,ci->c", b, x) + log_det)
    size_of = sums.sizes[which]
    told = np.isfinite(log)  # not where nothing of the table is seen, as of one pose over and over
    x, cov = np.where(told[:, None], x, 0.0), np.where(told[:, None, None], cov, 0.0)
    log = np.where(told, log, -1e300)
    return Cells(zeros, tuple(free), std, rough, size_of, width, x, cov, log)


def left_out(found: Cells, rows: PoseRows) -> Array:
    """What each pose is missed by when the rest predicts it [m], the likeliest scales, (z, 3).

    e_i / (1 - H_i), H_i = X_i C X_i' in whitened rows: the estimate without pose i, exactly.
    """
    cell = found.best
    W = linear.whitening(rows.cov(found.transmission[cell]))
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
