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
"""Rows up to which a block is padded in any case: twenty readings in three axes."""
_WASTE = 4
"""Ratio of work with and without padding above which block-by-block computation is faster [1]."""


@dataclass(frozen=True, eq=False)
class Blocks(Locked):
    """Position of each row within its block.

    Attributes:
        index: Number of each row's block 0..p-1, shape (M,).
        place: Its position in the block, shape (M,).
        count: Rows of each block, at most s, shape (p,).
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
        """Whether one block is so large that the cubic work on padding exceeds all the rest."""
        p, s = self.shape
        return s > _SMALL and p * s**3 > _WASTE * int((self.count.astype(np.int64) ** 3).sum())

    def square(self, work: Callable[[Array], Array], padded: Array) -> Array:
        """Apply `work` to matrices (p, s, s), to each without its padding where blocks are uneven.

        In that case it works in place; the padding is the identity and stays so.
        """
        if not self.uneven:
            return work(padded)
        for one, n in zip(padded, self.count, strict=True):
            one[:n, :n] = work(one[:n, :n])
        return padded

    def solve(self, A: Array, padded: Array) -> Array:
        """Solve the regular A x = y of each block, (p, s, s) and (p, s, j), as for `square`.

        Even blocks use the inverse, which is twice as fast where y has more columns than rows.
        """
        if not self.uneven:
            return linear.regular_inverse(A) @ padded
        out = np.zeros_like(padded)
        for one, a, y, n in zip(out, A, padded, self.count, strict=True):
            one[:n] = linear.solve(a[:n, :n], y[:n])
        return out

    @property
    def there(self) -> Bools:
        """True where a padded array holds a row, shape (p, s)."""
        return np.asarray(np.arange(self.shape[1]) < self.count[:, None])

    @property
    def members(self) -> list[Ints]:
        """Indices of the rows of each block, in their original order."""
        order = np.argsort(self.index, kind="stable")
        return np.split(order, np.cumsum(self.count)[:-1])

    def padded(self, rows: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """Rows (M, ...) by block, padded with zeros, shape (p, s, ...)."""
        out = np.zeros((*self.shape, *rows.shape[1:]), rows.dtype)
        out[self.index, self.place] = rows
        return out

    def rows(self, padded: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """The rows of a padded array in their original order, shape (M, ...)."""
        return padded[self.index, self.place]

    def covariance(self, G: scipy.sparse.csr_array) -> Array:
        """G G' of errors that each stay within one block, shape (p, s, s)."""
        V = (G @ G.T).tocoo()
        out = np.zeros((self.shape[0], self.shape[1], self.shape[1]))
        out[self.index[V.row], self.place[V.row], self.place[V.col]] = V.data
        return out
