"""Spells of noise: successive states of a pose, in which every reading is wider than elsewhere.

A pose has states, its zeros and then its pulls in the order of time, each with some readings. With
probability u it is in a spell, which covers any two or more successive states, all such spans alike
(a pose of one state: that one). With g_s the log likelihood ratio of the readings of state s, noisy
over quiet,

    L / L_quiet = 1 - u + u mean_{a < b} exp(g_a + ... + g_b).

Vibration, the sun on a reflector or a draught last for minutes: one bad reading among quiet ones is
no spell, however far off it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Bools, Ints, Locked

_LEAST = 2
"""Minimum number of states in a spell [1]: a minute or more, as a state takes half of one."""


@dataclass(frozen=True, eq=False)
class States(Locked):
    """The states of the poses, by pose, in the order of time.

    Attributes:
        key: Pose, and number of the pull in it or -1 for its zeros, of each state, shape (t, 2).
        pose: Index of its pose, shape (t,).
        nth: Its place in its pose, shape (t,).
        of: State of each reading, shape (n,).
    """

    key: Ints
    pose: Ints
    nth: Ints
    of: Ints

    @classmethod
    def each(cls, keys: Ints) -> States:
        """States of readings with these keys, shape (n, 2)."""
        key, of = np.unique(keys, axis=0, return_inverse=True)
        first, index = np.unique(key[:, 0], return_index=True, return_inverse=True)[1:]
        return cls(key, index, np.arange(len(key)) - first[index], of.reshape(-1))

    @classmethod
    def none(cls) -> States:
        """No states."""
        nothing = np.zeros(0, np.int64)
        return cls(np.zeros((0, 2), np.int64), nothing, nothing, nothing)

    def among(self, keys: Ints) -> Bools:
        """Whether each reading with these keys (m, 2) is of each state, shape (t, m)."""
        return np.asarray((self.key[:, None, :] == keys).all(axis=2))

    @property
    def _count(self) -> Ints:
        """Number of states of each pose, shape (p,)."""
        return np.bincount(self.pose)

    def _padded(self, gains: Array) -> Array:
        """Sums of g over the states before each of a pose and in all, shape (..., p, q + 1)."""
        by_state = gains @ np.eye(len(self.key))[self.of]
        out = np.zeros((*gains.shape[:-1], len(self._count), int(self._count.max(initial=0)) + 1))
        out[..., self.pose, self.nth + 1] = by_state
        return np.cumsum(out, axis=-1)

    def _spans(self) -> Iterator[tuple[int, Bools]]:
        """Each length of a spell, and at which states of each pose it may begin, (p, q + 1 - l)."""
        count = self._count
        for length in range(1, int(count.max(initial=0)) + 1):
            begins = np.arange(int(count.max()) + 1 - length)
            fits = (begins + length <= count[:, None]) & (length >= np.minimum(_LEAST, count))[
                :, None
            ]
            yield length, fits

    def _spells(self, sums: Array) -> Iterator[tuple[int, Array]]:
        """Each length, and g of every span of it minus the log of their number."""
        number = sum(fits.sum(axis=1) for _, fits in self._spans())
        for length, fits in self._spans():
            gain = sums[..., length:] - sums[..., : sums.shape[-1] - length]
            yield length, np.where(fits, gain - np.log(number)[:, None], -np.inf)

    def ratio(self, gains: Array, share: Array) -> Array:
        """Sum of ln(L / L_quiet) over the poses, shape (...).

        Args:
            gains: g of each reading, shape (..., n).
            share: u, shape (...).
        """
        sums = self._padded(gains)
        mean = np.full(sums.shape[:-1], -np.inf)
        for _, each in self._spells(sums):
            mean = np.logaddexp(mean, special.logsumexp(each, axis=-1))
        u = np.asarray(share)[..., None]
        return np.asarray(np.logaddexp(np.log1p(-u), np.log(u) + mean).sum(axis=-1))

    def noisy(self, gains: Array, share: Array) -> Array:
        """Probability that each state is in a spell, arguments as for `ratio`, shape (..., t)."""
        sums = self._padded(gains)
        u = np.asarray(share)[..., None]
        every = [(length, np.log(u)[..., None] + each) for length, each in self._spells(sums)]
        whole = np.log1p(-u) + np.zeros(sums.shape[:-1])
        for _, each in every:
            whole = np.logaddexp(whole, special.logsumexp(each, axis=-1))
        begun = np.zeros(sums.shape)
        for length, each in every:
            p = np.exp(each - whole[..., None])
            begun[..., : p.shape[-1]] += p
            begun[..., length:] -= p
        covered = np.cumsum(begun, axis=-1)
        return np.asarray(covered[..., self.pose, self.nth])
