"""What a stiffness differs by from day to day, beyond the uncertainty of its campaign.

y_i = A_i a + e_i + d_i,  e_i ~ N(0, C_i) as the campaign states,  d_i ~ N(0, diag(v) + v_c 1 1').

v_j, of each joint, and v_c, which all joints have in common (temperature, the scale), are where the
restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545) times their priors is
largest, all robots of a type together, levels and trends of every robot estimated along. Each v_j
varies about a value of the type, and that about the stated one. Joints that have changed at once
are left out the second time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.fleet.wear.beside import beside, gaps, steps
from pipeline.fleet.wear.machine import Machine, products

STATED = 0.01
"""Day-to-day scatter of a stiffness where campaigns do not tell it [1]."""

_COMMON = 0.003
"""The same of all joints alike [1]."""

_WORTH, _WORTH_TYPE, _WORTH_COMMON = 20.0, 10.0, 4.0
"""Degrees of freedom that prior values count for: a joint's about its type's, that about the stated
one, and that of all joints alike."""

FEWEST = 3
"""Campaigns of a robot from which they tell the scatter beside a trend."""

_ROUNDS, _SETTLED = 60, 1e-3

_STEPPED = 3.5
"""A joint that changes so many standard deviations between two campaigns tells no scatter [1]."""


@dataclass(frozen=True, eq=False)
class Scatter(Locked):
    """Variances from day to day.

    Attributes:
        variance: Of each joint's relative compliance, then what all have in common, (n + 1,).
        uncertainty: Variance of each of these, shape (n + 1,).
        campaigns: How many the robots have beyond what levels and trends take up; without any
            the variances are the stated ones.
    """

    variance: Array
    uncertainty: Array
    campaigns: int

    @property
    def std(self) -> Array:
        """Standard deviations [1], shape (n + 1,)."""
        return np.asarray(np.sqrt(self.variance))


def scatter(machines: Sequence[Machine], stated: float = STATED) -> Scatter:
    """Of the robots of one type, by multiplicative steps that never lower the objective.

    v <- v (sum of (P y)^2 over sum of P)^(1/2), P = V^-1 - V^-1 X (X' V^-1 X)^-1 X' V^-1, with the
    priors in both sums (Zhou, Hu, Qiao, Cho and Zhou, J. Comput. Graph. Stat. 28 (2019) 350).

    Args:
        machines: At least one, all of as many joints.
        stated: Expected day-to-day scatter of a joint [1].
    """
    telling = [one for one in machines if len(one.t) >= FEWEST]
    n = machines[0].joints
    v = _settled(telling, np.append(np.full(n, stated**2), _COMMON**2), stated)
    steady = [_without_steps(one, v) for one in telling]
    v = _settled(steady, v, stated)
    information = (_sums(steady, v)[2] + _worth(n) / v**2) / 2
    free = sum(len(one.t) - FEWEST + 1 for one in telling)
    return Scatter(v, 1 / information, free)


def _worth(n: int) -> Array:
    return np.append(np.full(n, _WORTH), _WORTH_COMMON)


def _settled(machines: Sequence[Machine], v: Array, stated: float) -> Array:
    """The variances where the objective is largest, from a guess."""
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
    """A robot without the joints that have rather changed at once: that is no scatter of days."""
    after = gaps(machine, len(machine.t))
    found = beside(machine, machine.weights(v), steps(machine, after))
    z = np.where(found.told, found.g / np.sqrt(np.where(found.told, np.diag(found.N), 1.0)), 0.0)
    stepped = np.abs(z.reshape(len(after), machine.joints)).max(axis=0, initial=0.0) > _STEPPED
    return replace(machine, seen=machine.seen & ~stepped) if stepped.any() else machine


def _centre(v: Array, stated: float) -> float:
    """What the variances of the joints vary about: v_j ~ centre nu / chi2(nu), and so its own."""
    n = len(v)
    return float((_WORTH * n + _WORTH_TYPE) / (np.sum(_WORTH / v) + _WORTH_TYPE / stated))


def _sums(machines: Sequence[Machine], v: Array) -> tuple[Array, Array, Array]:
    """Of each variance y'P D P y, tr P D, and tr (P D)^2 within campaigns, shape (n + 1,) each."""
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
