"""The slow wander of the instrument: common to all targets, the same in three axes, in time.

w(t) is an Ornstein-Uhlenbeck process of unit variance, E[w(t) w(t')] = rho(t - t') =
exp(-|t - t'| / tau). A displacement, read at t and measured from zeros read at z_1 .. z_n, feels
w(t) - mean w(z_k), so that within a pose

    K_ij = rho(t_i - t_j) - mean_k rho(t_i - z_k) - mean_k rho(t_j - z_k) + mean_kl rho(z_k - z_l);

poses share too little of it to matter. How large it is nobody knows: V has its posterior mean over
sizes and times (Uhlenbeck and Ornstein, Physical Review 36, 1930; Kermarrec et al., Sensors 19,
2019, for noise of laser instruments that is correlated in time).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.assemble import by_axis
from pipeline.system.beyond import Beyond

TIMES_S = (300.0, 1200.0, 4800.0)
"""Correlation times that are tried [s]: from the length of a pose to that of a campaign; longer
ones are a random walk within a pose."""

SIZES = (0.2, 0.35, 0.6, 1.0, 1.8, 3.2, 6.0, 12.0)
"""What the wander adds to a displacement, rms, over the standard uncertainty of a reading per
axis."""

_TINY = 1e-300

_NONE = 0.5
"""Probability of no wander before the data."""

_BEFORE = np.log(np.append(_NONE, np.full(len(SIZES), (1 - _NONE) / len(SIZES))) / len(TIMES_S))
"""That of no wander and of each size, at one correlation time; its logarithm."""


@dataclass(frozen=True, eq=False)
class Wander(Locked):
    """What the rows show of a wander.

    Attributes:
        factor: F_p with F_p F_p' its covariance in the pulls of each pose, all sizes and times
            together, by pull [m], shape (m, k).
        size: Standard deviation that it adds to a displacement, mean over the posterior [m].
        std: Its standard uncertainty [m].
        time_s: Likeliest correlation time [s].
        p_value: Probability of so much by chance.
        probability: That there is any.
        process: Variance of the process itself for each of `TIMES_S`, shape (t,) [m^2].
        unit: Standard uncertainty of a reading per axis, root mean square [m].
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
        factor, process = np.zeros((len(data.pulls), 1)), np.zeros(len(TIMES_S))
        return cls(factor, 0.0, 0.0, TIMES_S[0], 1.0, 0.0, process, _unit(data))

    def between(self, times: Array) -> Array:
        """Its covariance between times [s], shape (n, n) [m^2], each axis alike."""
        apart = np.abs(times[:, None] - times)
        return np.asarray(
            sum(v * np.exp(-apart / tau) for v, tau in zip(self.process, TIMES_S, strict=True))
        )


def _unit(data: Measured) -> float:
    return float(np.sqrt(np.einsum("dii->", data.loaded_cov) / (3 * len(data.pull))))


def kernel(data: Measured, time_s: float) -> tuple[Array, float]:
    """K of all poses as factors by pull with mean square one, shape (m, k), and what it was.

    Zero without times.
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
    mean = max(float(np.mean(np.sum(out**2, axis=1))), _TINY)
    return out / np.sqrt(mean), mean


def restless(data: Measured, moves: Array, time_s: float) -> Array:
    """What joints do whose compliance is another in each pull, rows of mean square one, (d, 3, j).

    Every compliance varies by a like part of itself, alike within some time: K of a pose is
    sum_j b_j b_j' rho, with b_j what joint j adds to a row under its pull. A wander moves all
    targets by as much under any pull; this follows the torques.

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
    mean = max(float(np.mean(np.sum(out**2, axis=2))), _TINY)
    return np.asarray(out / np.sqrt(mean))


def wander(data: Measured, beyond: Beyond, told: bool = True, moves: Array | None = None) -> Wander:
    """How much of it the rows show, by restricted likelihood over `SIZES` and `TIMES_S`.

    With W = L^-1 K L^-T of each pose, rotated to diag(w), and a the size:

        L(a) = sum log(1 + a^2 w) + log|N| + sum y^2 / (1 + a^2 w) - g' N^-1 g,

    N = X' D X + prior, g = X' D y, D = diag(1 / (1 + a^2 w)). p is that of the likelihood ratio
    with two degrees of freedom, half of it as the size is at its bound under the null.

    What wanders along one axis only is no instrument, and none is found. Joints that are `restless`
    compete with it, all sizes and times together, at the odds of what has no name: what is theirs
    of the probability is taken from the wander's.

    Args:
        data: The measurements.
        beyond: Their rows beside a model.
        told: Whether there are enough of them; else nothing is looked for.
        moves: Columns of the springs in their typical sizes, shape (M, n); nothing competes when
            not given.
    """
    unit = _unit(data)
    kernels = [kernel(data, time_s) for time_s in TIMES_S]
    factors = np.stack([factor for factor, _ in kernels])
    nothing = Wander(factors[0] * 0.0, 0.0, 0.0, TIMES_S[0], 1.0, 0.0, np.zeros(len(TIMES_S)), unit)
    if not (told and factors.any()):
        return nothing
    by_row = [unit * by_axis(one[data.pull] * data.shifts[:, None]) for one in factors]
    a = np.append(0.0, SIZES)
    losses = np.array([_losses(beyond, one, a) for one in by_row])
    weight, p = _likely(losses)
    best = int(np.argmax(weight[:, 1:].max(axis=1)))
    if p < alarms.COMPONENT and _along_one_axis(beyond, by_row[best], a[weight[best].argmax()]):
        return nothing
    if moves is not None and weight[:, 1:].sum() > _NONE:
        weight = weight * _not_joints(data, beyond, moves, losses)
    of_time = weight @ a**2
    mean = float((weight * a).sum())
    return Wander(
        factor=unit
        * np.concatenate(
            [np.sqrt(w) * one for w, one in zip(of_time, factors, strict=True)], axis=1
        ),
        size=unit * float(np.sqrt(of_time.sum())),
        std=unit * float(np.sqrt(max((weight * a**2).sum() - mean**2, 0.0))),
        time_s=TIMES_S[best],
        p_value=p,
        probability=float(weight[:, 1:].sum()),
        process=unit**2 * of_time / np.array([size for _, size in kernels]),
        unit=unit,
    )


def _likely(losses: Array) -> tuple[Array, float]:
    """Posterior weights of times and sizes, none among these, and p of the likelihood ratio.

    Args:
        losses: -2 L of each time and of no wander and `SIZES`, shape (times, 1 + sizes).
    """
    ratio = np.maximum(losses[:, 0, None] - losses, -700.0)  # 2 (L_a - L_0)
    weight = np.asarray(special.softmax(0.5 * ratio + _BEFORE))
    return weight, 0.5 * float(special.chdtrc(2, max(float(ratio.max()), 0.0)))


def _not_joints(data: Measured, beyond: Beyond, moves: Array, losses: Array) -> float:
    """Probability of a wander or of nothing against joints that are `restless`."""
    others = [_unit(data) * restless(data, moves, time_s) for time_s in TIMES_S]
    theirs = np.array([_losses(beyond, one, np.asarray(SIZES)) for one in others])
    ours = special.logsumexp(_BEFORE - 0.5 * losses)
    joints = special.logsumexp(_BEFORE[1:] - 0.5 * theirs) + np.log(NAMELESS)
    return float(special.expit(ours - joints))


def _along_one_axis(beyond: Beyond, factor: Array, size: float) -> bool:
    """Whether sizes of their own along the axes of F_b fit better than one, by chi2(2).

    Each in turn is put where the likelihood is largest, twice.
    """
    sizes = np.full(3, size)
    start = least = float(_losses(beyond, factor, np.array([size]))[0])
    for axis in (0, 1, 2) * 2:
        tried = np.tile(sizes, (1 + len(SIZES), 1))
        tried[:, axis] = np.append(0.0, SIZES)
        found = [
            float(_losses(beyond, factor * np.resize(one, factor.shape[2]), _ONE)[0])
            for one in tried
        ]
        if min(found) < least:
            least, sizes = min(found), tried[int(np.argmin(found))]
    return bool(special.chdtrc(2, max(start - least, 0.0)) < alarms.COMPONENT)


_ONE = np.ones(1)


def _losses(beyond: Beyond, factor: Array, sizes: Array) -> Array:
    """Minus twice the restricted log likelihood at some sizes."""
    blocks = beyond.white.blocks
    A = beyond.white.inverse @ blocks.padded(factor.reshape(-1, factor.shape[2]))
    w, y, X = beyond.rotated(A @ np.swapaxes(A, 1, 2))
    prior = np.diag(beyond.prior)
    out = []
    for a in sizes.tolist():
        D = 1 / (1 + a**2 * w)
        N, g = (X.T * D) @ X + prior, (X.T * D) @ y
        fixed = linear.solve(N, g)
        out.append(-np.sum(np.log(D)) + linear.log_det(N) + y @ (D * y) - g @ fixed)
    return np.array(out)
