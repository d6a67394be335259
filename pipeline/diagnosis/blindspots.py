"""Blind spots: causes that this campaign could have missed, and the magnitudes that it detects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, compared
from pipeline.diagnosis.facts import Unnoticed
from pipeline.diagnosis.isolability import Twins
from pipeline.machine.effect import Effect, Wrench
from pipeline.system.score_tests import left_beside
from pipeline.system.whitened import Whitened

_POWER = 0.8
"""Power of detection at a magnitude called visible [1]: the usual power of a test."""


def smallest_visible(view: Whitened, base: Ints, p: float) -> Array:
    """Multiple of the typical magnitude at which each suspect is detected with 80 % power, (n,).

    NaN for a suspect that is part of the base.
    """
    return np.where(np.isin(view.at, base).any(axis=1), np.nan, visible(view.M, base, view.at, p))


def visible(M: Array, base: Ints, at: Ints, p: float) -> Array:
    """Multiple of the typical magnitude as above, from products of whitened columns, (..., n).

    sqrt(lambda k / trace N), with N the products of the k columns of a suspect after projection on
    the complement of the base, and lambda the noncentrality needed by a test at level p; infinite
    where nothing remains.

    Args:
        M: Products (..., W, W) of one campaign or of many plans.
        base: Columns that are estimated in any case.
        at: Columns of each suspect, -1 where it has fewer, shape (n, k).
        p: Level of the test.
    """
    _, N, whole = left_beside(M, base, at)
    rank = linear.left(N, whole)[1]
    strength = np.einsum("...ii->...", N) / np.sum(at >= 0, axis=1)
    seen = (rank > 0) & (strength > 0)
    least = needed(np.maximum(rank, 1), p) / np.where(seen, strength, 1.0)
    return np.where(seen, np.sqrt(least), np.inf)


def needed(k: ArrayLike, p: float) -> Array:
    """Noncentrality at which a test of k parameters at level p has 80 % power."""
    return np.asarray(special.chndtrinc(special.chdtri(k, p), k, 1 - _POWER))


def unnoticed(
    effects: tuple[Effect, ...],
    view: Whitened,
    base: Ints,
    p: float,
    twins: Twins,
    elsewhere: Mapping[str, float],
) -> tuple[tuple[Unnoticed, ...], tuple[Unnoticed, ...]]:
    """Causes that could be present at their typical magnitude undetected, least visible first.

    And those that a typical magnitude would have shown.

    Args:
        effects: The whole catalogue.
        view: The campaign from the final model.
        base: Columns of that model.
        p: Threshold of a suspect's F test.
        twins: Effects that loading at the tip never separates.
        elsewhere: Multiples of the typical magnitude that are visible outside the displacements, by
            label.
    """
    best, spots, shown = dict(elsewhere), list[Unnoticed](), list[Unnoticed]()
    for effect, size in zip(view.suspects, smallest_visible(view, base, p), strict=True):
        best[effect.label] = float(np.fmin(best.get(effect.label, np.nan), size))
    best |= dict.fromkeys(twins.of_stiffness, np.inf)
    for effect in {e.label: e for e in effects}.values():
        size = best.get(effect.label, np.nan)
        visible = size * effect.parameters[0].typical
        if size <= 1:
            shown.append(Unnoticed(effect, "", visible, size))
        elif size > 1:
            far = not np.isfinite(size) or visible > 1e3
            why = f"a typical size is {1 / size:.2g} of what would be seen here"
            if effect.label in twins.of_stiffness:
                of_joint = "acts about the axis of a joint and is part of that joint's stiffness"
                all_alike = "multiplies every stiffness alike"
                why = all_alike if isinstance(effect, Wrench) else of_joint
            elif far:
                why = "no pull of this campaign moves it, or the joint springs hide it altogether"
            spots.append(Unnoticed(effect, why, None if far else visible, size))
    return tuple(sorted(spots, key=lambda spot: -compared(spot.times))), tuple(shown)
