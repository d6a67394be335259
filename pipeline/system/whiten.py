"""From c = B x + G e to rows with unit, uncorrelated errors: the whole covariance, pose by pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.system.system import Errors


@dataclass(frozen=True, eq=False)
class Whitener(Locked):
    """Turns rows of a system into rows with unit covariance, V^-1/2.

    V is block-diagonal by pose plus the few errors common to all poses; the blocks are factored
    together (padded to the largest), the common ones by (I + A A')^-1/2 of rank r:

        V = L (I + A A') L',  L L' the blocks,  A = L^-1 G_common = U S W',
        V^-1/2 = (I - U diag(1 - 1 / sqrt(1 + S^2)) U') L^-1.

    Attributes:
        pose: Index of each row's pose 0..p-1, shape (M,).
        place: Place of each row in its block, shape (M,).
        inverse: Inverse Cholesky factor of each block, padded with ones, shape (p, s, s).
        common: The common errors after whitening by pose, A, shape (M, r).
        axes: Orthonormal columns that span A, shape (M, r).
        shrink: 1 - 1/sqrt(1 + S^2) along each of them, shape (r,).
    """

    pose: Ints
    place: Ints
    inverse: Array
    common: Array
    axes: Array
    shrink: Array

    @property
    def log_det(self) -> float:
        """log|V| = 2 sum log diag L + sum log(1 + S^2); the padding adds nothing."""
        own = float(np.sum(np.log(np.einsum("pss->ps", self.inverse))))
        return -2 * own - 2 * float(np.sum(np.log1p(-self.shrink)))

    def by_pose(self, rows: Array) -> Array:
        """Whiten within each pose only; `rows` has shape (M,) or (M, any)."""
        wide = rows[:, None] if rows.ndim == 1 else rows
        p, s = self.inverse.shape[:2]
        padded = np.zeros((p, s, wide.shape[1]))
        padded[self.pose, self.place] = wide
        return (self.inverse @ padded)[self.pose, self.place].reshape(rows.shape)

    def __call__(self, rows: Array) -> Array:
        """Whiten fully."""
        white = self.by_pose(rows)
        along = (self.axes.T @ white).T * self.shrink
        return white - (self.axes @ along.T)

    def back(self, rows: Array) -> Array:
        """Apply the transpose of the whitening, so that V^-1 is first this object, then `back`."""
        inner = rows - self.axes @ (self.shrink[:, None] * (self.axes.T @ rows))
        p, s = self.inverse.shape[:2]
        padded = np.zeros((p, s, rows.shape[1]))
        padded[self.pose, self.place] = inner
        return (np.swapaxes(self.inverse, 1, 2) @ padded)[self.pose, self.place]


def whitener(errors: Errors, pose: Ints) -> Whitener:
    """Factor the covariance V = G G'.

    Args:
        errors: The errors of the rows.
        pose: Pose number of each row, shape (M,); rows of a pose need not be neighbours.
    """
    index, place, count = linear.numbered(pose)
    own = errors.G[:, ~errors.common]
    V = (own @ own.T).tocoo()
    blocks = np.zeros((len(count), count.max(), count.max()))
    blocks[:] = np.eye(count.max())
    blocks[index, place, place] = 0.0
    blocks[index[V.row], place[V.row], place[V.col]] = V.data
    inverse = linear.whitening(blocks)
    inner = Whitener(
        index, place, inverse, np.zeros((len(pose), 0)), np.zeros((len(pose), 0)), np.zeros(0)
    )
    common = inner.by_pose(errors.G[:, errors.common].toarray())
    axes, size, _ = np.linalg.svd(common, full_matrices=False)
    return Whitener(index, place, inverse, common, axes, 1 - 1 / np.sqrt(1 + size**2))
