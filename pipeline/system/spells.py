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

from dataclasses import dataclass

import numpy as np

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

    def ratio(self, gains: Array, share: Array) -> Array:
        """Sum of ln(L / L_quiet) over the poses, shape (...).

        Args:
            gains: g of each reading, shape (..., n).
            share: u, shape (...).
        """
        return np.asarray(self._spells(gains, share)[1].sum(axis=-1))

    def noisy(self, gains: Array, share: Array) -> Array:
        """Probability that each state is in a spell, arguments as for `ratio`, shape (..., t)."""
        spells, whole = self._spells(gains, share)
        begun = np.zeros((*whole.shape, len(spells) + 1))
        for length, each in enumerate(spells, 1):
            p = np.exp(each - whole[..., None])
            begun[..., :-length] += p
            begun[..., length:] -= p
        return np.asarray(np.cumsum(begun, axis=-1)[..., self.pose, self.nth])

    def _spells(self, gains: Array, share: Array) -> tuple[list[Array], Array]:
        """Log likelihood ratios, with their priors, of every spell and of each pose (..., p).

        Those of spells of 1, 2, ... q states by their first one, shape (..., p, q + 1 - length).
        """
        count = np.bincount(self.pose)
        q, u = int(count.max(initial=0)), np.asarray(share)[..., None]
        own = np.zeros((*gains.shape[:-1], len(count), q + 1))
        order = np.argsort(self.of, kind="stable")
        first = np.searchsorted(self.of[order], np.arange(len(self.key)))
        own[..., self.pose, self.nth + 1] = np.add.reduceat(gains[..., order], first, axis=-1)
        before = np.cumsum(own, axis=-1)
        prior = np.log(u) - np.log(np.maximum(count * (count - 1) // 2, 1))
        spells, whole = [], np.log1p(-u) + np.zeros(own.shape[:-1])
        for length in range(1, q + 1):
            fits = np.arange(length, q + 1) <= count[:, None]
            fits &= (length >= np.minimum(_LEAST, count))[:, None]
            each = before[..., length:] - before[..., : q + 1 - length] + prior[..., None]
            spells.append(np.where(fits, each, -np.inf))
            whole = np.logaddexp(whole, np.logaddexp.reduce(spells[-1], axis=-1))
        return spells, whole
