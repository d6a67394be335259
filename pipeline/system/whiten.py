"""Whitening of c = B x + G e to rows with unit, uncorrelated errors, with the full covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.system.blocks import Blocks
from pipeline.system.score_tests import Base
from pipeline.system.system import Errors


@dataclass(frozen=True, eq=False)
class Whitener(Locked):
    """Turns rows of a system into rows with unit covariance, V^-1/2.

    V is block-diagonal by pose plus the few errors common to all poses; the blocks are factored
    together (padded to the largest), the common ones by (I + A A')^-1/2 of rank r:

        V = L (I + A A') L',  L L' the blocks,  A = L^-1 G_common = U S W',
        V^-1/2 = (I - U diag(1 - 1 / sqrt(1 + S^2)) U') L^-1.

    Attributes:
        blocks: Rows by pose, at most s each.
        inverse: Inverse Cholesky factor of each block, padded with ones, shape (p, s, s).
        common: The common errors after whitening by pose, A, shape (M, r).
    """

    blocks: Blocks
    inverse: Array
    common: Array

    @cached_property
    def _along(self) -> tuple[Array, Array]:
        """U, orthonormal columns that span A, (M, r), and 1 - 1 / sqrt(1 + S^2) along each, (r,).

        Computed on demand: rows with priors do not need the square root of the whole.
        """
        axes, size, _ = linear.principal(self.common, full=False)
        return axes, 1 - 1 / np.sqrt(1 + size**2)

    def by_pose(self, rows: Array) -> Array:
        """Whiten within each pose only; `rows` has shape (M,) or (M, any)."""
        return _each(self.inverse, self.blocks, rows)

    def __call__(self, rows: Array) -> Array:
        """Whiten fully."""
        white, (axes, shrink) = self.by_pose(rows), self._along
        return white - axes @ ((axes.T @ white).T * shrink).T

    def back(self, rows: Array) -> Array:
        """Apply the transpose of the whitening, so that V^-1 is first this object, then `back`."""
        axes, shrink = self._along
        inner = rows - axes @ ((axes.T @ rows).T * shrink).T
        return _each(np.swapaxes(self.inverse, 1, 2), self.blocks, inner)

    @property
    def key(self) -> Ints:
        """Index of the pose of each row of `with_priors`, the number of poses for priors."""
        return np.concatenate([self.blocks.index, np.full(self.common.shape[1], len(self.inverse))])

    def with_priors(self, rows: Array) -> Array:
        """Rows (M,) or (M, any) whitened by pose, followed by a row of zeros per common error.

        Common errors a ~ N(0, I) are columns [A; I]: with a prior row for each of them, least
        squares weights with the whole V.
        """
        below = np.zeros((self.common.shape[1], *rows.shape[1:]))
        return np.concatenate([self.by_pose(rows), below])

    @property
    def columns(self) -> Array:
        """The common errors as columns with their priors, [A; I], shape (M + r, r)."""
        return np.vstack([self.common, np.eye(self.common.shape[1])])

    def base(self, columns: Array, y: Array) -> Base:
        """Base of columns (M, k) and common errors with their priors."""
        X = np.hstack([self.with_priors(columns), self.columns])
        return Base.of(X, self.with_priors(y), self.key)

    def own_base(self, columns: Array, y: Array) -> Base:
        """Base of columns (M, k) with separate coefficients per pose, without common errors."""
        return Base.of(self.by_pose(columns), self.by_pose(y), self.blocks.index, own=True)


def _each(factor: Array, blocks: Blocks, rows: Array) -> Array:
    """Rows (M,) or (M, any) of each block multiplied by its matrix, shape of `rows`."""
    wide = rows[:, None] if rows.ndim == 1 else rows
    if blocks.large:
        out = np.empty(wide.shape)
        for own, one in zip(blocks.members, factor, strict=True):
            out[own] = one[: len(own), : len(own)] @ wide[own]
        return out.reshape(rows.shape)
    return blocks.rows(factor @ blocks.padded(wide)).reshape(rows.shape)


def whitener(errors: Errors, pose: Ints) -> Whitener:
    """Factor the covariance V = G G'.

    Args:
        errors: The errors of the rows.
        pose: Pose number of each row, shape (M,); rows of a pose need not be neighbours.
    """
    blocks = Blocks.of(pose)
    V = blocks.covariance(errors.G[:, ~errors.common])
    which, at = np.nonzero(~blocks.there)
    V[which, at, at] = 1.0
    inverse = blocks.square(linear.whitening, V)
    return Whitener(blocks, inverse, _each(inverse, blocks, errors.G[:, errors.common].toarray()))
