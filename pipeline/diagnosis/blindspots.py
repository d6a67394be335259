"""What this campaign could not have seen, and from which size on it would have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.diagnosis.facts import BlindSpot
from pipeline.diagnosis.isolability import Twins
from pipeline.machine.effect import Effect, Wrench
from pipeline.system.elimination import eliminate
from pipeline.system.whitened import Whitened

_POWER = 0.8


def smallest_visible(view: Whitened, base: Ints, p: float) -> Array:
    """Multiple of the typical size at which each suspect is detected with 80 % power, (n,)."""
    S = eliminate(view.M, base)
    out = np.full(len(view.suspects), np.inf)
    for i in range(len(out)):
        columns = view.columns([i])
        if np.isin(columns, base).any():
            out[i] = np.nan
            continue
        G = S[np.ix_(columns, columns)]
        k = int(linear.left(G, view.M[columns, columns])[1])
        strength = np.trace(G) / len(columns)
        if k and strength > 0:
            out[i] = np.sqrt(needed(k, p) / strength)
    return out


def needed(k: int, p: float) -> float:
    """Noncentrality that k parameters need to fall below p with 80 % power."""
    return float(special.chndtrinc(special.chdtri(k, p), k, 1 - _POWER))


def blind_spots(
    effects: tuple[Effect, ...],
    view: Whitened,
    base: Ints,
    p: float,
    twins: Twins,
    elsewhere: Mapping[str, float],
) -> tuple[BlindSpot, ...]:
    """Causes whose typical size would not have been noticed, the best known first.

    Args:
        effects: The whole catalogue.
        view: The campaign from the final model.
        base: Columns of that model.
        p: Threshold of a suspect's F test.
        twins: What tip loading never separates.
        elsewhere: Multiples of the typical size that show outside the displacements, by label.
    """
    times = smallest_visible(view, base, p)
    best = dict(elsewhere)
    for effect, size in zip(view.suspects, times, strict=True):
        best[effect.label] = np.fmin(best.get(effect.label, np.nan), size)
    out = []
    for effect in {e.label: e for e in effects}.values():
        if effect.label in twins.of_stiffness:
            out.append(BlindSpot(effect, _hidden(effect), None, np.inf))
        elif effect.label in best and best[effect.label] > 1:
            size = float(best[effect.label])
            far = not np.isfinite(size) or size * effect.parameters[0].typical > 1e3
            visible = None if far else size * effect.parameters[0].typical
            why = (
                "no pull of this campaign moves it, or the joint springs hide it altogether"
                if visible is None
                else f"a typical size is {1 / size:.2g} of what would be seen here"
            )
            out.append(BlindSpot(effect, why, visible, size))
    return tuple(sorted(out, key=lambda spot: -spot.times))


def _hidden(effect: Effect) -> str:
    if isinstance(effect, Wrench):
        return "multiplies every stiffness alike"
    return "acts about the axis of a joint and is part of that joint's stiffness"
