"""Model averaging: results where it is uncertain which causes are present.

A hypothesis is one set of causes, estimated together with the joint springs. With the probabilities
w_h of the hypotheses, value and covariance of the compliances are those of the mixture,

    x = sum_h w_h x_h,        V = sum_h w_h (V_h + (x_h - x)(x_h - x)'),

so that the uncertainty of the decision is part of the result (the DIA estimator of Teunissen,
Journal of Geodesy 92 (2018), for weights between zero and one).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, compared
from pipeline.machine import sides
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect
from pipeline.system import combinations
from pipeline.system.estimate import identifiable
from pipeline.system.system import Estimate, System

LEAST_PROBABILITY = 0.01
"""Minimum probability of a hypothesis in the average [1]."""

POSSIBLE = 0.05
"""Probability above which a hypothesis may be true, so that every interval includes its own [1];
also the maximum total probability of dropped hypotheses that leave a stiffness undetermined."""

_APART = 0.5
"""Change of a stiffness, in standard uncertainties, up to which it does not count as dependent on a
hypothesis [1]."""

_COVERED = (0.025, 0.975)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One set of causes that may be true, and the springs estimated together with them.

    Attributes:
        weight: Its probability; those of all hypotheses sum to one.
        effects: The causes, in the order of their parameters, which follow the springs.
        cell: Joint springs and causes, with the equilibrium that fits better.
        system: Springs and causes as one linear system.
        estimate: Its solution.
        instead: Identified causes that are replaced by rivals here: (cause, rival), labels.
        ratio: Remainder ratio, at least 1; the uncertainties include this factor (Birge, Physical
            Review 40 (1932) 207).
        sized: Its solution where the pulls may deviate from each cause's own law within its
            tolerance, but no other law of the same element takes a share; None where that is
            `estimate`.
    """

    weight: float
    effects: tuple[Effect, ...]
    cell: Cell
    system: System
    estimate: Estimate
    instead: tuple[tuple[str, str], ...] = ()
    ratio: float = 1.0
    sized: Estimate | None = None


@dataclass(frozen=True, eq=False)
class Springs(Locked):
    """The joints' compliances, averaged over all hypotheses [m/N] or [rad/(N m)].

    Attributes:
        value: Best estimate, shape (n,).
        cov: Covariance of `value`, shape (n, n); infinite on the diagonal where undetermined.
        low: Lower end of the 95 % interval, shape (n,).
        high: Upper end of the 95 % interval, shape (n,).
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


@dataclass(frozen=True, eq=False)
class _DeterminedMix(combinations.Mix):
    """A combination of compliances [m/N] or [rad/(N m)], averaged over all hypotheses.

    Attributes:
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
    """

    low: float
    high: float


@dataclass(frozen=True)
class Dependence:
    """A spring whose value depends on which of two causes is true.

    Attributes:
        spring: Index of the joint.
        cause: Label of the cause that holds if the first hypothesis is true.
        rival: Label of the cause in its place otherwise.
        lost: Whether the spring is undetermined if the rival is true.
    """

    spring: int
    cause: str
    rival: str
    lost: bool


def weighed(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The hypotheses that enter the average, weights normalised; the first always does.

    One that leaves a spring undetermined which the first determines would make the whole average
    undetermined; such ones are dropped, the least probable first, as long as their total
    probability does not exceed `POSSIBLE`.
    """
    first, *others = hypotheses
    counted, spent = [], 0.0
    for one in sorted(others, key=lambda one: compared(one.weight)):
        loses = np.any(_determined(first) & ~_determined(one))
        if loses and spent + one.weight <= POSSIBLE:
            spent += one.weight
        elif one.weight > LEAST_PROBABILITY:
            counted.append(one)
    kept = [first, *reversed(counted)]
    total = sum(one.weight for one in kept)
    if total == 0:
        return (replace(first, weight=1.0),)
    return tuple(replace(one, weight=one.weight / total) for one in kept)


def _springs(one: Hypothesis) -> int:
    """Number of joint springs, whose parameters precede those of the causes."""
    return one.cell.robot.n


def _determined(one: Hypothesis) -> Bools:
    """Joint springs that the hypothesis determines, shape (n,)."""
    return one.estimate.identifiable[: _springs(one)]


def average(weights: ArrayLike, values: Array, covs: Array) -> tuple[Array, Array]:
    """Mean and covariance of a mixture, by the equations at the top of this file.

    Args:
        weights: Weights of the components, sum one, shape (h,).
        values: Their values, shape (h, n).
        covs: Their covariances, shape (h, n, n); infinite on the diagonal where undetermined.

    Returns:
        Mean over the components that determine the entry (n,), and covariance (n, n), its diagonal
            infinite where any component leaves the entry undetermined.
    """
    if len(values) == 1:
        return values[0], covs[0]
    w = np.asarray(weights, dtype=float)
    lost = np.isinf(np.einsum("hii->hi", covs))
    share = np.where(lost, 0.0, w[:, None])
    share = np.where(lost.all(axis=0), w[:, None], share)
    # determined by components of zero weight only
    share = np.where(share.sum(axis=0) > 0, share, ~lost)
    mean = np.sum(share * values, axis=0) / share.sum(axis=0)
    off = values - mean
    finite = np.where(np.isfinite(covs), covs, 0.0)
    cov = np.einsum("h,hij->ij", w, finite + off[:, :, None] * off[:, None, :])
    unknown = np.flatnonzero(lost.any(axis=0))
    cov[unknown, unknown] = np.inf
    return mean, cov


def springs(hypotheses: Sequence[Hypothesis]) -> Springs:
    """The compliances averaged over all hypotheses, with intervals as of `_over`."""
    n = _springs(hypotheses[0])
    value, cov, low, high = _over(hypotheses, _parts(hypotheses, [np.arange(n)] * len(hypotheses)))
    sure = np.all([_determined(one) for one in hypotheses], axis=0)
    if len(hypotheses) > 1:
        typical = np.array([p.typical for p in hypotheses[0].estimate.parameters[:n]])
        sure &= identifiable(typical, value, np.sqrt(np.diag(cov)))
    return Springs(value, cov, low, high, sure)


def size(
    hypotheses: Sequence[Hypothesis], effect: Effect, k: int
) -> tuple[float, float, tuple[float, float]]:
    """One parameter of a cause, averaged over the hypotheses that contain it in this form.

    Hypotheses with another of its forms are excluded: the same symbol is a different quantity
    there.

    Returns:
        Value, standard uncertainty, infinite where undetermined, and 95 % interval, SI.
    """
    held = [
        replace(one, estimate=one.sized or one.estimate) for one in _holding(hypotheses, effect)
    ]
    name = effect.parameters[k].name
    names = [[parameter.name for parameter in one.estimate.parameters] for one in held]
    value, cov, low, high = _over(held, _parts(held, [np.array([e.index(name)]) for e in names]))
    return value.item(), float(np.sqrt(cov.item())), (low.item(), high.item())


def _holding(hypotheses: Sequence[Hypothesis], effect: Effect) -> list[Hypothesis]:
    """The hypotheses that contain a cause in this form, with normalised weights."""
    law = effect.label, effect.form
    held = [one for one in hypotheses if law in {(own.label, own.form) for own in one.effects}]
    total = sum(one.weight for one in held)
    return [replace(one, weight=one.weight / total if total else 1 / len(held)) for one in held]


def two_sided(one: Hypothesis) -> dict[int, int]:
    """Joints whose compliance depends on the sign of the torque, as in `sides.columns`."""
    return sides.columns(_springs(one), one.effects)


def each_way(hypotheses: Sequence[Hypothesis], joint: int, effect: Effect | None = None) -> Springs:
    """Compliance of a joint for positive and for negative torque.

    Args:
        hypotheses: The hypotheses; both values are equal in those without a two-sided law.
        joint: Index of the joint.
        effect: A two-sided law; if given, the average is over the hypotheses that contain it.
    """
    if effect is not None:
        hypotheses = _holding(hypotheses, effect)
    parts = []
    for one in hypotheses:
        T = np.zeros((2, len(one.estimate.value)))
        T[:, joint] = 1.0
        if joint in (both := two_sided(one)):
            T[:, both[joint]] = 1.0, -1.0
        parts.append(sides.taken(one.estimate.value, one.estimate.cov, T))
    value, cov, low, high = _over(hypotheses, parts)
    typical = np.full(2, hypotheses[0].estimate.parameters[joint].typical)
    return Springs(value, cov, low, high, identifiable(typical, value, np.sqrt(np.diag(cov))))


def at_pose(hypotheses: Sequence[Hypothesis], q: Array, force: Array) -> tuple[Hypothesis, ...]:
    """The hypotheses with each joint's compliance replaced by that at a pose under a force."""
    return tuple(_at_pose(one, q, force) for one in hypotheses)


def _at_pose(one: Hypothesis, q: Array, force: Array) -> Hypothesis:
    both = two_sided(one)
    if not both:
        return one
    signs = sides.at_pose(one.cell, one.estimate.value, q, force)
    T = np.eye(len(one.estimate.value))
    for joint, column in both.items():
        T[joint, column] = signs[joint]
    estimate = _taken(one.estimate, T, list(both))
    sized = None if one.sized is None else _taken(one.sized, T, list(both))
    system = replace(one.system, B=one.system.B @ (2 * np.eye(len(T)) - T))
    return replace(one, estimate=estimate, sized=sized, system=system)


def _taken(estimate: Estimate, T: Array, joints: Sequence[int]) -> Estimate:
    """The estimate of T x, with `identifiable` re-evaluated for the mixed entries `joints`."""
    value, cov = sides.taken(estimate.value, estimate.cov, T)
    typical = np.array([parameter.typical for parameter in estimate.parameters])
    known, sure = estimate.identifiable.copy(), identifiable(typical, value, np.sqrt(np.diag(cov)))
    known[joints] = sure[joints]
    return replace(estimate, value=value, cov=cov, identifiable=known)


def _parts(hypotheses: Sequence[Hypothesis], at: Sequence[Ints]) -> list[tuple[Array, Array]]:
    """Values and covariances of the parameters at indices `at` in each hypothesis."""
    each = [(one.estimate, k) for one, k in zip(hypotheses, at, strict=True)]
    return [(estimate.value[k], estimate.cov[np.ix_(k, k)]) for estimate, k in each]


def _over(
    hypotheses: Sequence[Hypothesis], parts: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array, Array, Array]:
    """Value (n,), covariance (n, n) and ends of the 95 % interval (n,) of n parameters.

    The interval is that of the mixture, from its quantiles at 2.5 and 97.5 %,

        sum_h w_h Phi((x - x_h) / s_h) = p,    s_h = t_h u(x_h) / 1.96,

    with t_h the quantile of hypothesis h, extended to include x_h +- t_h u(x_h) of every hypothesis
    above `POSSIBLE`, so that it holds whichever of them is true.

    Args:
        hypotheses: The hypotheses, weights sum to one.
        parts: Value (n,) and covariance (n, n) by each of them.
    """
    weights = np.array([one.weight for one in hypotheses])
    values, covs = (np.stack(each) for each in zip(*parts, strict=True))
    value, cov = average(weights, values, covs)
    low, high = _interval(hypotheses, values, np.sqrt(np.einsum("hii->hi", covs)))
    return value, cov, low, high


def _interval(hypotheses: Sequence[Hypothesis], values: Array, std: Array) -> tuple[Array, Array]:
    """Ends of the 95 % interval of n quantities, (n,) each; values and std have shape (h, n)."""
    weights = np.array([one.weight for one in hypotheses])
    quantile = np.array([one.estimate.quantile for one in hypotheses])[:, None]
    may_be = (weights > POSSIBLE) | (np.arange(len(weights)) == 0)
    low = np.min((values - quantile * std)[may_be], axis=0)
    high = np.max((values + quantile * std)[may_be], axis=0)
    if len(hypotheses) > 1:
        ends = [_quantile(p, weights, values, std * quantile / _NORMAL) for p in _COVERED]
        low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    return low, high


_NORMAL = float(special.ndtri(_COVERED[1]))


def _quantile(p: float, weights: Array, values: Array, std: Array) -> Array:
    """Quantile of a mixture of normal distributions for each entry, by bisection, shape (n,)."""
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


def _informations(hypotheses: Sequence[Hypothesis]) -> Array:
    """Information on the compliances in typical magnitudes by each hypothesis, shape (h, n, n)."""
    n = _springs(hypotheses[0])
    return np.stack([combinations.information(one.system, n, one.ratio) for one in hypotheses])


def information(hypotheses: Sequence[Hypothesis]) -> Array:
    """Information on the compliances in typical magnitudes over all hypotheses, shape (n, n).

    N = R (R' V R)^-1 R', with V the covariance of the mixture and R orthonormal combinations that
    every hypothesis determines; N_h itself for a single hypothesis.
    """
    n, first = _springs(hypotheses[0]), hypotheses[0].estimate
    each = _informations(hypotheses)
    if len(each) == 1:
        return each[0]
    typical = np.array([p.typical for p in first.parameters[:n]])
    values = np.stack([one.estimate.value[:n] for one in hypotheses]) / typical
    w = np.array([one.weight for one in hypotheses])
    off = values - w @ values
    covs = linear.inverse(each) + off[:, :, None] * off[:, None, :]
    free = [linear.complement(linear.determined(N)) for N in each]
    R = linear.complement(np.hstack(free))
    return np.asarray(R @ linear.solve(R.T @ np.einsum("h,hij->ij", w, covs) @ R, R.T))


def together(
    hypotheses: Sequence[Hypothesis], N: Array, alone: Bools
) -> tuple[_DeterminedMix, ...]:
    """Combinations of joints that are determined although the single joints are not.

    Args:
        hypotheses: The hypotheses.
        N: Their `information`.
        alone: Joints whose compliance is determined by itself, shape (n,).
    """
    n = len(N)
    values = np.stack([one.estimate.value[:n] for one in hypotheses])
    mean = np.array([one.weight for one in hypotheses]) @ values
    parameters = hypotheses[0].estimate.parameters[:n]
    found = combinations.mixes(N, parameters, mean, alone)
    if not found:
        return ()
    typical = np.array([p.typical for p in parameters])
    W = np.zeros((len(found), n))
    for row, mix in zip(W, found, strict=True):
        row[mix.of] = mix.weights
    covs = linear.inverse(_informations(hypotheses)) * np.outer(typical, typical)
    std = np.sqrt(np.einsum("ci,hij,cj->hc", W, covs, W))
    ends = zip(*_interval(hypotheses, values @ W.T, std), strict=True)
    return tuple(
        _DeterminedMix(**vars(mix), low=float(low), high=float(high))
        for mix, (low, high) in zip(found, ends, strict=True)
    )


def dependences(hypotheses: Sequence[Hypothesis]) -> tuple[Dependence, ...]:
    """Springs that another hypothesis changes or leaves undetermined, and the causes concerned."""
    first, *others = hypotheses
    n = _springs(first)
    own, value = first.estimate.std[:n], first.estimate.value[:n]
    mine, out = _determined(first), []
    for one in others:
        theirs, std = _determined(one), one.estimate.std[:n]
        gone = np.abs(one.estimate.value[:n] - value)
        with np.errstate(invalid="ignore"):
            differs = (gone > _APART * own) | (std > (1 + _APART) * own)
        moved = mine & theirs & differs & (one.weight > POSSIBLE)
        for cause, rival in one.instead:
            out += [Dependence(int(j), cause, rival, False) for j in np.flatnonzero(moved)]
            out += [Dependence(int(j), cause, rival, True) for j in np.flatnonzero(mine & ~theirs)]
            out += [Dependence(int(j), rival, cause, True) for j in np.flatnonzero(theirs & ~mine)]
    return tuple(out)
