"""Roughness of a robot's DH table, and which parameters are off by far more than the rest.

    y ~ N(D x, V(t)),   x_k ~ N(0, s_k^2),   s_k = r_L for lengths, r_A for angles

The three scales r_L, r_A and t (the joints' errors at a pose) are integrated over a grid with
logarithmically uniform priors: with a dozen poses, point estimates would be far too certain. The
grid is refined where the density changes from node to node. A suspect is one parameter, or several
of one size, log-uniform over three decades: with one wide prior for each of its unknowns, six would
lose to any single one that explains nearly as much. Its effect on each cell of the grid follows
from the cell's own covariance C,

    log N(y | w) - log N(y | s) = 1/2 [ x' B^-1 E x - log |B| - 2 log(w / s) ],  B = 1 - E C,

with E = s^-2 - w^-2, s the prior standard deviation and w another one (matrix determinant lemma),
so that all suspects cost one inverse.
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
"""Nodes of the unrefined grid, for lengths [mm], angles [mrad], and the joints' errors over their
usual size [1]."""

_HALVINGS = 2
"""Number of grid refinements, from half a decade to a factor of 1.33; a standard deviation
estimated from ten numbers is uncertain by a factor of 1.25."""

_CHANGES = 0.5
"""Change of the log density between two nodes above which the interval is halved [1]."""

_NEGLIGIBLE = 9.0
"""Difference of the log density from its maximum beyond which a node, and its neighbours, are
dropped [1]."""

_SIZES = np.geomspace(1e-3, 1.0, 7)
"""Sizes of a suspect over its largest, equally likely [1]."""

_COUNTS = 1e-3
"""Minimum weight of a grid cell in the covariance [1]."""


@dataclass(frozen=True)
class SuspectUnknowns:
    """Unknowns that may be off by far more than the roughness of the table.

    Attributes:
        label: Name and place.
        columns: Indices of the unknowns.
        wide: Largest prior standard deviation if they are off, in their unit.
        tries: Number of alternatives, equally likely a priori, of which it is the likeliest.
    """

    label: str
    columns: tuple[int, ...]
    wide: float
    tries: int = 1


@dataclass(frozen=True, eq=False)
class _PoseProducts(Locked):
    """Sums over poses for several sizes of the joints' errors.

    Attributes:
        rows: Rows of the sums.
        sizes: Joints' errors over their usual size, shape (t,).
        A: D' V^-1 D, shape (t, K, K).
        b: D' V^-1 y, shape (t, K).
        square: y' V^-1 y + log det V, shape (t,).
    """

    rows: PoseRows
    sizes: Array
    A: Array
    b: Array
    square: Array

    def with_sizes(self, sizes: Array) -> _PoseProducts:
        """The sums for other sizes; known ones are reused."""
        known = {size: k for k, size in enumerate(self.sizes.tolist())}
        new = [size for size in sizes.tolist() if size not in known]
        if not new:
            at = [known[size] for size in sizes.tolist()]
            return _PoseProducts(self.rows, sizes, self.A[at], self.b[at], self.square[at])
        more = products(self.rows, np.array(new))
        both = (np.concatenate(pair) for pair in zip(self._sums, more._sums, strict=True))
        every = _PoseProducts(self.rows, np.append(self.sizes, more.sizes), *both)
        return every.with_sizes(sizes)

    @property
    def _sums(self) -> tuple[Array, Array, Array]:
        return self.A, self.b, self.square


def products(rows: PoseRows, sizes: Array = _SCALES) -> _PoseProducts:
    """The sums of some rows."""
    each = [_sums(rows, size) for size in sizes.tolist()]
    return _PoseProducts(rows, sizes, *(np.stack(some) for some in zip(*each, strict=True)))


def _sums(rows: PoseRows, size: float) -> tuple[Array, Array, Array]:
    W = linear.whitening(rows.cov(size))
    D = (W @ rows.D).reshape(-1, rows.D.shape[2])
    y = np.einsum("pij,pj->pi", W, rows.y).ravel()
    return D.T @ D, D.T @ y, np.asarray(y @ y - 2 * np.log(np.einsum("pii->pi", W)).sum())


@dataclass(frozen=True, eq=False, kw_only=True)
class RoughnessGrid(Locked):
    """Estimates for every cell of a grid of roughnesses of a table.

    Attributes:
        free: Suspects with a wide prior.
        std: Prior standard deviations, shape (c, K).
        rough: Roughness of lengths [m] and angles [rad], shape (c, 2).
        width: Logarithm of the cell's share of the grid, shape (c,).
        x: Estimates, shape (c, K).
        cov: Their covariances, shape (c, K, K).
        log: Logarithm of the marginal likelihood of the cell, shape (c,).
        unrefined: The estimates on the unrefined grid; None if this is it. Cells of no weight now
            may have all of it with one more suspect free.
    """

    free: tuple[SuspectUnknowns, ...]
    std: Array
    rough: Array
    width: Array
    x: Array
    cov: Array
    log: Array
    unrefined: RoughnessGrid | None = None

    @cached_property
    def weight(self) -> Array:
        """Posterior probability of each cell, shape (c,)."""
        return np.asarray(special.softmax(self.log + self.width))

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood over the grid, over all sizes of the suspects that are free."""
        whole = self.unrefined or self
        at_most = special.logsumexp(whole.log + whole.width)
        sized = (self.evidence(one) - at_most for one in self.free)
        return float(special.logsumexp(self.log + self.width) + sum(sized))

    @property
    def best(self) -> int:
        """Index of the likeliest cell."""
        return int(np.argmax(self.log))

    @cached_property
    def mean(self) -> Array:
        """Estimates, averaged over the cells, shape (K,)."""
        return np.asarray(self.weight @ self.x)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the averaged estimates, including their spread over cells, shape (K, K)."""
        kept = self.weight > _COUNTS
        apart = self.x[kept] - self.mean
        w = self.weight[kept] / self.weight[kept].sum()
        within = np.einsum("c,cij->ij", w, self.cov[kept])
        return np.asarray(within + np.einsum("c,ci,cj->ij", w, apart, apart))

    @cached_property
    def roughness(self) -> Array:
        """Rms roughness of lengths [m] and angles [rad], shape (2,)."""
        return np.asarray(np.sqrt(self.weight @ self.rough**2))

    def p_exact(self) -> float:
        """Probability by chance of such roughness in a robot that exactly matches its table.

        Likelihood ratio of two scales against their smallest values, chi-square with two degrees of
        freedom; conservative, since both lie at an end of their range.
        """
        smooth = np.all(self.rough <= self.rough.min(axis=0), axis=1)
        return float(special.chdtrc(2, 2 * (self.log.max() - self.log[smooth].max())))

    def evidence(self, one: SuspectUnknowns) -> float:
        """Log marginal likelihood over the whole grid with a suspect of any size free."""
        whole = self.unrefined or self
        rest = 0.0 if one in self.free else whole.std[:, list(one.columns)]
        sizes = (whole.with_std(one, np.hypot(rest, size * one.wide)) for size in _SIZES)
        each = [special.logsumexp(log + whole.width) for log in sizes]
        return float(special.logsumexp(each) - np.log(len(_SIZES) * one.tries))

    def with_std(self, one: SuspectUnknowns, std: Array) -> Array:
        """Log likelihood of each cell with other prior standard deviations, shape (c,).

        With M the normal matrix of prior precision, E is what the precision loses: log |M'| = log
        |M| + log |1 - E C| and b' M'^-1 b = b' x + x_k' (1 - E C)^-1 E x_k.

        Args:
            one: A suspect.
            std: Of its unknowns, shape (c, columns) or a number.
        """
        at = list(one.columns)
        x, C, was = self.x[:, at], self.cov[:, at][:, :, at], self.std[:, at]
        less = was**-2 - std**-2
        B = np.eye(len(at)) - less[:, :, None] * C
        gain = np.einsum("ck,ck->c", x, linear.solve(B, less * x))
        wider = 2 * np.log(std / was).sum(axis=1)
        return np.asarray(self.log + 0.5 * (gain - linear.log_det(B) - wider))

    def p_value(self, one: SuspectUnknowns, beside: Array) -> float:
        """Probability of such large values if the unknowns had the roughness of the rest.

        x' (C + r^2)^-1 x is chi-square in each cell, with the roughness r estimated without them.

        Args:
            one: A suspect that is free.
            beside: Roughness r of its unknowns according to the rest, shape (c, columns).
        """
        at = list(one.columns)
        x, C = self.x[:, at], self.cov[:, at][:, :, at]
        whole = C + np.einsum("ck,kl->ckl", beside**2, np.eye(len(at)))
        far = np.einsum("ck,ck->c", x, linear.solve(whole, x))
        return float(self.weight @ special.chdtrc(len(at), far))


@dataclass(frozen=True, eq=False, kw_only=True)
class ScaleGrid(RoughnessGrid):
    """Estimates for every cell of the grid of scales, with the joints' errors as the third.

    Attributes:
        zeros: The readings.
        transmission: Joints' errors over their usual size, shape (c,).
    """

    zeros: Unloaded
    transmission: Array
    unrefined: ScaleGrid | None = None

    @property
    def per_letter(self) -> Array:
        """Roughness of each geometric parameter, shape (k,)."""
        return np.where(self.zeros.turns, self.roughness[1], self.roughness[0])


def cells(zeros: Unloaded, sums: _PoseProducts, free: Sequence[SuspectUnknowns] = ()) -> ScaleGrid:
    """Estimates for every cell of the refined grid.

    Args:
        zeros: The readings.
        sums: Their products.
        free: Suspects with a wide prior.
    """
    found = whole = unrefined(zeros, sums, free)
    nodes = _WHOLE
    for _ in range(_HALVINGS):
        nodes = _finer(found, nodes)
        found = _over(zeros, sums, free, nodes)
    return replace(found, unrefined=whole)


def unrefined(
    zeros: Unloaded, sums: _PoseProducts, free: Sequence[SuspectUnknowns] = ()
) -> ScaleGrid:
    """As `cells` on a coarse grid, enough for a linearisation point and for choosing suspects."""
    return _over(zeros, sums, free, _WHOLE)


_Nodes = tuple[Array, Array, Array]
"""Joints' errors over their usual size [1], lengths [mm] and angles [mrad], ascending."""

_WHOLE: _Nodes = (_SCALES, _SCALES, _SCALES)


def _over(
    zeros: Unloaded, sums: _PoseProducts, free: Sequence[SuspectUnknowns], nodes: _Nodes
) -> ScaleGrid:
    """Estimates for every cell of a grid of nodes."""
    which, L, A = np.meshgrid(np.arange(len(nodes[0])), *nodes[1:], indexing="ij")
    widths = np.meshgrid(*(np.log(_widths(one)) for one in nodes), indexing="ij")
    rough = 1e-3 * np.column_stack([L.ravel(), A.ravel()])
    std = _std(zeros, rough, free)
    width = np.sum(widths, axis=0).ravel()
    return _estimated(zeros, sums.with_sizes(nodes[0]), free, std, rough, which.ravel(), width)


def _widths(nodes: Array) -> Array:
    """Width of each node on the logarithmic axis, by the trapezoidal rule."""
    along = np.log(nodes)
    return np.diff(np.concatenate([along[:1], 0.5 * (along[1:] + along[:-1]), along[-1:]]))


def _finer(found: ScaleGrid, nodes: _Nodes) -> _Nodes:
    """The nodes without those of no weight, and with new ones where the density changes."""
    weight = found.weight.reshape([len(one) for one in nodes])
    return tuple(
        _halved(one, np.log(np.maximum(weight.sum(axis=rest), 1e-300) / _widths(one)))
        for one, rest in zip(nodes, ((1, 2), (0, 2), (0, 1)), strict=True)
    )  # type: ignore[return-value]


def _halved(nodes: Array, density: Array) -> Array:
    """One refined axis; `density` is the log density at each node."""
    counts = density > density.max() - _NEGLIGIBLE
    beside = np.pad(counts, 1)
    kept = np.flatnonzero(beside[:-2] | counts | beside[2:])
    nodes, density = nodes[kept], density[kept]
    steep = np.pad(np.abs(np.diff(density)) > _CHANGES, 1)
    halve = steep[:-2] | steep[1:-1] | steep[2:]
    return np.sort(np.concatenate([nodes, np.sqrt(nodes[1:] * nodes[:-1])[halve]]))


def straight(zeros: Unloaded, sums: _PoseProducts) -> ScaleGrid:
    """Estimate with nominal table and no joint errors: only position, stated rotation and tool."""
    std, whole = zeros.held()[None], np.zeros(1)
    return _estimated(zeros, sums, (), std, np.zeros((1, 2)), np.zeros(1, dtype=np.int64), whole)


def _std(zeros: Unloaded, rough: Array, free: Iterable[SuspectUnknowns]) -> Array:
    std = np.tile(zeros.held(), (len(rough), 1))
    std[:, zeros.columns.table] = np.hypot(rough[:, zeros.turns.astype(int)], zeros.stated)
    std[:, zeros.columns.loose] = rough[:, 1:]  # the rail's direction in F_b is an angle, too
    for one in free:
        std[:, list(one.columns)] = one.wide
    return std


def _estimated(
    zeros: Unloaded,
    sums: _PoseProducts,
    free: Sequence[SuspectUnknowns],
    std: Array,
    rough: Array,
    which: Ints,
    width: Array,
) -> ScaleGrid:
    x, cov, log = of_cells(sums.A[which], sums.b[which], sums.square[which], std)
    return ScaleGrid(
        zeros=zeros,
        free=tuple(free),
        std=std,
        rough=rough,
        transmission=sums.sizes[which],
        width=width,
        x=x,
        cov=cov,
        log=log,
    )


def of_cells(M: Array, b: Array, square: Array, std: Array) -> tuple[Array, Array, Array]:
    """Estimates (c, K), their covariances (c, K, K) and log marginal likelihoods (c,) of cells.

    In units of the prior standard deviations, for numerical stability.

    Args:
        M: D' V^-1 D of each cell, which this overwrites, shape (c, K, K).
        b: D' V^-1 y, shape (c, K).
        square: y' V^-1 y + log det V, shape (c,).
        std: Prior standard deviations, shape (c, K).
    """
    diagonal = np.einsum("cii->ci", M)
    size = np.sqrt(1.0 + diagonal * std**2)
    unit = std / size
    M *= unit[:, :, None]
    M *= unit[:, None, :]
    diagonal += size**-2
    cov, log_det = linear.definite_inverse(M)
    cov *= unit[:, :, None]
    cov *= unit[:, None, :]
    x = np.einsum("cij,cj->ci", cov, b)
    log_det += 2 * np.log(size).sum(axis=1)
    log = -0.5 * (square - np.einsum("ci,ci->c", b, x) + log_det)
    dark = ~np.isfinite(log)  # where the table is unobservable, as from one pose repeated
    x[dark], cov[dark], log[dark] = 0.0, 0.0, -1e300
    return x, cov, log


def left_out(found: ScaleGrid, rows: PoseRows) -> Array:
    """Leave-one-out prediction errors of each pose at the likeliest scales [m], (z, 3).

    e_i / (1 - H_i), H_i = X_i C X_i' in whitened rows: exactly the estimate without pose i.
    """
    cell = found.best
    W = linear.whitening(rows.cov(found.transmission[cell]))
    X = W @ rows.D
    e = np.einsum("pij,pj->pi", W, rows.y) - X @ found.x[cell]
    rest = np.eye(X.shape[1]) - X @ found.cov[cell] @ np.swapaxes(X, 1, 2)
    return np.asarray(linear.solve(W, linear.solve(rest, e))[rows.place])


def same(
    zeros: Unloaded, sums: _PoseProducts, one: SuspectUnknowns, other: SuspectUnknowns
) -> bool:
    """Whether two parameters are indistinguishable at all poses, given position and tool."""
    if len(one.columns) > 1 or len(other.columns) > 1:
        return False
    at = np.r_[zeros.columns.shift, zeros.columns.tool, one.columns[0], other.columns[0]]
    N = linear.unit(sums.A[0][np.ix_(at, at)])[0]
    k = len(at) - 2
    S = N[k:, k:] - N[k:, :k] @ linear.inverse(N[:k, :k]) @ N[:k, k:]
    there = S[0, 0] > ALIKE and S[1, 1] > ALIKE  # else it is equivalent to F_b or the tool
    return bool(there and S[0, 1] ** 2 > (1 - ALIKE) * S[0, 0] * S[1, 1])


ALIKE = 1e-6
"""Difference of the squared cosine of two columns from one below which they count as the same [1],
and fraction of a squared length below which nothing is left of a column."""
