"""What is stated where it is uncertain which causes are true: the average over the hypotheses.

A hypothesis is one set of causes, estimated together with the joint springs. With the weights w_h
that the diagnosis gives them, value and covariance of the compliances are those of the mixture,

    x = sum_h w_h x_h,        V = sum_h w_h (V_h + (x_h - x)(x_h - x)'),

so that the uncertainty of the decision stays in the answer (the DIA estimator of Teunissen,
Journal of Geodesy 92 (2018), for weights between zero and one).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from pipeline.effects import Effect
from pipeline.results import Array, Bools, Estimate, Locked, System
from pipeline.stages.estimate import identifiable

LEAST = 0.01
"""A hypothesis less probable than this has no part in the average."""

LIKELY = 0.05
"""A hypothesis above this probability may be true: every interval holds its own, and what it
leaves undetermined is undetermined."""

APART = 0.5
"""A hypothesis that moves a stiffness by fewer standard uncertainties than this leaves it alone."""

COVERED = (0.025, 0.975)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One set of causes that may be true, and the springs estimated together with them.

    Attributes:
        weight: Its probability; those of all hypotheses sum to one.
        effects: The causes, in the order of their parameters behind the springs.
        system: Springs and causes as one linear system.
        estimate: Its solution.
        instead: Each identified cause whose place another one has taken: (cause, rival), labels.
    """

    weight: float
    effects: tuple[Effect, ...]
    system: System
    estimate: Estimate
    instead: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Springs(Locked):
    """The joints' compliances over all hypotheses [m/N] or [rad/(N m)].

    Attributes:
        value: Best estimate, shape (n,).
        cov: Covariance of `value`, shape (n, n); infinite on the diagonal where undetermined.
        low: Lower end of the 95 % interval, shape (n,).
        high: Upper end of it, shape (n,).
        identifiable: True where the data determine the compliance, shape (n,).
    """

    value: Array
    cov: Array
    low: Array
    high: Array
    identifiable: Bools

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (n,)."""
        return np.sqrt(np.diag(self.cov))


@dataclass(frozen=True)
class Dependence:
    """A spring whose value depends on which of two causes is true.

    Attributes:
        spring: Index of the joint.
        cause: Label of the identified cause.
        rival: Label of what could stand in its place.
        lost: With the rival nothing determines the spring.
    """

    spring: int
    cause: str
    rival: str
    lost: bool


def weighed(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The hypotheses that count, with weights that sum to one; the first always does.

    One of at most `LIKELY` that leaves a spring undetermined which the first determines would make
    the whole average undetermined; it is left out.
    """
    first, *others = hypotheses
    n = _springs(first)
    known = np.isfinite(first.estimate.std[:n])
    counted = [first]
    for one in others:
        lost = bool(np.any(known & np.isinf(one.estimate.std[:n])))
        if one.weight > (LIKELY if lost else LEAST):
            counted.append(one)
    total = sum(one.weight for one in counted)
    return tuple(replace(one, weight=one.weight / total) for one in counted)


def _springs(one: Hypothesis) -> int:
    """Number of joint springs: what stands before the causes' own parameters."""
    return len(one.estimate.value) - sum(len(effect.parameters) for effect in one.effects)


def average(weights: ArrayLike, values: Array, covs: Array) -> tuple[Array, Array]:
    """Mean and covariance of a mixture.

    Args:
        weights: Of the components, sum one, shape (h,).
        values: Their values, shape (h, n).
        covs: Their covariances, shape (h, n, n); infinite on the diagonal where undetermined.

    Returns:
        Mean over those components that determine the entry (n,), covariance (n, n) with infinite
        variance where any component does not.
    """
    if len(values) == 1:
        return values[0], covs[0]
    w = np.asarray(weights, dtype=float)
    lost = np.isinf(np.einsum("hii->hi", covs))
    share = np.where(lost, 0.0, w[:, None])
    share = np.where(lost.all(axis=0), w[:, None], share)
    mean = np.sum(share * values, axis=0) / share.sum(axis=0)
    off = values - mean
    finite = np.where(np.isfinite(covs), covs, 0.0)
    cov = np.einsum("h,hij->ij", w, finite + off[:, :, None] * off[:, None, :])
    unknown = np.flatnonzero(lost.any(axis=0))
    cov[unknown, unknown] = np.inf
    return mean, cov


def springs(hypotheses: Sequence[Hypothesis]) -> Springs:
    """The compliances over all hypotheses.

    The 95 % interval is that of the mixture, widened until it holds the interval of every
    hypothesis above `LIKELY`: whichever of them is true.
    """
    n = _springs(hypotheses[0])
    weights = np.array([one.weight for one in hypotheses])
    values = np.stack([one.estimate.value[:n] for one in hypotheses])
    covs = np.stack([one.estimate.cov[:n, :n] for one in hypotheses])
    value, cov = average(weights, values, covs)
    std = np.sqrt(np.einsum("hii->hi", covs))
    quantile = np.array([one.estimate.quantile for one in hypotheses])[:, None]
    may_be = (weights > LIKELY) | (np.arange(len(weights)) == 0)
    low = np.min((values - quantile * std)[may_be], axis=0)
    high = np.max((values + quantile * std)[may_be], axis=0)
    if len(hypotheses) > 1:
        ends = [_quantile(p, weights, values, std * quantile / NORMAL) for p in COVERED]
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    sure = np.all([one.estimate.identifiable[:n] for one in _first_and_likely(hypotheses)], axis=0)
    if len(hypotheses) > 1:
        typical = np.array([p.typical for p in hypotheses[0].estimate.parameters[:n]])
        sure &= identifiable(typical, value, np.sqrt(np.diag(cov)))
    return Springs(value, cov, low, high, sure)


NORMAL = float(special.ndtri(COVERED[1]))


def _first_and_likely(hypotheses: Sequence[Hypothesis]) -> Iterable[Hypothesis]:
    return (one for k, one in enumerate(hypotheses) if k == 0 or one.weight > LIKELY)


def _quantile(p: float, weights: Array, values: Array, std: Array) -> Array:
    """Quantile of a mixture of normal distributions, entry by entry, by bisection, shape (n,)."""
    known = np.isfinite(std)
    spread = np.where(known, std, 0.0)
    share = np.where(known, weights[:, None], 0.0)
    share = share / np.maximum(share.sum(axis=0), 1e-300)
    low = np.min(values - 10 * spread, axis=0)
    high = np.max(values + 10 * spread, axis=0)
    for _ in range(60):
        middle = (low + high) / 2
        z = (middle - values) / np.maximum(spread, 1e-300)
        below = np.sum(share * special.ndtr(z), axis=0) < p
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(known.any(axis=0), (low + high) / 2, np.nan_to_num(values[0]))


def dependences(hypotheses: Sequence[Hypothesis]) -> tuple[Dependence, ...]:
    """Springs that a hypothesis above `LIKELY` moves or loses, with what stands where."""
    first, *others = hypotheses
    n = _springs(first)
    own, value = first.estimate.std[:n], first.estimate.value[:n]
    out = []
    for one in others:
        if one.weight <= LIKELY:
            continue
        std = one.estimate.std[:n]
        gone = np.abs(one.estimate.value[:n] - value)
        with np.errstate(invalid="ignore"):
            differs = np.isfinite(own) & ((gone > APART * own) | (std > (1 + APART) * own))
        out += [
            Dependence(int(j), cause, rival, bool(np.isinf(std[j])))
            for j in np.flatnonzero(differs)
            for cause, rival in one.instead
        ]
    return tuple(out)
