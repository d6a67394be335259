"""Stiffnesses that depend on which cause is true: twins move a tool alike beside others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from pipeline.results import Array, Estimate
from pipeline.stages.estimate import identifiable

LIKELY = 0.05
"""A rival above this probability may be the true cause: what is stated must hold with it too."""

APART = 0.5
"""A rival that moves a stiffness by less than this many standard uncertainties leaves it alone."""


@dataclass(frozen=True)
class Instead:
    """The springs with a rival in the place of a named cause.

    Attributes:
        cause: Label of the named cause.
        rival: Label of what could stand there.
        value: Compliances of the joints [m/N] or [rad/(N m)], shape (n,).
        std: Their standard uncertainties, infinite where undetermined, shape (n,).
    """

    cause: str
    rival: str
    value: Array
    std: Array


@dataclass(frozen=True)
class Doubt:
    """A spring whose size depends on which of two causes is true.

    Attributes:
        spring: Index of the joint.
        cause: Label of the named cause.
        rival: Label of what could stand there.
        lost: With the rival nothing determines the spring.
    """

    spring: int
    cause: str
    rival: str
    lost: bool


def hedged(estimate: Estimate, rivals: Iterable[Instead]) -> tuple[Estimate, tuple[Doubt, ...]]:
    """An estimate whose intervals hold whichever cause is true.

    The values stay those of the named causes. An interval is made as wide as it takes to hold the
    rival's; a spring that is undetermined beside a rival is undetermined.

    Args:
        estimate: Springs first, then the named causes.
        rivals: The springs with each likely rival instead.
    """
    std, doubts = estimate.std.copy(), []
    for one in rivals:
        n = len(one.value)
        own = estimate.std[:n]
        gone = np.abs(one.value - estimate.value[:n])
        reach = gone / estimate.quantile + one.std
        with np.errstate(invalid="ignore"):
            differs = np.isfinite(own) & ((gone > APART * own) | (one.std > (1 + APART) * own))
        doubts += [
            Doubt(int(j), one.cause, one.rival, bool(np.isinf(one.std[j])))
            for j in np.flatnonzero(differs)
        ]
        std[:n] = np.where(differs, np.maximum(std[:n], reach), std[:n])
    return _widened(estimate, std), tuple(doubts)


def _widened(estimate: Estimate, std: Array) -> Estimate:
    """The estimate with larger standard uncertainties (k,), correlated as with the named causes."""
    cov = estimate.cov.copy()
    more = std > estimate.std
    cov[more, more] = std[more] ** 2
    typical = np.array([p.typical for p in estimate.parameters])
    known = identifiable(typical, estimate.value, std)
    return replace(estimate, cov=cov, identifiable=estimate.identifiable & known)
