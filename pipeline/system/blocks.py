"""Rows that belong together, such as those of one pose, as padded arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked

_T = TypeVar("_T", bound=np.generic)

_SMALL = 60
"""Rows up to which blocks are computed together, padded: twenty readings in three axes."""


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
    def large(self) -> bool:
        """Whether a block is so large that each by itself, without padding, is faster."""
        return self.shape[1] > _SMALL

    @property
    def alike(self) -> list[Ints]:
        """Blocks that are computed together: all, padded, or those of equal size.

        One large block among many small ones is then no padding to each of them.
        """
        every = np.arange(len(self.count))
        return [every[self.count == n] for n in np.unique(self.count)] if self.large else [every]

    def only(self, some: Ints) -> tuple[Ints, Blocks]:
        """Rows of some blocks, in their original order, and these blocks."""
        rows = np.flatnonzero(np.isin(self.index, some))
        index = np.searchsorted(some, self.index[rows])
        return rows, Blocks(index, self.place[rows], self.count[some])

    def square(self, work: Callable[[Array], Array], padded: Array) -> Array:
        """Apply `work` to matrices (p, s, s), to each without its padding where blocks are large.

        In that case it works in place; the padding is the identity and stays so.
        """
        if not self.large:
            return work(padded)
        for one, n in zip(padded, self.count, strict=True):
            one[:n, :n] = work(one[:n, :n])
        return padded

    def solve(self, L: Array, padded: Array) -> Array:
        """Solve L x = y of each block, L lower triangular, (p, s, s) and (p, s, j).

        Small blocks are inverted together; a large one is substituted, in s / j of the time.
        """
        if not self.large:
            return linear.regular_inverse(L) @ padded
        out = np.zeros_like(padded)
        for one, own, y, n in zip(out, L, padded, self.count, strict=True):
            one[:n] = scipy.linalg.solve_triangular(own[:n, :n], y[:n], lower=True)
        return out

    @property
    def there(self) -> Bools:
        """True where a padded array holds a row, shape (p, s)."""
        return np.asarray(np.arange(self.shape[1]) < self.count[:, None])

    @property
    def members(self) -> list[Ints]:
        """Indices of the rows of each block, in their original order."""
        return np.split(np.argsort(self.index, kind="stable"), np.cumsum(self.count)[:-1])

    def padded(self, rows: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """Rows (M, ...) by block, padded with zeros, shape (p, s, ...)."""
        out = np.zeros((*self.shape, *rows.shape[1:]), rows.dtype)
        out[self.index, self.place] = rows
        return out

    def rows(self, padded: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """The rows of a padded array in their original order, shape (M, ...)."""
        return padded[self.index, self.place]

    def covariance(self, G: scipy.sparse.csr_array) -> Array:
        """G G' of errors that each stay within one block, shape (p, s, s).

        An error of more rows than a small block has is multiplied densely: in a sparse product it
        takes as many times longer.
        """
        wide = np.bincount(G.indices, minlength=G.shape[1]) > _SMALL
        V = (G[:, ~wide] @ G[:, ~wide].T).tocoo()
        out = np.zeros((self.shape[0], self.shape[1], self.shape[1]))
        out[self.index[V.row], self.place[V.row], self.place[V.col]] = V.data
        if wide.any():
            F = self.dense(G[:, wide])[1]
            for one, own in zip(out, self.members, strict=True):
                one[: len(own), : len(own)] += F[own] @ F[own].T
        return out

    def dense(self, G: scipy.sparse.csr_array) -> tuple[Blocks, Array]:
        """Errors that each stay within one block: blocks of at most e of them, and dense (M, e)."""
        G = scipy.sparse.csc_array(G)
        G = G[:, np.diff(G.indptr) > 0]
        index = self.index[G.indices[G.indptr[:-1]]]
        blocks = Blocks(index, Blocks.of(index).place, np.bincount(index, minlength=self.shape[0]))
        each, out = G.tocoo(), np.zeros((G.shape[0], blocks.shape[1]))
        out[each.row, blocks.place[each.col]] = each.data
        return blocks, out
