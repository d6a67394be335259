"""Sizes of the identified causes, with intervals that follow the model's nonlinearity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Parameter
from pipeline.base.tails import CHI2_95, NORMAL_95
from pipeline.diagnosis.average import Hypothesis, Size, each_way, size
from pipeline.diagnosis.facts import EffectSize
from pipeline.diagnosis.identify import SearchCase, of_model
from pipeline.machine.cell import predict
from pipeline.machine.effect import Effect, Elastic
from pipeline.system.elimination import coefficients, eliminate
from pipeline.system.evidence import ROUNDING
from pipeline.system.whitened import Whitened


def amplitudes(case: SearchCase, view: Whitened) -> list[tuple[EffectSize, ...]]:
    """Sizes of the accepted causes, springs estimated as well; scatter from the residuals.

    z = N^+ g in typical sizes, N = X'X and g = X'y over the whitened columns of the base;
    u(z_k) = s sqrt((N^+)_kk), s^2 = rest / dof, infinite where N does not determine z_k, and the
    95 % interval is z +- t(0.975, dof) u(z); `_profile` gives that of causes that are not elastic.
    s^2 is `ROUNDING` at least, and infinite where no residual is left to tell it from.
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
        effect = case.suspects[suspect]
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
    case: SearchCase, view: Whitened, sets: Sequence[Hypothesis]
) -> list[tuple[EffectSize, ...]]:
    """The same over all hypotheses that hold the cause, as the springs are (`average.size`).

    Their covariance holds what the springs' does: the stated noise, how far each pull may deviate
    from the laws, and what is left over the scatter. The likelihood of a cause that is not elastic
    bends the interval; its ends are as many times farther away as those of `_profile` are.

    Args:
        case: The case.
        view: The campaign whitened at the accepted causes.
        sets: What may be true, the accepted causes first.
    """
    out = []
    for suspect, sizes in zip(view.model.accepted, amplitudes(case, view), strict=True):
        effect = case.suspects[suspect]
        over = [size(sets, effect, k) for k in range(len(sizes))]
        bends = not isinstance(effect, Elastic)
        each = zip(sizes, over, strict=True)
        out.append(tuple(_bent(one, mixed) if bends else _of(one, mixed) for one, mixed in each))
    return out


def both_ways(effect: Effect, sets: Sequence[Hypothesis]) -> tuple[EffectSize, ...]:
    """Compliance of a joint where its torque is positive, and where it is negative.

    Nothing of an effect that does not give it two.

    Args:
        effect: An accepted cause.
        sets: What may be true, the accepted causes first.
    """
    if not isinstance(effect, Elastic) or effect.side is None:
        return ()
    joint = effect.carrier[0] - 1
    found, own = each_way(sets, joint, effect), sets[0].estimate.parameters[joint]
    ends = zip(found.value, found.std, found.low, found.high, strict=True)
    return tuple(
        EffectSize(
            replace(
                own,
                name=f"c_joint{joint + 1}_{way}",
                meaning="compliance of {joint} under a torque of " + f"{way} sign",
            ),
            float(value),
            float(std),
            (float(low), float(high)),
        )
        for way, (value, std, low, high) in zip(WAYS, ends, strict=True)
    )


WAYS = ("positive", "negative")
"""Sign of the torque on a joint of the robot file, in the order of `average.each_way`."""


def _of(alone: EffectSize, over: Size) -> EffectSize:
    return EffectSize(alone.parameter, over.value, over.std, over.ci95)


def _bent(alone: EffectSize, over: Size) -> EffectSize:
    """A size over all hypotheses, its interval bent as that of the accepted cause alone."""
    straight = NORMAL_95 * alone.std
    if not 0 < straight < np.inf:
        return _of(alone, over)
    low, high = (
        over.value + abs(own - alone.value) / straight * (end - over.value)
        for end, own in zip(over.ci95, alone.ci95, strict=True)
    )
    return replace(_of(alone, over), ci95=(low, high))


def _profile(
    view: Whitened, suspect: int, parameter: Parameter, value: float, std: float, variance: float
) -> tuple[float, float]:
    """95 % interval where chi-square, everything else refitted, has risen by 3.84.

    With S(z) the smallest sum of squares at z, each end is z +- 1.96 u sqrt(3.84 / D), where
    D = (S(z +- 1.96 u) - S(z)) / s^2, 1 at least: one step of the secant rule towards the profile
    likelihood's interval (Venzon and Moolgavkar, Applied Statistics 37, 1988), enough for what
    force and geometry bend. Elastic causes are linear in their parameters and need none of this.
    """
    out = []
    for side in (-NORMAL_95, NORMAL_95):
        rise = _rise(view, suspect, parameter, value + side * std) / variance
        out.append(value + side * std * float(np.sqrt(CHI2_95 / max(rise, 1.0))))
    return out[0], out[1]


def _rise(view: Whitened, suspect: int, parameter: Parameter, at: float) -> float:
    """Rise of chi-square when one parameter is held, the others refitted.

    The others follow the linear model; the nonlinear part is in the prediction at these values,
    and they are refitted to it once more.
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
    best = float(eliminate(view.M, view.base)[-1, -1])
    return float(eliminate(A.T @ A, free)[-1, -1]) - best
