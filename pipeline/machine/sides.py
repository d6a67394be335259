"""Joints whose compliance depends on the sign of the torque, and which value applies where.

Such a joint is parametrised by the mean c of both compliances and half of their difference dc, with
the law of `Elastic.side`. Reported are c + dc for positive and c - dc for negative torque:
x' = T x and V' = T V T', T the identity with a 1 or -1 in the row of c and the column of dc.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.cell import Cell, load
from pipeline.machine.effect import Effect, Elastic, Pulls
from pipeline.machine.robot.configuration import torque


def columns(springs: int, effects: Sequence[Effect]) -> dict[int, int]:
    """Column of dc by the index of its joint.

    Args:
        springs: Number of parameters before those of the effects.
        effects: Effects in the order of their parameters.
    """
    out, at = {}, springs
    for effect in effects:
        if isinstance(effect, Elastic) and effect.side is not None:
            out[effect.carrier[0] - 1] = at
        at += len(effect.parameters)
    return out


def at_pose(cell: Cell, values: Array, q: Array, force: Array) -> dict[int, float]:
    """Sign of the torque, 1 or -1, at a pose, by the index of each such joint.

    Args:
        cell: Joint springs and effects.
        values: Their parameters, shape (k,).
        q: Joint values [m] or [rad], shape (n,).
        force: Force on the robot [N], F_b, shape (3,).
    """
    found = along(cell, values, np.atleast_2d(q), np.atleast_2d(force))
    return {joint: float(side[0]) for joint, side in found.items()}


def along(cell: Cell, values: Array, q: Array, force: Array) -> dict[int, Array]:
    """The same at many poses (m, n) under forces (m, 3); shape (m,) for each joint."""
    out, loaded = {}, None
    for effect in cell.effects:
        if isinstance(effect, Elastic) and effect.side is not None:
            loaded = loaded or load(cell, Pulls.at(q, force), values)
            tau = torque(effect.screws(loaded), loaded.load_point, loaded.force)
            out[effect.carrier[0] - 1] = effect.side(loaded, tau)[:, 0]
    return out


def taken(value: Array, cov: Array, T: Array) -> tuple[Array, Array]:
    """T x and T V T' of estimates (k,), (k, k) with possibly infinite variances, T (j, k)."""
    lost = np.isinf(np.diag(cov))
    finite = cov.copy()
    finite[lost, lost] = 0.0
    out = T @ finite @ T.T
    gone = np.flatnonzero((T[:, lost] != 0).any(axis=1))
    out[gone, gone] = np.inf
    return T @ value, out
