"""DH parameters that are off by far more than the rest of the table, found from positions.

As in the unloaded readings of pulls (`diagnosis.unloaded_geometry`): the roughness of the rest is
integrated over a grid, so that a wrong entry does not raise the scale that it is compared with.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, compared
from pipeline.base.linear import rms
from pipeline.diagnosis.unloaded_geometry import MOST_CAUSES, OUTSTANDING, WIDE
from pipeline.geometry.roughness import ALIKE, RoughnessGrid, SuspectUnknowns, of_cells
from pipeline.geometry.unloaded import USUAL
from pipeline.positions.estimate import FIXED_SIGMA, Posterior, Prior
from pipeline.system import alarms

_SCALES = 1e-3 * np.geomspace(1e-2, 10.0, 13)
"""Nodes of the grid of roughness [m] and [rad], a factor of 1.8 apart: the standard deviation of
ten entries is itself uncertain by a factor of 1.25."""

_SEEN = 1e-3
"""Fraction of the prior variance of an entry that the readings must take away at least [1]."""


def outstanding(known: Prior, found: Posterior) -> Bools:
    """Which DH parameters are far beyond the rest of the table, shape (k,).

    An entry is, if by chance none of the table would be as far from zero (`alarms.GEOMETRY`), and
    if it exceeds the rest, or a table as delivered, by `OUTSTANDING`. The likeliest entries are
    freed one after the other, the most of them for which this holds of each.

    Args:
        known: The priors that `found` is estimated with.
        found: An estimate.
    """
    k = len(known.turns)
    none = np.zeros(k, dtype=bool)
    if not k or known.std[0] <= FIXED_SIGMA:
        return none
    asked = [SuspectUnknowns(str(one), (one,), WIDE, k) for one in _large(known, found)]
    N, b = _of_readings(known, found) if asked else (none, none)
    free = far = tuple[SuspectUnknowns, ...]()
    for _ in asked[:MOST_CAUSES]:
        grid = _grid(known, N, b, free)
        rest = [one for one in asked if one not in free]
        free = (*free, max(rest, key=lambda one: compared(grid.evidence(one))))
        grid = _grid(known, N, b, free)
        far = free if all(_far(known, grid, one) for one in free) else far
    none[[one.columns[0] for one in far]] = True
    return none


def confirmed(known: Prior, found: Posterior) -> Bools:
    """Which of the DH parameters that are free the final estimate shows far off, shape (k,).

    They were freed beside other laws and masses, which may since have taken their place; and of an
    entry that the readings hardly see, as the last offset beside a free tool, nothing is left.
    """
    k = len(known.free)
    z = np.abs(found.x[:k]) / np.sqrt(found.dense_var[:k])
    shown = 2 * k * special.ndtr(-z) < alarms.GEOMETRY
    return known.free & shown & outstanding(known, found)


def _large(known: Prior, found: Posterior) -> list[int]:
    """The entries that may be outstanding: others need no grid.

    Without their priors they exceed by `OUTSTANDING` a table as delivered, and the rest of their
    kind even without as many as may be outstanding.
    """
    k = len(known.turns)
    seen = 1 - found.dense_var[:k] / known.std[:k] ** 2
    rest = _usual(known)
    for turns in (False, True):
        mine = known.turns == turns
        least = np.sort(np.abs(found.x[:k][mine]))[: max(int(mine.sum()) - MOST_CAUSES, 0)]
        rest[mine] = np.maximum(rest[mine], rms(least) if len(least) else 0.0)
    large = np.abs(found.x[:k]) > OUTSTANDING * np.maximum(seen, _SEEN) * rest
    return [int(one) for one in np.flatnonzero(large & (seen > _SEEN))]


def _usual(known: Prior) -> Array:
    """Standard deviation of each entry of a table as delivered, or as stated, shape (k,)."""
    length, angle = (
        u if np.isnan(said) else said for u, said in zip(USUAL, known.stated, strict=True)
    )
    return np.where(known.turns, angle, length)


def same_robot(known: Prior, found: Posterior, one: int) -> tuple[int, ...]:
    """The DH parameters whose errors move all targets as those of another do.

    Args:
        known: The priors that `found` is estimated with.
        found: An estimate.
        one: Index of a DH parameter.
    """
    N = _of_readings(known, found)[0]
    size = np.sqrt(np.maximum(np.diag(N), known.std[: len(N)] ** -2))  # unseen ones are like none
    cosine = N[one] / (size * size[one])
    alike = np.flatnonzero(cosine**2 > 1 - ALIKE).tolist()
    return tuple(k for k in alike if k != one)


def _of_readings(known: Prior, found: Posterior) -> tuple[Array, Array]:
    """Normal matrix and right-hand side of the DH parameters alone, beside all other unknowns.

    The prior of the parameters themselves is taken out again: P = C^-1 - S^-2.
    """
    k = len(known.turns)
    P = linear.inverse(found.of(slice(k)))
    return P - np.diag(known.std[:k] ** -2), P @ found.x[:k]


def _grid(known: Prior, N: Array, b: Array, free: tuple[SuspectUnknowns, ...]) -> RoughnessGrid:
    """Estimates for every roughness of lengths and angles."""
    lengths, angles = np.meshgrid(_SCALES, _SCALES, indexing="ij")
    rough = np.column_stack([lengths.ravel(), angles.ravel()])
    std = rough[:, known.turns.astype(int)]
    for one in free:
        std[:, list(one.columns)] = one.wide
    none = np.zeros(len(rough))
    x, cov, log = of_cells(N + none[:, None, None], b + none[:, None], none, std)
    return RoughnessGrid(free=free, std=std, rough=rough, width=none, x=x, cov=cov, log=log)


def _far(known: Prior, grid: RoughnessGrid, one: SuspectUnknowns) -> bool:
    """Whether an entry that is free is significant, and far beyond the rest."""
    (at,) = one.columns
    turns = int(known.turns[at])
    rest = max(_usual(known)[at], grid.roughness[turns])
    if abs(grid.mean[at]) <= OUTSTANDING * rest:
        return False
    return one.tries * grid.p_value(one, grid.rough[:, [turns]]) < alarms.GEOMETRY
