"""Distance of an arm from singular poses of wrist, elbow and shoulder, as one number.

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


def dexterity(at: Configuration, ample: float = np.inf) -> tuple[Array, Array]:
    """Smallest singular value of the arm's Jacobian [1], (m,), and its slope by the joints, (n, m).

    A pose that certainly has more than `ample` is not evaluated exactly: it gets a value between
    that and its own, from sigma_min^-2 <= trace((J J')^-1), and no slope.

    Args:
        at: The poses.
        ample: Value that is large enough [1].
    """
    omega, v = at.twists[..., :3], at.twists[..., 3:]
    turns = np.flatnonzero(np.abs(omega[0]).sum(axis=-1) > 0)
    moved = v + cross(omega, at.flange_origin[:, None])
    length = arm_m(at, int(turns[0]))
    J = np.concatenate([omega, moved / length], axis=-1)[:, turns]  # (m, k, 6): one row each joint
    short = len(turns) < J.shape[-1]
    N = J @ J.mT if short else J.mT @ J
    sigma, near = _surely(N, ample)
    values, vectors = linear.directions(N[near])
    sigma[near] = np.sqrt(np.maximum(values[:, 0], 0.0))
    first, J = vectors[:, :, 0], J[near]
    other = (first[:, None] @ J if short else first[:, None] @ J.mT)[:, 0]
    other = other / np.maximum(sigma[near], 1e-12)[:, None]
    by_joint, by_space = (first, other) if short else (other, first)
    slope = np.zeros(at.q.shape[::-1])
    by_space = by_space / [1, 1, 1, length, length, length]
    of = at.twists[near], at.flange_origin[near, None], moved[near]
    slope[:, near] = _slope(*of, turns, by_joint, by_space)
    return sigma, slope


def _surely(N: Array, ample: float) -> tuple[Array, Ints]:
    """Lower bounds of roots of least eigenvalues of N, (m, k, k), and where they are not ample."""
    if not np.isfinite(ample):
        return np.zeros(len(N)), np.arange(len(N))
    trace = np.einsum("mii->m", linear.regular_inverse(N))
    least = np.where(trace > 0, np.abs(trace), np.inf) ** -0.5
    return least, np.flatnonzero(~(least > ample))


def _slope(
    twists: Array, flange: Array, moved: Array, turns: Ints, by_joint: Array, by_space: Array
) -> Array:
    """Derivative of u' J v by the joints, with u and v held, shape (n, m).

    A joint j moves the flange and carries the screws (w_i, v_i) of all joints i > j along: by the
    bracket (w_j x w_i, w_j x v_i + v_j x w_i).

    Args:
        twists: Unit screws of the joints, shape (m, n, 6).
        flange: Its origin [m], shape (m, 1, 3).
        moved: Velocity of the flange by each joint, shape (m, n, 3).
        turns: The joints of J.
        by_joint: v, shape (m, k).
        by_space: u with its lengths in metres, shape (m, 6).
    """
    omega, v = twists[..., :3], twists[..., 3:]
    weight = np.zeros(twists.shape[:2])
    weight[:, turns] = by_joint
    turn, shift = by_space[:, None, :3], by_space[:, None, 3:]
    beyond = np.zeros(twists.shape)  # weighted sum over the joints beyond each
    beyond[:, :-1] = np.cumsum((weight[..., None] * twists)[:, :0:-1], axis=1)[:, ::-1]
    Omega, V = beyond[..., :3], beyond[..., 3:]
    every = Omega[:, :1] + (weight[..., None] * omega)[:, :1]
    turned = cross(omega, Omega)
    carried = cross(omega, V) + cross(v, Omega) + cross(turned, flange)
    slope = (turn * turned).sum(axis=-1) + (shift * carried).sum(axis=-1)
    return np.asarray((slope + (moved * cross(shift, every)).sum(axis=-1)).T)


def arm_m(at: Configuration, first: int) -> float:
    """Sum of the lengths of the links behind the first turning joint [m]."""
    origins = np.concatenate([at.origin[0, first:], at.flange_origin[:1]])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
