"""How far an arm is from a singular pose: wrist, elbow and shoulder by one number.

    J = [ w_i ; (w_i x p + v_i) / L ]        sigma_min(J), its smallest singular value

of the turning joints i, at the origin p of the flange, L the sum of the lengths of the links. A
wrist that is 5 deg from stretched has 0.020 to 0.025 in all robots that ship (median over the other
joints), so 0.02 is a margin of about 5 deg.
"""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.robot.configuration import Configuration, cross


def dexterity(at: Configuration) -> tuple[Array, Array]:
    """Smallest singular value of the arm's Jacobian [1], (m,), and its slope by the joints, (n, m).

    Args:
        at: The poses.
    """
    omega, v = at.twists[..., :3], at.twists[..., 3:]
    turns = np.flatnonzero(np.abs(omega[0]).sum(axis=-1) > 0)
    moved = v + cross(omega, at.flange_origin[:, None])
    length = arm_m(at, int(turns[0]))
    J = np.concatenate([omega, moved / length], axis=-1)[:, turns]  # (m, k, 6): one row each joint
    short = len(turns) < J.shape[-1]
    values, vectors = linear.directions(J @ J.mT if short else J.mT @ J)
    sigma = np.sqrt(np.maximum(values[:, 0], 0.0))
    first = vectors[:, :, 0]
    other = (first[:, None] @ J if short else first[:, None] @ J.mT)[:, 0]
    other = other / np.maximum(sigma, 1e-12)[:, None]
    by_joint, by_space = (first, other) if short else (other, first)
    return sigma, _slope(at, moved, turns, by_joint, by_space / [1, 1, 1, length, length, length])


def _slope(at: Configuration, moved: Array, turns: Ints, by_joint: Array, by_space: Array) -> Array:
    """Derivative of u' J v by the joints, u and v held, shape (n, m).

    A joint j moves the flange, and it carries the screws (w_i, v_i) of all joints i > j along: by
    the bracket (w_j x w_i, w_j x v_i + v_j x w_i).

    Args:
        at: The poses.
        moved: Velocity of the flange by each joint, shape (m, n, 3).
        turns: The joints of J.
        by_joint: v, shape (m, k).
        by_space: u with its lengths in metres, shape (m, 6).
    """
    omega, v = at.twists[..., :3], at.twists[..., 3:]
    weight = np.zeros(at.q.shape)
    weight[:, turns] = by_joint
    turn, shift = by_space[:, None, :3], by_space[:, None, 3:]
    beyond = np.zeros((*at.q.shape, 6))  # of the joints behind each, weighted
    beyond[:, :-1] = np.cumsum((weight[..., None] * at.twists)[:, :0:-1], axis=1)[:, ::-1]
    Omega, V = beyond[..., :3], beyond[..., 3:]
    every = Omega[:, :1] + (weight[..., None] * omega)[:, :1]
    turned = cross(omega, Omega)
    carried = cross(omega, V) + cross(v, Omega) + cross(turned, at.flange_origin[:, None])
    slope = (turn * turned).sum(axis=-1) + (shift * carried).sum(axis=-1)
    return np.asarray((slope + (moved * cross(shift, every)).sum(axis=-1)).T)


def arm_m(at: Configuration, first: int) -> float:
    """Sum of the lengths of the links behind the first turning joint [m]."""
    origins = np.concatenate([at.origin[0, first:], at.flange_origin[:1]])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
