"""A target that moved on the effector in mid-campaign, by the effector's shape alone.

A rigid effector keeps its shape wherever the robot takes it. With the rigid motion of every pose
projected out of its whitened readings, e_i = Q_i' W_i y_i and t_i = Q_i' W_i d y_i / d (points of
the tool), no robot is left in the model, and neither are its errors:

    T = g' (N - h' C h)^+ g,  g = sum s_i t_i' e_i,  N = sum s_i^2 t_i' t_i,  h = sum s_i t_i' t_i

over one target's columns in the first, and in h over those of all, C the covariance of the points,
s_i one from some pose on. A reading that is off at one pose, and a target that creeps in
proportion to time, are other courses s_i; a step must explain more than they do.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.geometry.unloaded import PoseRows, Unloaded


@dataclass(frozen=True, eq=False)
class ShapeRows(Locked):
    """Readings of the effector's shape.

    Attributes:
        e: Whitened residuals about the mean shape, shape (p, s).
        t: Derivatives by the points of the tool, shape (p, s, 3 k).
        C: Covariance of the points, shape (3 k, 3 k); nothing is known of their rigid motion.
        dof: Degrees of freedom of the residuals.
    """

    e: Array
    t: Array
    C: Array
    dof: int

    @classmethod
    def of(cls, zeros: Unloaded, rows: PoseRows) -> ShapeRows | None:
        """The shape in all poses; None if no distance between targets was read in two of them."""
        where = zeros.columns
        if zeros.turned is not None or len(zeros.tool.points) < 2:
            return None
        W = linear.whitening(rows.N)
        rigid = W @ np.concatenate([rows.D[:, :, where.shift], rows.D[:, :, where.loose]], axis=2)
        out = np.zeros_like(W)
        for k, one in enumerate(rigid):
            Q = linear.complement(one)
            out[k, : Q.shape[1]] = Q.T
        t, e = out @ W @ rows.D[:, :, where.tool], (out @ W @ rows.y[..., None])[..., 0]
        N = np.einsum("psa,psb->ab", t, t)
        C = linear.inverse(N)
        dof = int(sum(linear.rank(one @ one.T) for one in t)) - linear.rank(N)
        e = e - t @ (C @ np.einsum("psa,ps->a", t, e))
        return cls(e, t, C, dof) if dof > 0 else None

    @cached_property
    def square(self) -> float:
        """Sum of squares of the residuals."""
        return float(np.sum(self.e**2))

    def drops(self, share: Array) -> tuple[Array, Array]:
        """T of each course of each target, and its degrees of freedom, both (c, k).

        Args:
            share: Courses s of the c changes, shape (c, p).
        """
        every = np.einsum("psa,psb->pab", self.t, self.t)
        g = share @ np.einsum("psa,ps->pa", self.t, self.e)
        h, N = (np.einsum("cp,pab->cab", one, every) for one in (share, share**2))
        T, rank = [], []
        for k in range(self.t.shape[2] // 3):
            at = slice(3 * k, 3 * k + 3)
            own = N[:, at, at]
            left = own - h[:, at] @ self.C @ h[:, :, at]
            inverse, of = linear.left(left, np.einsum("cii->ci", own))
            T.append(np.einsum("ci,cij,cj->c", g[:, at], inverse, g[:, at]))
            rank.append(of)
        return np.stack(T, axis=1), np.stack(rank, axis=1)


def slips(shape: ShapeRows, order: Ints, sides: int) -> tuple[Array, Array]:
    """Likeliest step of each target, as the number of poses before it, and its p-value, both (k,).

    With T measured in the scatter that is left beside it, or the noise where that is more. It is 1
    where a reading off at one pose, or a creep, explains as much.

    Args:
        shape: The readings.
        order: Poses in time.
        sides: Poses on either side of a step, at least.
    """
    p = len(order)
    rank_of = np.argsort(order)
    steps = rank_of >= np.arange(sides, p - sides + 1)[:, None]
    T, rank = shape.drops(steps.astype(float))
    others = shape.drops(np.vstack([np.eye(p), rank_of / p]))[0].max()
    at = T.argmax(axis=0)
    best, of = np.max(T, axis=0), rank[at, np.arange(T.shape[1])]
    rest = np.maximum(shape.dof - of, 1)
    scatter = np.maximum(1.0, (shape.square - best) / rest)
    chance = special.fdtrc(np.maximum(of, 1), rest, best / np.maximum(of, 1) / scatter)
    return at + sides, np.where((best > others) & (of > 0), chance, 1.0)
