"""Information of one pose about the compliances, and its derivative by pose and anchor.

Frames, Jacobians and torques are those of the forward model. Only their derivative is coded here,
as one backward pass over many poses at once. Arrays of this file have the poses on the last axis,
where numpy works on long rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.design.scatter import PulledReadings, gram, weigh
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import torque, velocity


@dataclass(frozen=True, eq=False)
class Experiment(Locked):
    """What is done at every pose of a plan: the points pulled and read, and the noise.

    Attributes:
        robot: Geometry.
        load_point: Point where the chain pulls, flange frame [m], shape (3,).
        points: Measured points, flange frame [m], shape (t, 3).
        scale: Unit of each compliance, n of them [m/N] or [rad/(N m)]: information is about
            compliances in these units.
        scatter: Pulls at each pose and the scatter of their readings.
    """

    robot: Robot
    load_point: Array
    points: Array
    scale: Array
    scatter: PulledReadings


@dataclass(frozen=True, eq=False)
class PlannedPoses(Locked):
    """Poses with their chain, in F_b; poses are the last axis of arrays.

    Attributes:
        configuration: Frames and screws of the joints, poses first.
        load_point: [m], shape (3, m).
        points: Measured points [m], shape (t, 3, m).
        chain_m: Distance from load point to anchor, shape (m,).
        direction: Of the pull, u of Eq. (10), shape (3, m).
        J_load: Jacobian at the load point, shape (n, 3, m).
        J: Jacobians at the measured points, shape (t, n, 3, m).
        tau: Joint torques per newton of pull, shape (n, m).
        A: Displacement per newton and unit of `Experiment.scale`, Eq. (7), shape (t, n, 3, m).
    """

    configuration: Configuration
    load_point: Array
    points: Array
    chain_m: Array
    direction: Array
    J_load: Array
    J: Array
    tau: Array
    A: Array


def station(experiment: Experiment, q: Array, anchor: Array) -> PlannedPoses:
    """Kinematics and A at poses that pull towards their anchors, Eqs. (7), (10).

    Args:
        experiment: What is pulled and read.
        q: Joint values [m] or [rad], shape (m, n).
        anchor: Anchors in F_b [m], shape (3,) or (m, 3).
    """
    at = configure(experiment.robot, q)
    points = at.points(np.vstack([experiment.load_point, experiment.points]))
    chain = anchor - points[:, 0]
    length = np.sqrt(np.einsum("mi,mi->m", chain, chain))
    direction = chain / length[:, None]
    J = np.moveaxis(velocity(at.twists, points), 0, -1)
    tau = torque(at.twists, points[:, 0], direction).T
    points = np.moveaxis(points, 0, -1)
    return PlannedPoses(
        configuration=at,
        load_point=points[0],
        points=points[1:],
        chain_m=length,
        direction=direction.T,
        J_load=J[0],
        J=J[1:],
        tau=tau,
        A=J[1:] * (tau * experiment.scale[:, None])[:, None],
    )


def information(experiment: Experiment, at: PlannedPoses) -> Array:
    """Fisher information of all pulls at each pose about the scaled compliances, (m, n, n)."""
    scatter = experiment.scatter
    return scatter.inform(gram(at.A, scatter.weighted(at.points, at.A)))


def value_and_slope(
    experiment: Experiment, at: PlannedPoses, W: Array
) -> tuple[Array, Array, Array]:
    """Weighted sum of each pose's information, and its derivatives.

    Args:
        experiment: What is pulled and read.
        at: The poses.
        W: Symmetric weighting, shape (n, n) or one per pose (m, n, n).

    Returns:
        Sum of W * information, (m,), and its derivatives by joints (m, n) and anchor (m, 3).
    """
    scatter = experiment.scatter
    weighted = scatter.weighted(at.points, at.A)
    if scatter.force_std.any():
        total, V = scatter.combine(gram(at.A, weighted), W)
        back = weigh(weighted, V)
    else:
        V = scatter.alpha * W
        back = weigh(weighted, V)
        total = (back * at.A).sum(axis=(0, 1, 2))
    back *= 2 * experiment.scale[:, None, None]
    by_q, by_anchor = _pull_back(at, back)
    by_points = scatter.slope(at.points, at.A, V)
    if by_points is not None:
        by_q += np.einsum("tim,tnim->nm", by_points, at.J)
    return total, by_q.T, by_anchor.T


def _pull_back(at: PlannedPoses, G: Array) -> tuple[Array, Array]:
    """Derivative of a quantity by joints and anchor, from its derivative by J tau.

    A column of a Jacobian changes by dJ_k/dq_j = omega_min(j,k) x J_max(j,k). Both sums over k are
    cumulative, so this pass costs no more than A itself.

    Args:
        at: The poses.
        G: Derivative by the unscaled A, shape (t, n, 3, m).

    Returns:
        By the joints, shape (n, m), and by the anchor, shape (3, m).
    """
    by_tau = (G * at.J).sum(axis=(0, 2))
    omega = np.moveaxis(at.configuration.twists[..., :3], 0, -1)
    by_q = _turned(omega, at.J, G * at.tau[:, None])
    by_q += _turned(omega, at.J_load[None], (by_tau[:, None] * at.direction)[None])
    pulled = (by_tau[:, None] * at.J_load).sum(axis=0)
    along = (at.direction * pulled).sum(axis=0)
    by_anchor = (pulled - along * at.direction) / at.chain_m
    by_q -= (at.J_load * by_anchor).sum(axis=1)
    return by_q, by_anchor


def _turned(omega: Array, J: Array, g: Array) -> Array:
    """Sum over points and k of g_k . dJ_k/dq_j, shape (n, m)."""
    outward = _cross(J, g).sum(axis=0)
    inward = _cross(g, omega[None])
    by_q = np.empty_like(outward[:, 0])
    later, earlier = np.zeros_like(outward[0]), np.zeros_like(inward[:, 0])
    last = len(omega) - 1
    for j in range(len(omega)):
        later += outward[last - j]
        by_q[last - j] = (omega[last - j] * later).sum(axis=0)
    for j in range(1, len(omega)):
        earlier += inward[:, j - 1]
        by_q[j] += (J[:, j] * earlier).sum(axis=(0, 1))
    return by_q


def _cross(a: Array, b: Array) -> Array:
    """Vector product over the last axis but one."""
    x, y, z = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    u, v, w = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-2)
