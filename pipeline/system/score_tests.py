"""What would further columns add to a model, and how significantly?

A base, the columns X that are estimated in any case, is extended by one suspect at a time: a
missing effect, an outlier, a reflector that was moved, a pose that is left out. Each suspect has a
few columns D_j of its own. All rows are whitened:

    y = X b + D_j s_j + s e,    e ~ N(0, I).

With P the projection orthogonal to X everything follows from

    N_j = D_j' P D_j,    g_j = D_j' P y,    rest = y' P y,

the size of the suspect s_j = N_j^+ g_j, its covariance s^2 N_j^+, and the drop of the sum of
squares when it joins, T_j = g_j' N_j^+ g_j: over the variance, Rao's score statistic (Proc.
Cambridge Phil. Soc. 44, 1948), and the square of Baarda's w where it has one column (A Testing
Procedure for Use in Geodetic Networks, 1968).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.system.blocks import Blocks
from pipeline.system.elimination import eliminate

_NOTHING = 1e-30
"""Lower limit of a variance, below which it is rounding [1]."""


@dataclass(frozen=True, eq=False)
class ScoreTests(Locked):
    """What each of n suspects, of at most k columns, would add to a base, one suspect at a time.

    Suspects with fewer columns are padded with zeros.

    Attributes:
        N: D' P D, shape (..., n, k, k).
        g: D' P y, shape (..., n, k).
        whole: Squared lengths of the columns D, shape (..., n, k).
        rest: Residual sum of squares of the base.
        dof: Its degrees of freedom.
    """

    N: Array
    g: Array
    whole: Array
    rest: float
    dof: int

    @cached_property
    def _left(self) -> tuple[Array, Ints]:
        return linear.left(self.N, self.whole)

    @property
    def cov(self) -> Array:
        """Covariance N^+ of the size for unit variance, shape (..., n, k, k)."""
        return self._left[0]

    @property
    def rank(self) -> Ints:
        """Number of columns that the base does not explain, shape (..., n)."""
        return self._left[1]

    @cached_property
    def size(self) -> Array:
        """Estimated size N^+ g in the units of the columns, shape (..., n, k)."""
        return np.asarray(np.einsum("...ij,...j->...i", self.cov, self.g))

    @cached_property
    def drop(self) -> Array:
        """Drop of the sum of squares, g' N^+ g, shape (..., n)."""
        return np.maximum(np.einsum("...i,...i->...", self.size, self.g), 0.0)

    def variance(self, least: float = _NOTHING) -> Array:
        """(rest - T) / (dof - rank), at least `least`, shape (..., n).

        Where a noise is stated, `least` is 1: the stated uncertainty may be too large, but a chance
        low scatter must not create outliers.
        """
        return np.maximum((self.rest - self.drop) / np.maximum(self.dof - self.rank, 1), least)

    def p(self, variance: Array | float | None = None, known_from: float | None = None) -> Array:
        """Probability of such a drop by chance, F = (T / rank) / variance, shape (..., n).

        1 where nothing is left of the columns, or no residuals from which to estimate a variance.

        Args:
            variance: Of the rows; estimated from the residuals when not given.
            known_from: Its degrees of freedom; infinite where it is known, those of the residuals
                when not given.
        """
        rank = np.maximum(self.rank, 1)
        ratio = self.drop / (self.variance() if variance is None else variance)
        if known_from == np.inf:
            return np.where(self.rank > 0, special.chdtrc(rank, ratio), 1.0)
        dof = self.dof - self.rank if known_from is None else np.full(rank.shape, known_from)
        p = special.fdtrc(rank, np.maximum(dof, 1), ratio / rank)
        return np.where((self.rank > 0) & (dof > 0), p, 1.0)

    def of_block(self, block: int) -> ScoreTests:
        """The suspects of one block."""
        return self.arranged(lambda one: one[block])

    def arranged(self, way: Callable[[Array], Array]) -> ScoreTests:
        """The same suspects, or some of them, in other blocks."""
        return replace(self, N=way(self.N), g=way(self.g), whole=way(self.whole))

    def parts(self, at: Ints) -> ScoreTests:
        """Columns `at` (n, j) of one suspect of many columns, as n suspects of their own."""
        N = self.N[at[:, :, None], at[:, None, :]]
        return replace(self, N=N, g=self.g[at], whole=self.whole[at])

    def without(self, first: int) -> ScoreTests:
        """The columns of one suspect after its first ones, which join the base; `dof` stays."""
        M = np.block([[self.N, self.g[:, None]], [self.g, np.full((1, 1), self.rest)]])
        S = eliminate(M, np.arange(first))[first:, first:]
        return replace(
            self, N=S[:-1, :-1], g=S[:-1, -1], whole=self.whole[first:], rest=float(S[-1, -1])
        )

    def rows(self, suspects: Blocks) -> ScoreTests:
        """The same in the original order of the suspects, where they were padded by block."""
        return self.arranged(suspects.rows)


@dataclass(frozen=True, eq=False)
class Base(Locked):
    """Whitened rows, and the columns that are estimated in any case.

    Attributes:
        blocks: Blocks of rows that a suspect is confined to: one for all, or one per pose.
        Q: Orthonormal columns that span X, shape (p, s, k).
        own: Whether each block has its own coefficients for all columns of X, as with six rigid
            motions per pose.
        left: Residual of y, shape (p, s).
        dof: Rows minus rank of X.
    """

    blocks: Blocks
    Q: Array
    own: bool
    left: Array
    dof: int

    @classmethod
    def of(cls, X: Array, y: Array, key: Ints | None = None, own: bool = False) -> Base:
        """The base with columns X.

        Args:
            X: Whitened columns, shape (M, k).
            y: Whitened rows, shape (M,).
            key: Block of each row, shape (M,); a single block when not given.
            own: Whether each block has its own coefficients for all columns of X.
        """
        blocks = Blocks.of(np.zeros(len(y), np.int64) if key is None else key)
        Q = _spans(blocks, X) if own else blocks.padded(linear.orthonormal(X))
        rank = np.sum(np.abs(Q).max(axis=1, initial=0.0) > 0) if own else Q.shape[2]
        return cls(blocks, Q, own, np.zeros(blocks.shape), len(y) - int(rank)).against(y)

    @classmethod
    def spanned(cls, Q: Array, y: Array, key: Ints) -> Base:
        """The base with orthonormal columns Q (M, k); y and key as for `of`."""
        blocks = Blocks.of(key)
        zero = np.zeros(blocks.shape)
        return cls(blocks, blocks.padded(Q), False, zero, len(y) - Q.shape[1]).against(y)

    def against(self, y: Array) -> Base:
        """The same columns with other rows y (M,)."""
        return replace(self, left=self.blocks.padded(self.beyond(y[:, None])[:, 0]))

    def beyond(self, rows: Array) -> Array:
        """Residuals of rows (M, any) after projection onto the base, shape (M, any)."""
        if not self.own:
            Q = self.blocks.rows(self.Q)
            return rows - Q @ (Q.T @ rows)
        D = self.blocks.padded(rows)
        return self.blocks.rows(D - self.Q @ (np.swapaxes(self.Q, 1, 2) @ D))

    def more(self, rows: Array) -> Base:
        """The same base with further columns (M, any), whitened."""
        new = self.beyond(rows)
        if self.own:
            more = linear.spans(self.blocks.padded(new))
        else:
            more = self.blocks.padded(linear.orthonormal(new))
        rank = np.sum(np.abs(more).max(axis=1, initial=0.0) > 0) if self.own else more.shape[2]
        wider = replace(self, Q=np.concatenate([self.Q, more], axis=2), dof=self.dof - int(rank))
        return wider.against(self.blocks.rows(self.left))

    @property
    def rest(self) -> float:
        """Residual sum of squares of y."""
        return float(np.sum(self.left**2))

    def beside(self, D: Array) -> ScoreTests:
        """Suspects that each touch one block only.

        Args:
            D: Whitened columns of n suspects per block, shape (p, s, n, k); blocks and rows that
                are missing at the end are zero.
        """
        Q, left = (part[: D.shape[0], : D.shape[1]] for part in (self.Q, self.left))
        p, s, n, k = D.shape
        QD = (np.swapaxes(Q, 1, 2) @ D.reshape(p, s, n * k)).reshape(p, Q.shape[2], n, k)
        whole = np.einsum("psni,psnj->pnij", D, D)
        return ScoreTests(
            N=whole - np.einsum("pkni,pknj->pnij", QD, QD),
            g=np.einsum("psni,ps->pni", D, left),
            whole=np.einsum("pnii->pni", whole),
            rest=self.rest,
            dof=self.dof,
        )

    def free(self, rows: Bools) -> ScoreTests:
        """Some rows freed together, as if they were left out; for a base of one block.

        Their columns are unit vectors: N = I - Q Q' and g = P y of these rows.
        """
        Q, left = self.Q[0, rows], self.left[0, rows]
        return ScoreTests(np.eye(len(Q)) - Q @ Q.T, left, np.ones(len(Q)), self.rest, self.dof)

    def beside_all(self, D: Array) -> ScoreTests:
        """One suspect that may touch all rows, D whitened columns (M, k)."""
        beyond, left = self.beyond(D), self.blocks.rows(self.left)
        N, g = beyond.T @ beyond, beyond.T @ left
        return ScoreTests(N, g, np.einsum("mk,mk->k", D, D), self.rest, self.dof)


def _spans(blocks: Blocks, X: Array) -> Array:
    """Orthonormal columns of each block by itself, (p, s, r); columns beyond its rank are zero."""
    stack = blocks.padded(X)
    if not blocks.large:
        return linear.spans(stack)
    out = np.zeros((*blocks.shape, min(stack.shape[1:])))
    for one, rows, n in zip(out, stack, blocks.count, strict=True):
        (own,) = linear.spans(rows[None, :n])
        one[:n, : own.shape[1]] = own
    return out


def left_beside(M: Array, base: Ints, at: Ints) -> tuple[Array, Array, Array]:
    """Products (..., W, W) with a base eliminated: all, those of each suspect, and its squares.

    The squared lengths are those before elimination. Shapes (..., W, W), (..., n, k, k) and
    (..., n, k), for columns `at` as in `by_products`.
    """
    S, there = eliminate(M, base), at >= 0
    N = S[..., at[:, :, None], at[:, None, :]] * (there[:, :, None] & there[:, None, :])
    return S, N, M[..., at, at] * there


def by_products(M: Array, base: Ints, at: Ints, dof: int, least: float = 0.0) -> ScoreTests:
    """Suspects as columns of one product matrix M = A'A, whose last column is y: the fastest way.

    Args:
        M: Products of whitened columns, shape (W, W).
        base: Columns that are estimated in any case.
        at: Columns of each suspect, padded with -1, shape (n, k).
        dof: Residual degrees of freedom of the base.
        least: Mean square below which residuals are rounding.
    """
    S, N, whole = left_beside(M, base, at)
    return ScoreTests(
        N=N,
        g=S[at, -1] * (at >= 0),
        whole=whole,
        rest=max(float(S[-1, -1]), least * dof),
        dof=dof,
    )


def padded(columns: Sequence[Ints]) -> Ints:
    """Columns of each of n suspects, padded with -1 to the largest number, shape (n, k)."""
    out = np.full((len(columns), max(map(len, columns), default=0)), -1)
    for row, mine in zip(out, columns, strict=True):
        row[: len(mine)] = mine
    return out


_ROUNDED = 1e-6
"""Fraction of a row below which it is rounding [1]."""


def left_out(X: Array, y: Array, key: Ints, rows: Array, c: Array) -> tuple[Array, Bools]:
    """Residuals of each block when it is left out of the estimate: cross-validation.

    With the base's columns X = U H^+, U orthonormal, and U_p, r_p the rows of block p of U and of
    the residuals, the solution without the block is

        x_p = x - H (I - U_p' U_p)^-1 U_p' r_p

    (Stone, J. Roy. Stat. Soc. B 36, 1974; Cook and Weisberg, Residuals and Influence, 1982). Where
    the other blocks do not determine x_p uniquely, the solution of minimum norm in unit columns is
    taken.

    Args:
        X: Whitened columns of the base, shape (M + r, k).
        y: Whitened rows, shape (M + r,).
        key: Block of each of them, shape (M + r,).
        rows: The columns before whitening, zero for those that take no part in the prediction,
            shape (M, k).
        c: The rows before whitening, shape (M,).

    Returns:
        c - rows x_p in the unit of c, (M,), and where the other blocks do not determine it, (M,).
    """
    inverse, blocks = linear.pseudoinverse(X), Blocks.of(key)
    U, along = blocks.padded(inverse.U), inverse.U.T @ y
    residual = blocks.padded(y - inverse.U @ along)
    kept, V = linear.directions(np.eye(inverse.rank) - np.swapaxes(U, 1, 2) @ U)
    seen = kept > linear.ROUNDING_LEFT
    own = np.einsum("pji,pj->pi", V, np.einsum("psj,ps->pj", U, residual))
    gone = np.where(seen, own / np.where(seen, kept, 1.0), 0.0)
    b = along - np.einsum("pji,pi->pj", V, gone)
    compared = np.linalg.norm(X, axis=0)[:, None] * inverse.half  # parameters in unit columns
    for p in np.flatnonzero((~seen).any(axis=1)):  # undetermined directions: minimum norm
        free = V[p][:, ~seen[p]]
        b[p] -= free @ linear.least_squares(compared @ free, compared @ b[p])
    at, D = blocks.index[: len(c)], rows @ inverse.half
    only_here = np.einsum("mj,mji->mi", D, V[at]) * ~seen[at]
    lost = np.abs(only_here).max(axis=1, initial=0.0) > _ROUNDED * np.linalg.norm(D, axis=1)
    lost |= np.abs(rows[:, inverse.lost]).max(axis=1, initial=0.0) > 0
    return c - np.einsum("mj,mj->m", D, b[at]), lost
