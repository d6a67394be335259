"""Readings of positions that contradict all others, beside the whole model.

A reading that is off is a suspect with a column for each of its coordinates, beside all parameters
and what is known of them before: T = g' N^+ g as in `system.beside`, chi-square over its directions
by chance. The scatter of the estimate may hold what the suspects do, so a median of all T says how
large it is, which up to half of them cannot move (Hampel, J. Am. Stat. Assoc. 69, 1974). Whoever
calls this leaves them out, estimates again, and asks all again: no order, and no shadow, decides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.geometry.estimate import Rows, rows, solved
from pipeline.geometry.identify import Identified
from pipeline.geometry.leftout import distances
from pipeline.geometry.mechanism import Weights, linearised
from pipeline.geometry.readings import Readings
from pipeline.system import alarms
from pipeline.system.together import chance

_TAILS = 3.0
"""Sums of squares so many times beyond chance are no tail of what is always there."""

_LEAST = 1e-4
"""Variance below which whitened rows do not scatter [1]: a scatter may hold a hundred times what is
without the readings that are off."""


class Off(NamedTuple):
    """Readings that are off.

    Attributes:
        which: Of all readings, shape (m, t).
        size_m: How far each is from where all others put it [m], NaN where not read, shape (m, t).
        p: Probability that chance makes any reading as far off, shape (m, t).
    """

    which: Bools
    size_m: Array
    p: Array


def off(found: Identified, readings: Readings, weights: Weights) -> Off:
    """What is off among readings, beside a model that was estimated from them or from some.

    Args:
        found: The model, with its priors and its scatter.
        readings: All readings.
        weights: What pulled at the arm.
    """
    here = linearised(readings, found.mechanism, weights)
    white = rows(here, found.mechanism, found.scatter)
    drop, rank = _each(white, _columns(white.W, readings), found)
    there = rank > 0
    usual = np.median(drop[there] / special.chdtri(rank[there], 0.5)) if there.any() else 1.0
    variance, tests = max(float(usual), _LEAST), int(there.sum())
    limit = special.chdtri(np.maximum(rank, 1), alarms.READING / max(tests, 1))
    p = tests * chance(drop, rank, variance, white.y.size - white.D.shape[2])
    return Off(
        which=there & (drop > _TAILS * limit * variance),
        size_m=distances(here.y, readings.read),
        p=np.minimum(p, 1.0),
    )


def _columns(W: Array, readings: Readings) -> Array:
    """Whitened columns of the coordinates that were read, (m, r, t, 3), or 6 where any is 6D."""
    each = (W * readings.read[:, None, :]).reshape(*W.shape[:2], -1, 6)
    return each if readings.six.any() else each[..., :3]


def _each(white: Rows, D: Array, found: Identified) -> tuple[Array, Ints]:
    """How far the sum of squares falls by each suspect alone, and its directions, (m, t)."""
    solution = solved(white, found.mechanism, found.known)
    e = white.y - white.along(solution.x)
    whole = np.einsum("mrti,mrtj->mtij", D, D)
    held = np.einsum("mrti,mrs,mstj->mtij", D, white.variance(solution.cov), D, optimize=True)
    cov, rank = linear.left(whole - held, np.einsum("mtii->mti", whole))
    g = np.einsum("mrti,mr->mti", D, e)
    return np.einsum("mti,mtij,mtj->mt", g, cov, g), rank
