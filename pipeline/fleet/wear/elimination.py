"""Information on columns estimated together with the levels of a robot: trends, steps.

y = A a + Z b + e, where e has the covariance of campaigns and days. For columns Z, with the levels
A eliminated,

    I = Z' P Z,   s = Z' P y,   P = V^-1 - V^-1 A (A' V^-1 A)^-1 A' V^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.fleet.wear.machine import Machine, products

_NOTHING = 1e-6
"""Fraction of the information on a column below which it is treated as zero once the levels are
eliminated [1]."""


@dataclass(frozen=True, eq=False)
class Eliminated(Locked):
    """Columns Z with the levels eliminated, for the first k campaigns.

    Attributes:
        N: I, shape (m, m).
        g: s, shape (m,).
        PZ: P Z, shape (k, n, m).
        told: Columns with information left after the levels are eliminated, shape (m,).
    """

    N: Array
    g: Array
    PZ: Array
    told: Bools

    def variance_of_variance(self, along: Array, uncertainty: Array) -> Array:
        """Variance of the information along directions, due to the estimated scatter.

        dI/dv_j = -sum_i (P Z d)_ij^2, and for the common scatter of all joints the square of the
        sum over joints; errors of the v_j are assumed independent.

        Args:
            along: Directions d in columns, shape (m, D).
            uncertainty: Variance of each variance of `Scatter`, shape (n + 1,).

        Returns:
            Variance of d' I d, shape (D,).
        """
        moved = self.PZ @ along
        by_joint = np.sum(moved**2, axis=0) ** 2
        common = np.sum(moved.sum(axis=1) ** 2, axis=0) ** 2
        return np.asarray(uncertainty[:-1] @ by_joint + uncertainty[-1] * common)


def eliminated(machine: Machine, W: Array, Z: Array, first: int | None = None) -> Eliminated:
    """Eliminate the levels from columns Z (K, n, m), for the first campaigns or all.

    Args:
        machine: The robot.
        W: Its `weights`.
        Z: Columns.
        first: Number of campaigns; None for all.
    """
    A, W, Z, y = machine.nuisance[:first], W[:first], Z[:first], machine.y[:first]
    WA, WZ = W @ A, W @ Z
    taken = linear.regular_inverse(products(A, WA)[None])[0] @ np.einsum("kip,kim->pm", A, WZ)
    PZ = WZ - WA @ taken
    whole = np.einsum("kim,kim->m", Z, WZ)
    N = np.einsum("kim,kiq->mq", Z, PZ)
    determined = np.diag(N) > _NOTHING * np.maximum(whole, _NOTHING)
    return Eliminated(N, np.einsum("kim,ki->m", PZ, y), PZ, determined)


def gaps(machine: Machine, first: int) -> list[int]:
    """Campaigns among the first that are followed by one of a later day."""
    return [g for g in range(first - 1) if machine.t[g + 1] > machine.t[g]]


def steps(machine: Machine, after: list[int]) -> Array:
    """Columns of a step of each joint after each of these campaigns, shape (K, n, gaps n)."""
    n = machine.joints
    columns = [
        np.eye(n) * (machine.present & (machine.t > machine.t[g])[:, None])[:, None, :]
        for g in after
    ]
    return np.concatenate([np.zeros((len(machine.t), n, 0)), *columns], axis=-1)
