"""Magnitudes of the identified causes, with intervals that allow for the model's nonlinearity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Parameter
from pipeline.base.tails import CHI2_95, NORMAL_95
from pipeline.diagnosis.average import Hypothesis, each_way, size
from pipeline.diagnosis.cause_search import SearchTask, of_model
from pipeline.diagnosis.facts import EffectSize
from pipeline.machine.cell import predict
from pipeline.machine.effect import Effect, Elastic
from pipeline.system.elimination import coefficients, eliminate
from pipeline.system.evidence import ROUNDING
from pipeline.system.whitened import Whitened


def amplitudes(task: SearchTask, view: Whitened) -> list[tuple[EffectSize, ...]]:
    """Magnitudes of the accepted causes, estimated together with the springs.

    z = N^+ g in typical magnitudes, N = X'X and g = X'y over the whitened columns of the base;
    u(z_k) = s sqrt((N^+)_kk), s^2 = rest / dof, infinite where N does not determine z_k, and the 95
    % interval is z +- t(0.975, dof) u(z); for causes that are not elastic it is that of `_profile`.
    s^2 is at least `ROUNDING`, and infinite without degrees of freedom.
    """
    base = view.base
    value = coefficients(view.M, base)
    dof = view.dof(base)
    rest = float(eliminate(view.M, base)[-1, -1])
    variance = np.diag(linear.covariance(view.M[np.ix_(base, base)]))
    scatter = max(rest / dof, ROUNDING) if dof > 0 else np.inf
    std = np.sqrt(variance * scatter)
    quantile = float(special.stdtrit(max(dof, 1), 0.975))
    out = []
    for suspect in view.model.accepted:
        at = [int(np.flatnonzero(base == c)[0]) for c in view.columns([suspect])]
        effect = task.suspects[suspect]
        sizes = []
        for k, parameter in zip(at, effect.parameters, strict=True):
            here = value[k] * parameter.typical
            mine = std[k] * parameter.typical
            interval = (here - quantile * mine, here + quantile * mine)
            if not isinstance(effect, Elastic) and np.isfinite(mine):
                interval = _profile(view, suspect, parameter, here, mine, scatter)
            sizes.append(EffectSize(parameter, float(here), float(mine), interval))
        out.append(tuple(sizes))
    return out


def averaged(
    task: SearchTask, view: Whitened, sets: Sequence[Hypothesis]
) -> list[tuple[EffectSize, ...]]:
    """Magnitudes averaged over the hypotheses that contain the cause, as springs (`average.size`).

    Their covariance includes what that of the springs includes: the stated noise, the deviation of
    each pull from the laws, and the remainder ratio. For a cause that is not elastic the nonlinear
    likelihood makes the interval asymmetric; its ends are stretched by the same factors as in
    `_profile`.

    Args:
        task: What stays the same during the search.
        view: The campaign whitened at the accepted causes.
        sets: Hypotheses, the accepted causes first.
    """
    out = []
    for suspect, sizes in zip(view.model.accepted, amplitudes(task, view), strict=True):
        effect = task.suspects[suspect]
        over = [EffectSize(one.parameter, *size(sets, effect, k)) for k, one in enumerate(sizes)]
        if not isinstance(effect, Elastic):
            over = [_bent(one, mixed) for one, mixed in zip(sizes, over, strict=True)]
        out.append(tuple(over))
    return out


def both_ways(effect: Effect, sets: Sequence[Hypothesis]) -> tuple[EffectSize, ...]:
    """Compliance of a joint for positive and for negative torque; empty for effects without sides.

    Args:
        effect: An accepted cause.
        sets: Hypotheses, the accepted causes first.
    """
    if not isinstance(effect, Elastic) or effect.side is None:
        return ()
    joint = effect.carrier[0] - 1
    found, own = each_way(sets, joint, effect), sets[0].estimate.parameters[joint]
    ends, out = np.stack([found.value, found.std, found.low, found.high], axis=1).tolist(), []
    for way, (value, std, low, high) in zip(_WAYS, ends, strict=True):
        meaning = f"compliance of {{joint}} under a torque of {way} sign"
        parameter = replace(own, name=f"c_joint{joint + 1}_{way}", meaning=meaning)
        out.append(EffectSize(parameter, value, std, (low, high)))
    return tuple(out)


_WAYS = ("positive", "negative")
"""Names for the sign of the torque on a joint, in the order of `average.each_way`."""


def _bent(alone: EffectSize, over: EffectSize) -> EffectSize:
    """Averaged magnitude, its interval as skewed as that of the accepted cause alone."""
    straight = NORMAL_95 * alone.std
    if not 0 < straight < np.inf:
        return over
    low, high = (
        over.value + abs(own - alone.value) / straight * (end - over.value)
        for end, own in zip(over.ci95, alone.ci95, strict=True)
    )
    return replace(over, ci95=(low, high))


def _profile(
    view: Whitened, suspect: int, parameter: Parameter, value: float, std: float, variance: float
) -> tuple[float, float]:
    """95 % interval: values at which chi-square, everything else refitted, rises by 3.84.

    With S(z) the smallest sum of squares at z, each end is z +- 1.96 u sqrt(3.84 / D), where
    D = (S(z +- 1.96 u) - S(z)) / s^2, at least 1: one secant step towards the profile likelihood
    interval (Venzon and Moolgavkar, Applied Statistics 37, 1988), which suffices for the
    nonlinearity of forces and geometry. Elastic causes are linear in their parameters and do not
    need it.
    """
    out = []
    for side in (-NORMAL_95, NORMAL_95):
        rise = _rise(view, suspect, parameter, value + side * std) / variance
        out.append(value + side * std * float(np.sqrt(CHI2_95 / max(rise, 1.0))))
    return out[0], out[1]


def _rise(view: Whitened, suspect: int, parameter: Parameter, at: float) -> float:
    """Rise of the sum of squares when one parameter is held, the others refitted.

    The others first follow the linear model; the nonlinear part enters through the prediction at
    these values, to which they are refitted once.
    """
    names = [p.name for p in view.suspects[suspect].parameters]
    fixed = int(view.columns([suspect])[names.index(parameter.name)])
    free = view.base[view.base != fixed]
    A = view.A.copy()
    A[:, -1] -= A[:, fixed] * (at / view.typical[fixed])
    found = dict(zip(free.tolist(), coefficients(A.T @ A, free), strict=True))
    found[fixed] = at / view.typical[fixed]
    mine = of_model(view)
    values = np.array([found[c] for c in mine.tolist()]) * view.typical[mine]
    data = view.seen.data
    moved = predict(view.model.cell, data.pulls, values).displacement[data.pull, data.target]
    B = view.raw[:, np.where(mine < view.springs, mine, mine - view.common)]
    white = view.white.by_pose(data.delta.ravel() - moved.ravel() + B @ values) / view.noise
    A[: len(white), -1] = white - A[: len(white), fixed] * (at / view.typical[fixed])
    return float(eliminate(A.T @ A, free)[-1, -1]) - float(eliminate(view.M, view.base)[-1, -1])
