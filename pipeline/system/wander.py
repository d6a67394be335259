"""Slow wander of the instrument: correlated in time, common to all targets, equal in three axes.

w(t) is an Ornstein-Uhlenbeck process of unit variance,
E[w(t) w(t')] = rho(t - t') = exp(-|t - t'| / tau). A displacement, read at t and measured from
zeros read at z_1 .. z_n, contains w(t) - mean w(z_k), so that within a pose

    K_ij = rho(t_i - t_j) - mean_k rho(t_i - z_k) - mean_k rho(t_j - z_k) + mean_kl rho(z_k - z_l);

correlation between poses is too small to matter. w is a shift of the instrument, the same wherever
a target is, or its rotation, as of a stand that tilts or a beam that the air bends: a target at p
from it then moves by w x p, more the farther it is. Which of the two, and how large it is, is
unknown: V has its posterior mean over ways, sizes and times (Uhlenbeck and Ornstein, Physical
Review 36, 1930; Kermarrec et al., Sensors 19, 2019, for noise of laser instruments that is
correlated in time).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.restricted import of_fixed
from pipeline.system.rows_by_pose import RowsByPose

TIMES_S = (300.0, 1200.0, 4800.0)
"""Trial correlation times [s]: from the length of a pose to that of a campaign; longer ones are a
random walk within a pose."""

SIZES = (0.2, 0.35, 0.6, 1.0, 1.8, 3.2, 6.0, 12.0)
"""Trial sizes of the wander: its effect on a displacement, rms, over the standard uncertainty of a
reading per axis [1]."""

_NONE = 0.5
"""Prior probability of no wander [1]."""

_BEFORE = np.log(np.append(_NONE, np.full(len(SIZES), (1 - _NONE) / len(SIZES))))
"""Log of the prior probability of no wander and of each size."""


@dataclass(frozen=True, eq=False)
class Wander(Locked):
    """Estimate of the wander from the rows.

    Attributes:
        factor: F_p with F_p F_p' its covariance in the displacements of each pose, all ways, sizes
            and times together [m], shape (d, 3, k).
        size: Standard deviation that it adds to a displacement, root of the posterior mean
            square [m].
        std: Its standard uncertainty [m].
        time_s: Likeliest correlation time [s].
        p_value: Probability of a wander this large by chance.
        probability: Posterior probability that there is any.
        process: Variance of the shift [m^2] and of the rotation [rad^2] for each of `TIMES_S`,
            (2, t).
        unit: `unit_m` of the measurements.
    """

    factor: Array
    size: float
    std: float
    time_s: float
    p_value: float
    probability: float
    process: Array
    unit: float

    @classmethod
    def none(cls, data: Measured) -> Wander:
        """No wander."""
        factor, process = np.zeros((len(data.pull), 3, 1)), np.zeros((2, len(TIMES_S)))
        return cls(factor, 0.0, 0.0, TIMES_S[0], 1.0, 0.0, process, unit_m(data))

    @property
    def between_poses(self) -> float:
        """Standard deviation of its shift over the campaign, at least `size` [m]."""
        return max(self.size, float(np.sqrt(self.process[0].sum())))

    def of_readings(self, times: Array, levers: Array) -> Array:
        """F with F F' its covariance in single readings, shape (n, 3, k) [m].

        Args:
            times: When they were made [s], shape (n,).
            levers: Positions relative to the instrument, axes of F_b [m], shape (n, 3).
        """
        apart = np.abs(times[:, None] - times)
        ways = np.tile(np.eye(3), (len(times), 1, 1)), linear.turning(levers)
        parts = []
        for way, variances in zip(ways, self.process, strict=True):
            K = sum(v * np.exp(-apart / tau) for v, tau in zip(variances, TIMES_S, strict=True))
            if variances.any():
                parts.append(_along(way, linear.factor(np.asarray(K))))
        return np.concatenate(parts, axis=2) if parts else np.zeros((len(times), 3, 0))


def _along(ways: Array, factor: Array) -> Array:
    """Rows (n, 3, 3 k) of motions along three `ways` (n, 3, 3), each with the factor (n, k)."""
    return np.einsum("nia,nk->niak", ways, factor).reshape(len(ways), 3, -1)


def unit_m(data: Measured) -> float:
    """Standard uncertainty of a loaded reading per axis, root mean square [m]."""
    return float(np.sqrt(np.einsum("dii->", data.loaded_cov) / (3 * len(data.pull))))


def kernel(data: Measured, time_s: float) -> tuple[Array, float]:
    """Factors by pull of K of all poses, mean square one, (m, k), and the mean square removed.

    Zero where times are missing.
    """
    pose = np.unique(data.pulls.pose, return_inverse=True)[1]
    out = np.zeros((len(pose), int(np.bincount(pose).max())))
    for p in range(pose.max() + 1):
        rows = np.flatnonzero(pose == p)
        t, z = data.pulls.time[rows], data.zero_times[rows[0]]
        z = z[np.isfinite(z)]
        if not (len(z) and np.isfinite(t).all()):
            return np.zeros_like(out), 1.0
        every = np.append(t, z)
        rho = np.exp(-np.abs(every[:, None] - every) / time_s)
        A = np.hstack([np.eye(len(t)), np.full((len(t), len(z)), -1 / len(z))])
        out[rows, : len(rows)] = linear.factor(A @ rho @ A.T)
    mean = max(float(np.mean(np.sum(out**2, axis=1))), linear.TINY)
    return out / np.sqrt(mean), mean


def restless(data: Measured, moves: Array, time_s: float) -> Array:
    """Effect of joints whose compliance varies between pulls, rows of mean square one, (d, 3, j).

    Every compliance varies by the same fraction of itself, correlated in time: K of a pose is
    sum_j b_j b_j' rho, with b_j the contribution of joint j to a row under its pull. A wander moves
    all targets equally under any pull; this follows the torques.

    Args:
        data: The measurements.
        moves: Columns of the springs in their typical sizes, shape (M, n).
        time_s: Correlation time [s].
    """
    pose = np.unique(data.pulls.pose, return_inverse=True)[1]
    alike = np.zeros((len(pose), int(np.bincount(pose).max())))
    for p in range(pose.max() + 1):
        rows = np.flatnonzero(pose == p)
        t = data.pulls.time[rows]
        if not np.isfinite(t).all():
            continue
        alike[rows, : len(rows)] = linear.factor(np.exp(-np.abs(t[:, None] - t) / time_s))
    of_row = np.repeat(alike[data.pull], 3, axis=0)
    out = (moves[:, :, None] * of_row[:, None, :]).reshape(len(data.pull), 3, -1)
    return np.asarray(out / np.sqrt(max(float(np.mean(np.sum(out**2, axis=2))), linear.TINY)))


def wander(
    data: Measured, beyond: RowsByPose, told: bool = True, moves: Array | None = None
) -> Wander:
    """Estimate the wander by restricted likelihood over `SIZES` and `TIMES_S`.

    With W = L^-1 K L^-T of each pose, rotated to diag(w), and a the size:

        L(a) = sum log(1 + a^2 w) + log|N| + sum y^2 / (1 + a^2 w) - g' N^-1 g,

    N = X' D X + prior, g = X' D y, D = diag(1 / (1 + a^2 w)). p is that of the likelihood ratio
    with two degrees of freedom, halved as the size is at its bound under the null, and multiplied
    by the number of ways.

    A wander along one axis only is not of the instrument, and none is returned. Joints that are
    `restless` compete with it, all sizes and times together, at the prior odds of nameless effects:
    their probability is taken from that of the wander.

    Args:
        data: The measurements.
        beyond: Their rows relative to a model.
        told: Whether there are enough of them; if not, none is returned.
        moves: Columns of the springs in their typical sizes, shape (M, n); without them nothing
            competes.
    """
    unit = unit_m(data)
    kernels = [kernel(data, time_s) for time_s in TIMES_S]
    factors = np.stack([factor for factor, _ in kernels])
    nothing = Wander.none(data)
    if not (told and factors.any()):
        return nothing
    ways = _ways(data)
    rows, sizes = _each_felt(data, ways, factors)
    a = np.append(0.0, SIZES)
    losses = np.array([_losses(beyond, unit * one, a) for one in rows])
    weight, p = _likely(losses)
    p = min(1.0, p * len(ways))
    best = int(np.argmax(weight[:, 1:].max(axis=1)))
    largest = a[weight[best].argmax()]
    if p < alarms.COMPONENT and _along_one_axis(beyond, unit * rows[best], largest):
        return nothing
    weight = weight * _not_joints(data, beyond, moves, losses, weight)
    each = (weight @ a**2).reshape(len(ways), len(TIMES_S))
    share = each / sizes.reshape(each.shape)
    mean = float((weight * a).sum())
    process = unit**2 * share / np.array([size for _, size in kernels])
    return Wander(
        factor=unit * _every_way(data, ways, share, factors),
        size=unit * float(np.sqrt(each.sum())),
        std=unit * float(np.sqrt(max((weight * a**2).sum() - mean**2, 0.0))),
        time_s=TIMES_S[best % len(TIMES_S)],
        p_value=p,
        probability=float(weight[:, 1:].sum()),
        process=np.vstack([process, np.zeros((2 - len(ways), len(TIMES_S)))]),
        unit=unit,
    )


def _each_felt(data: Measured, ways: Sequence[Array], factors: Array) -> tuple[list[Array], Array]:
    """Effect of each way and time on the rows, and its mean square."""
    found = [_felt(data, way, one) for way in ways for one in factors]
    return [one for one, _ in found], np.array([size for _, size in found])


def _every_way(data: Measured, ways: Sequence[Array], share: Array, factors: Array) -> Array:
    """Factor of a wander with these shares of variance by way and time, shape (d, 3, k)."""
    whole = (_together(data, one, factors) for one in share)
    return np.concatenate([_shifted(data, *one) for one in zip(ways, whole, strict=True)], axis=2)


def _ways(data: Measured) -> list[Array]:
    """Displacement per unit of shift and, if the positions are known, of rotation, (d, 3, 3)."""
    shift = np.tile(np.eye(3), (len(data.pull), 1, 1))
    if data.tracker is None or not np.isfinite(data.unloaded).all():
        return [shift]
    return [shift, linear.turning(data.unloaded - data.tracker)]


def _shifted(data: Measured, way: Array, factor: Array) -> Array:
    """Rows (d, 3, 3 k) of a factor by pull (m, k)."""
    return _along(way, factor[data.pull] * data.shifts[:, None])


def _felt(data: Measured, way: Array, factor: Array) -> tuple[Array, float]:
    """The same scaled to mean square one per axis, and the mean square removed."""
    rows = _shifted(data, way, factor)
    mean = max(float(np.sum(rows**2)) / (3 * len(rows)), linear.TINY)
    return rows / np.sqrt(mean), mean


def _together(data: Measured, share: Array, factors: Array) -> Array:
    """One factor by pull (m, k) of the covariances of all times, each with its share."""
    pose, out = np.unique(data.pulls.pose, return_inverse=True)[1], np.zeros(factors.shape[1:])
    for p in range(pose.max() + 1):
        rows = np.flatnonzero(pose == p)
        F = factors[:, rows, : len(rows)]
        out[rows, : len(rows)] = linear.factor(np.einsum("t,tik,tjk->ij", share, F, F))
    return out


def _likely(losses: Array) -> tuple[Array, float]:
    """Posterior weights of times and sizes, including none, and p of the likelihood ratio.

    Args:
        losses: -2 log likelihood of each way and time (rows) for no wander and each of `SIZES`,
            shape (k, 1 + sizes).
    """
    ratio = np.maximum(losses[:, 0, None] - losses, -700.0)  # 2 (L_a - L_0)
    weight = np.asarray(special.softmax(0.5 * ratio + _BEFORE))
    return weight, 0.5 * float(special.chdtrc(2, max(float(ratio.max()), 0.0)))


def _not_joints(
    data: Measured, beyond: RowsByPose, moves: Array | None, losses: Array, weight: Array
) -> float:
    """Probability of a wander or of nothing against `restless` joints; 1 where nothing competes."""
    if moves is None or weight[:, 1:].sum() <= _NONE:
        return 1.0
    others = [unit_m(data) * restless(data, moves, time_s) for time_s in TIMES_S]
    theirs = np.array([_losses(beyond, one, np.asarray(SIZES)) for one in others])
    ours = special.logsumexp(_BEFORE - 0.5 * losses) - np.log(len(losses))
    joints = special.logsumexp(_BEFORE[1:] - 0.5 * theirs) - np.log(len(theirs)) + np.log(NAMELESS)
    return float(special.expit(ours - joints))


def _along_one_axis(beyond: RowsByPose, factor: Array, size: float) -> bool:
    """Whether one axis of F_b fits better than three equal ones, and as well as individual sizes.

    Tested by chi2(2) each; the sizes are optimised one after the other, twice.
    """

    def loss(one: Array) -> float:
        return float(_losses(beyond, factor * np.repeat(one, factor.shape[2] // 3), _ONE)[0])

    sizes = np.full(3, size)
    start = least = float(_losses(beyond, factor, np.array([size]))[0])
    for axis in (0, 1, 2) * 2:
        tried = np.tile(sizes, (1 + len(SIZES), 1))
        tried[:, axis] = np.append(0.0, SIZES)
        found = [loss(one) for one in tried]
        if min(found) < least:
            least, sizes = min(found), tried[int(np.argmin(found))]
    if special.chdtrc(2, max(start - least, 0.0)) >= alarms.COMPONENT:
        return False
    alone = loss(np.where(np.arange(3) == np.argmax(sizes), sizes, 0.0))
    return bool(special.chdtrc(2, max(alone - least, 0.0)) >= alarms.COMPONENT)


_ONE = np.ones(1)


def _losses(beyond: RowsByPose, factor: Array, sizes: Array) -> Array:
    """Minus twice the restricted log likelihood at some sizes."""
    w, y, X = beyond.rotated(factor.reshape(-1, factor.shape[2]))
    prior = np.diag(beyond.prior)
    out = []
    for a in sizes.tolist():
        D = 1 / (1 + a**2 * w)
        rows = X * np.sqrt(D)[:, None]  # its products are symmetric: half the work
        fixed = of_fixed(rows.T @ rows + prior, X.T @ (D * y))
        out.append(-np.sum(np.log(D)) + y @ (D * y) + fixed)
    return np.array(out)
