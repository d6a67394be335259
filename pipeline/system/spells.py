"""Spells of noise: successive states of a campaign, in which every reading is wider than elsewhere.

A pose has states: its zeros, its pulls and, where they were read again, its zeros once more. In the
order of time those of all poses are a Markov chain that is quiet (Q), in the first state of a spell
(F) or in a later one (N). With u the fraction of all states that are in spells of on average
d = 1 + 1 / (1 - l) states, e = u / d (1 - u) and g_s the log likelihood ratio of the readings of s,
noisy over quiet,

                         Q    F    N
    L / L_quiet   Q  [ 1 - e  e    0 ]
    = product of  F  [   0    0    1 ] diag(1, exp g_s, exp g_s),  from Q to Q or N,
                  N  [ 1 - l  0    l ]

and zeros that are read before and after the pulls have half of their g in either place. Vibration,
the sun on a reflector or a draught last for minutes, whatever the pose: one bad reading among quiet
ones is no spell, however far off it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints, Locked

_LASTS = 0.75
"""Probability l that a spell of two or more states lasts for another one [1]: five on average, of
one to two minutes each."""


@dataclass(frozen=True, eq=False)
class States(Locked):
    """The states of the poses, by pose and pull.

    Attributes:
        key: Pose, and number of the pull in it or -1 for its zeros, of each state, shape (t, 2).
        pose: Index of its pose, shape (t,).
        turns: State of each step of the chain, in the order of time, shape (s,).
        of: State of each reading, shape (n,).
    """

    key: Ints
    pose: Ints
    turns: Ints
    of: Ints

    @classmethod
    def each(cls, keys: Ints, order: Ints | None = None) -> States:
        """States of readings with these keys, shape (n, 2).

        Args:
            keys: Pose and pull of each.
            order: Keys of all states in the order of time, those of zeros that were read twice in
                both places; ascending when not given.
        """
        key, of = np.unique(keys, axis=0, return_inverse=True)
        at = {tuple(one): k for k, one in enumerate(key.tolist())}
        turns = [
            at[one] for one in map(tuple, (key if order is None else order).tolist()) if one in at
        ]
        pose = np.unique(key[:, 0], return_inverse=True)[1]
        return cls(key, pose, np.array(turns, np.int64), of.reshape(-1))

    @classmethod
    def none(cls) -> States:
        """No states."""
        nothing = np.zeros(0, np.int64)
        return cls(np.zeros((0, 2), np.int64), nothing, nothing, nothing)

    def among(self, keys: Ints) -> Bools:
        """Whether each reading with these keys (m, 2) is of each state, shape (t, m)."""
        return np.asarray((self.key[:, None, :] == keys).all(axis=2))

    def ratio(self, gains: Array, share: Array) -> Array:
        """ln(L / L_quiet) of the chain, shape (...).

        Args:
            gains: g of each reading, shape (..., n).
            share: u, shape (...).
        """
        M, logs = self._steps(gains, share)
        if not len(self.turns):
            return logs
        while M.shape[-3] > 1:  # neighbours are multiplied: as many turns as the length has bits
            whole = M.shape[-3] // 2 * 2
            pairs = M[..., :whole:2, :, :] @ M[..., 1:whole:2, :, :]
            top = pairs.max(axis=(-1, -2), keepdims=True)
            logs = logs + np.log(top[..., 0, 0]).sum(axis=-1)
            M = np.concatenate([pairs / top, M[..., whole:, :, :]], axis=-3)
        return np.asarray(logs + np.log(M[..., 0, 0, 0] + M[..., 0, 0, 2]))

    def noisy(self, gains: Array, share: Array) -> Array:
        """Probability that each state is in a spell, arguments as for `ratio`, shape (..., t).

        That of zeros in two places as if these were independent.
        """
        M = self._steps(gains, share)[0]
        steps, ends = range(len(self.turns)), np.array([1.0, 0.0, 1.0])
        ahead, back = np.zeros((2, len(steps), *M.shape[:-3], 3))
        now, then = np.eye(3)[0], ends
        for t in steps:
            now = np.einsum("...i,...ij->...j", now, M[..., t, :, :])
            ahead[t] = now = now / now.sum(axis=-1, keepdims=True)
        for t in reversed(steps):
            back[t] = then = then / np.max(then, axis=-1, keepdims=True)
            then = np.einsum("...ij,...j->...i", M[..., t, :, :], then)
        each = ahead * back
        quiet = np.ones((len(self.key), *M.shape[:-3]))
        np.multiply.at(quiet, self.turns, each[..., 0] / each.sum(axis=-1))
        return np.asarray(1 - np.moveaxis(quiet, 0, -1))

    def _steps(self, gains: Array, share: Array) -> tuple[Array, Array]:
        """Matrix of each step of the chain (..., s, 3, 3), and the sum of the logs taken out."""
        order = np.argsort(self.of, kind="stable")
        first = np.searchsorted(self.of[order], np.arange(len(self.key)))
        own = np.add.reduceat(gains[..., order], first, axis=-1)
        own = own / np.maximum(np.bincount(self.turns, minlength=len(self.key)), 1)
        g = own[..., self.turns]
        begins = np.asarray(share / (1 - share) * (1 - _LASTS) / (2 - _LASTS))
        moves = np.zeros((*begins.shape, 3, 3))
        moves[..., 0, 0], moves[..., 0, 1], moves[..., 1, 2] = 1 - begins, begins, 1.0
        moves[..., 2, 0], moves[..., 2, 2] = 1 - _LASTS, _LASTS
        top = np.maximum(g, 0.0)
        seen = np.exp(np.stack([-top, g - top, g - top], axis=-1))
        return moves[..., None, :, :] * seen[..., None, :], np.asarray(top.sum(axis=-1))
