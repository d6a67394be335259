"""Rows that belong together, such as those of one pose, as padded arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked

_T = TypeVar("_T", bound=np.generic)

_SMALL = 60
"""Rows up to which a block is padded whatever the others have: twenty readings in three axes."""
_WASTE = 4
"""Work with padding, in times of that without, from which one by one is faster than a stack."""


@dataclass(frozen=True, eq=False)
class Blocks(Locked):
    """Where each row stands among those of its block.

    Attributes:
        index: Number of each row's block 0..p-1, shape (M,).
        place: Its place in the block, shape (M,).
        count: Rows of each block, s of the largest, shape (p,).
    """

    index: Ints
    place: Ints
    count: Ints

    @classmethod
    def of(cls, key: Array | Ints) -> Blocks:
        """Blocks of rows that share a key, such as a pose's number; they need not be neighbours."""
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index)
        order = np.argsort(index, kind="stable")
        place = np.empty(len(index), dtype=np.int64)
        place[order] = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
        return cls(index, place, count)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of blocks p, and rows of the largest s."""
        return len(self.count), int(self.count.max(initial=0))

    @property
    def uneven(self) -> bool:
        """Whether one block is so large that cubes of the padding cost more than all the rest."""
        p, s = self.shape
        return s > _SMALL and p * s**3 > _WASTE * int((self.count.astype(np.int64) ** 3).sum())

    def square(self, work: Callable[[Array], Array], padded: Array) -> Array:
        """Work on matrices (p, s, s), of each without its padding where that counts.

        There it is done in place; the padding is the identity, and stays it.
        """
        if not self.uneven:
            return work(padded)
        for one, n in zip(padded, self.count, strict=True):
            one[:n, :n] = work(one[:n, :n])
        return padded

    def solve(self, A: Array, padded: Array) -> Array:
        """Solutions of the regular A x = y of each block, (p, s, s) and (p, s, j), likewise.

        By the inverse, which is twice as fast where there are more columns y than rows.
        """
        if not self.uneven:
            return linear.regular_inverse(A) @ padded
        out = np.zeros_like(padded)
        for one, a, y, n in zip(out, A, padded, self.count, strict=True):
            one[:n] = linear.solve(a[:n, :n], y[:n])
        return out

    @property
    def there(self) -> Bools:
        """Where a padded array holds a row, shape (p, s)."""
        return np.asarray(np.arange(self.shape[1]) < self.count[:, None])

    @property
    def members(self) -> list[Ints]:
        """The rows of each block, in their own order."""
        order = np.argsort(self.index, kind="stable")
        return np.split(order, np.cumsum(self.count)[:-1])

    def padded(self, rows: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """Rows (M, ...) by block, zeros below the shorter ones, shape (p, s, ...)."""
        out = np.zeros((*self.shape, *rows.shape[1:]), rows.dtype)
        out[self.index, self.place] = rows
        return out

    def rows(self, padded: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """The rows of a padded array in their own order, shape (M, ...)."""
        return padded[self.index, self.place]

    def covariance(self, G: scipy.sparse.csr_array) -> Array:
        """G G' of errors that each stay within one block, shape (p, s, s)."""
        V = (G @ G.T).tocoo()
        out = np.zeros((self.shape[0], self.shape[1], self.shape[1]))
        out[self.index[V.row], self.place[V.row], self.place[V.col]] = V.data
        return out
