"""Day-to-day scatter of the stiffnesses, beyond the uncertainty of each campaign.

y_i = A_i a + e_i + d_i,  e_i ~ N(0, C_i) as the campaign states,  d_i ~ N(0, diag(v) + v_c 1 1').

v_j, of each joint, and v_c, common to all joints (temperature, the scale), maximise the restricted
likelihood (Patterson and Thompson, Biometrika 58 (1971) 545) times their priors, for all robots of
a type together, with levels and trends of every robot estimated as well. Each v_j varies about a
value of the type, and that value about the stated one. Joints with a sudden change are left out in
a second pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.fleet.wear.elimination import eliminated, gaps, steps
from pipeline.fleet.wear.machine import Machine, products

STATED = 0.01
"""Day-to-day scatter of a stiffness if campaigns cannot determine it [1]."""

_COMMON = 0.003
"""Scatter common to all joints [1], likewise."""

_WORTH, _WORTH_TYPE, _WORTH_COMMON = 20.0, 10.0, 4.0
"""Degrees of freedom of the priors: of a joint about its type, of the type about the stated value,
and of the common scatter."""

_FEWEST = 3
"""Minimum number of campaigns of a robot from which scatter can be separated from a trend."""

_ROUNDS, _SETTLED = 60, 1e-3

_STEPPED = 3.5
"""Size of a step between two campaigns, in standard deviations, from which a joint is left out of
the scatter [1]."""


@dataclass(frozen=True, eq=False)
class DayToDayVariances(Locked):
    """Variances from day to day.

    Attributes:
        variance: Of each joint's relative compliance, then the common one of all joints, (n + 1,).
        uncertainty: Variance of each of these, shape (n + 1,).
        campaigns: Number of campaigns beyond those that levels and trends require; if it is zero,
            the variances are the stated ones.
    """

    variance: Array
    uncertainty: Array
    campaigns: int

    @property
    def std(self) -> Array:
        """Standard deviations [1], shape (n + 1,)."""
        return np.asarray(np.sqrt(self.variance))


def scatter(machines: Sequence[Machine], stated: float = STATED) -> DayToDayVariances:
    """Estimate the scatter of robots of one type by multiplicative, monotonic iterations.

    v <- v (sum of (P y)^2 over sum of P)^(1/2), P = V^-1 - V^-1 X (X' V^-1 X)^-1 X' V^-1, with the
    priors in both sums (Zhou, Hu, Qiao, Cho and Zhou, J. Comput. Graph. Stat. 28 (2019) 350).

    Args:
        machines: At least one, all with the same number of joints.
        stated: Expected day-to-day scatter of a joint [1].
    """
    telling = [one for one in machines if len(one.t) >= _FEWEST]
    n = machines[0].joints
    v = _settled(telling, np.append(np.full(n, stated**2), _COMMON**2), stated)
    steady = [_without_steps(one, v) for one in telling]
    v = _settled(steady, v, stated)
    information = (_sums(steady, v)[2] + _worth(n) / v**2) / 2
    free = sum(len(one.t) - _FEWEST + 1 for one in telling)
    return DayToDayVariances(v, 1 / information, free)


def _worth(n: int) -> Array:
    return np.append(np.full(n, _WORTH), _WORTH_COMMON)


def _settled(machines: Sequence[Machine], v: Array, stated: float) -> Array:
    """Variances that maximise the objective, starting from a guess."""
    n = len(v) - 1
    worth = _worth(n)
    for _ in range(_ROUNDS):
        centre = np.append(np.full(n, _centre(v[:n], stated**2)), _COMMON**2)
        square, size, _ = _sums(machines, v)
        new = v * np.sqrt((square + worth * centre / v**2) / (size + worth / v))
        moved, v = np.abs(np.log(new / v)).max(), new
        if moved < _SETTLED:
            break
    return v


def _without_steps(machine: Machine, v: Array) -> Machine:
    """The robot without the joints that changed suddenly, which is not day-to-day scatter."""
    after = gaps(machine, len(machine.t))
    found = eliminated(machine, machine.weights(v), steps(machine, after))
    z = np.where(found.told, found.g / np.sqrt(np.where(found.told, np.diag(found.N), 1.0)), 0.0)
    stepped = np.abs(z.reshape(len(after), machine.joints)).max(axis=0, initial=0.0) > _STEPPED
    return replace(machine, seen=machine.seen & ~stepped) if stepped.any() else machine


def _centre(v: Array, stated: float) -> float:
    """Centre of the variances of the joints: v_j ~ centre nu / chi2(nu), likewise itself."""
    n = len(v)
    return float((_WORTH * n + _WORTH_TYPE) / (np.sum(_WORTH / v) + _WORTH_TYPE / stated))


def _sums(machines: Sequence[Machine], v: Array) -> tuple[Array, Array, Array]:
    """For each variance y'P D P y, tr P D, and tr (P D)^2 within campaigns, shape (n + 1,) each."""
    out = np.zeros((3, len(v)))
    for one in machines:
        X = np.concatenate([one.nuisance, one.trend], axis=-1)
        W = one.weights(v)
        WX = W @ X
        cov = linear.regular_inverse(products(X, WX)[None])[0]
        Wy = np.einsum("kij,kj->ki", W, one.y)
        Py = Wy - WX @ (cov @ np.einsum("kip,ki->p", X, Wy))
        P = W - WX @ cov @ np.swapaxes(WX, 1, 2)
        own, common = np.einsum("kii->ki", P), P.sum(axis=(1, 2))
        out += [
            np.append((Py**2).sum(axis=0), (Py.sum(axis=1) ** 2).sum()),
            np.append(own.sum(axis=0), common.sum()),
            np.append((own**2).sum(axis=0), (common**2).sum()),
        ]
    return out[0], out[1], out[2]
