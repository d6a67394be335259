"""All forces of one pose logged for another one, where no single row stands out.

The two are taken to be exchanged if this, and no other exchange, single wrong force or other zero
of the scale in one pose, makes the joint springs explain all pulls. With L_e the likelihood under
exchange e, maximised over the springs, and n exchanges tried: if the rows are right, the largest
L_e / L reaches n / p with a probability of at most p (Markov's inequality for likelihood ratios).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.faults.assignment import Ring
from pipeline.faults.exchanged_pulls import PullMoves, of_loads, ordered
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.system import alarms, odds

_FEWEST = 2
"""Minimum number of pulls of a pose for its forces to be more than one row."""


@dataclass(frozen=True, eq=False)
class _Normal(Locked):
    """Whitened normal equations of every pull for one newton.

    Attributes:
        P: Normal matrices of the compliances, shape (m, k, k).
        q: Right-hand sides, shape (m, k).
        square: Sum of squares of the displacements.
        dof: Coordinates minus compliances.
    """

    P: Array
    q: Array
    square: float
    dof: int

    @classmethod
    def of(cls, moved: PullMoves) -> _Normal:
        """V_i = s^2 I + u_i^2 g_i g_i', with g_i = G_i x per newton, u_i the scale's uncertainty.

        V^(-1/2) = (I - a g g') / s with a = (1 - (1 + u^2 g'g / s^2)^(-1/2)) / g'g.
        """
        g = moved.G @ moved.solved(moved.force)
        gg = np.maximum(np.sum(g**2, axis=1), np.finfo(float).tiny)
        a = (1 - 1 / np.sqrt(1 + (moved.std / moved.noise) ** 2 * gg)) / gg
        G = (moved.G - (a[:, None] * g)[:, :, None] * (g[:, None] @ moved.G)) / moved.noise
        y = (moved.y - (a * np.sum(g * moved.y, axis=1))[:, None] * g) / moved.noise
        read = np.abs(moved.G).max(axis=2) > 0
        return cls(
            np.einsum("mck,mcl->mkl", G, G),
            np.einsum("mck,mc->mk", G, y),
            float(np.sum(y**2)),
            int(read.sum()) - G.shape[2],
        )

    def left(self, force: Array) -> float:
        """Residual sum of squares of the springs with these forces."""
        N = np.einsum("m,mkl->kl", force**2, self.P)
        b = force @ self.q
        return self.square - float(b @ linear.shortest(N) @ b)

    def another_zero(self, force: Array, groups: Bools) -> Array:
        """Residual sum of squares with another zero of the scale in some pulls, one group each.

        Each zero is that by the springs of all other pulls; in a single pull it frees the force.

        Args:
            force: As logged [N], shape (m,).
            groups: Pulls of each group, shape (n, m).
        """
        N, b = np.einsum("m,mkl->mkl", force**2, self.P), force[:, None] * self.q
        out = np.empty(len(groups))
        for k, mine in enumerate(groups):
            x = linear.shortest(N[~mine].sum(axis=0)) @ b[~mine].sum(axis=0)
            size = self.P[mine] @ x @ x
            off = force[mine] @ size - np.sum(self.q[mine] @ x)
            out[k] = self.left(force - mine * off / max(size.sum(), np.finfo(float).tiny))
        return out


def ladders(asked: Screening) -> list[Mistake]:
    """The two poses whose exchange of forces makes all pulls agree."""
    moved = PullMoves.of(asked)
    if moved is None or not asked.reduced.data.noise_stated:
        return []
    order = _decisive(asked, moved)
    if order is None:
        return []
    rings = [Ring((int(k), int(j))) for k, j in enumerate(order) if k < j]
    return [of_loads(asked, moved, ordered(moved, order), ring) for ring in rings]


def _decisive(asked: Screening, moved: PullMoves) -> Ints | None:
    """The only exchange that explains all pulls, if there is one."""
    normal = _Normal.of(moved)
    pose = asked.reduced.data.pulls.pose[moved.pull]
    tried = _tried(moved, pose)
    if not tried or normal.dof < 1:
        return None
    left = np.array([normal.left(moved.force[order]) for order in tried])
    best, given = int(np.argmin(left)), normal.left(moved.force)
    wide = max(1.0, left[best] / normal.dof)
    p = len(tried) * float(np.exp((left[best] - given) / wide / 2))
    fits = chi2_beyond(left[best] / max(asked.spread[0], 1.0) ** 2, normal.dof)
    if p > alarms.LADDERS or fits <= odds.FITS:
        return None
    groups = np.concatenate([np.eye(len(pose), dtype=bool), np.unique(pose)[:, None] == pose])
    others = np.append(np.delete(left, best), normal.another_zero(moved.force, groups))
    return None if others.min() - left[best] < odds.DECIDES * wide else tried[best]


def _tried(moved: PullMoves, pose: Ints) -> list[Ints]:
    """Orders of the forces with two poses exchanged, pull by pull in the order of the log."""
    own = [np.flatnonzero(pose == one) for one in np.unique(pose)]
    out = []
    for one, other in combinations([rows for rows in own if len(rows) >= _FEWEST], 2):
        if len(one) == len(other):
            order = np.arange(len(pose))
            order[one], order[other] = other, one
            out.append(order)
    return out


FAULT = Fault("exchanged", ladders, in_files=True)
