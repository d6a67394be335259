"""Distribution of the robots of a type: mean level and trend, and variation between specimens.

b_r = m + u_r,  u_r ~ N(0, blockdiag(D_level, D_trend)), with b_r estimated from its campaigns with
information N_r. These two stages are equivalent to one linear mixed model, as the first is normal
(Laird and Ware, Biometrics 38 (1982) 963). D is found by expectation maximisation with an inverse
Wishart prior, which stabilises it for few robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.fleet.wear.machine import Machine, products
from pipeline.fleet.wear.scatter import DayToDayVariances

_FEWEST = 3
"""Minimum number of robots of a type from which variation between specimens is estimated; below, it
is guessed."""

_LEVEL, _TREND = 0.10, 0.01
"""Guessed standard deviation between specimens of a compliance [1], and of its trend [1/year]."""

_ROUNDS = 40
"""Number of iterations of expectation maximisation."""


@dataclass(frozen=True, eq=False)
class _Told(Locked):
    """Information of a robot's campaigns on its present levels and trends b, shape (2 n,).

    Attributes:
        N: Information, shape (2 n, 2 n).
        g: N b, shape (2 n,).
    """

    N: Array
    g: Array


@dataclass(frozen=True, eq=False)
class RobotType(Locked):
    """The robots of one type.

    Attributes:
        robots: Number of robots.
        reference: Compliances to which levels are relative [SI], NaN if unknown, shape (n,).
        mean: Mean level, ln of compliance over reference, and mean trend [1/year], shape (2 n,).
        cov: Its covariance, shape (2 n, 2 n).
        between: Covariance between specimens, shape (2 n, 2 n).
        values: Level and trend of each robot, given its own campaigns and the others, (R, 2 n).
        covs: Their covariances, shape (R, 2 n, 2 n).
    """

    robots: int
    reference: Array
    mean: Array
    cov: Array
    between: Array
    values: Array
    covs: Array

    @property
    def guessed(self) -> bool:
        """Whether the robots are too few to estimate the variation between specimens."""
        return self.robots < _FEWEST


def hierarchy(machines: Sequence[Machine], scatter: DayToDayVariances) -> RobotType:
    """Mean, variation, and every robot's level and trend, given all robots of its type."""
    reference = _reference(machines)
    selected = [_told(one, scatter, reference) for one in machines]
    N, g = np.array([one.N for one in selected]), np.array([one.g for one in selected])
    n = len(reference)
    guess = np.append(np.full(n, _LEVEL**2), np.full(n, _TREND**2))
    D, worth, block = np.diag(guess), n + 2.0, np.kron(np.eye(2), np.ones((n, n)))
    for _ in range(_ROUNDS):
        mean, cov, values, covs = _given(N, g, D)
        off = values - mean
        square = np.einsum("ri,rj->ij", off, off) + covs.sum(axis=0)
        D = block * (square + worth * np.diag(guess)) / (len(selected) + worth)
    mean, cov, values, covs = _given(N, g, D)
    return RobotType(len(selected), reference, mean, cov, D, values, covs)


def _reference(machines: Sequence[Machine]) -> Array:
    """Geometric mean of the robots' compliances; NaN if unknown, shape (n,)."""
    known = np.array([np.where(m.reference > 0, m.reference, np.nan) for m in machines])
    count = np.isfinite(known).sum(axis=0)
    total = np.nansum(np.log(known), axis=0)
    return np.exp(np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0))


def _told(machine: Machine, scatter: DayToDayVariances, reference: Array) -> _Told:
    """Information on levels at the first campaign and on trends, earlier lives eliminated.

    To first order in both.
    """
    n, A = machine.joints, machine.nuisance
    mine = [_last_level(machine, j) for j in range(n)]
    others = [k for k in range(A.shape[-1]) if k not in mine]
    X = np.concatenate([A[..., mine], machine.trend, A[..., others]], axis=-1)
    WX = machine.weights(scatter.variance) @ X
    N, g = products(X, WX), np.einsum("kip,ki->p", WX, machine.y)
    keep, rest = slice(0, 2 * n), slice(2 * n, None)
    taken = linear.solve(N[rest, rest], N[rest, keep]) if others else np.zeros((0, 2 * n))
    N, g = N[keep, keep] - N[keep, rest] @ taken, g[keep] - g[rest] @ taken
    with np.errstate(invalid="ignore"):
        off = np.log(machine.reference / reference)
    shift = np.append(np.where(np.isfinite(off), off, 0.0), np.zeros(n))
    return _Told(N, g + N @ shift)


def _last_level(machine: Machine, joint: int) -> int:
    """Column of `nuisance` that is the level of a joint's present life.

    An earlier life has a level and a trend, the present one only a level.
    """
    return int(np.sum(2 * machine.last[:joint] + 1) + 2 * machine.last[joint])


def _given(N: Array, g: Array, D: Array) -> tuple[Array, Array, Array, Array]:
    """Mean and its covariance, and values of the robots and theirs, for a variation D."""
    inner = linear.inverse(D)
    P = linear.regular_inverse(N + inner)
    K = N - N @ P @ N
    total = linear.inverse(K.sum(axis=0))
    mean = total @ (g - np.einsum("rij,rj->ri", N @ P, g)).sum(axis=0)
    values = np.einsum("rij,rj->ri", P, g + inner @ mean)
    pull = P @ inner
    return mean, total, values, P + pull @ total @ np.swapaxes(pull, 1, 2)
