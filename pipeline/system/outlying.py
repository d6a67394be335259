"""Readings so far off that no noise of an instrument explains their number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.system.assemble import errors
from pipeline.system.family import FAR_OFF, Family
from pipeline.system.linearised import Linearised
from pipeline.system.rows_by_pose import ReadingsOfRows, RowsByPose, columns, estimates
from pipeline.system.score_tests import Base
from pipeline.system.simultaneous import Suspects


@dataclass(frozen=True, eq=False)
class OutlyingReadings(Locked):
    """Readings in use that are far off, relative to the accepted model.

    Attributes:
        pose: Pose of each, the farthest first, shape (n,).
        target: Index of its target, shape (n,).
        p_value: Probability that noise of the likeliest families produces as many.
        base: Number of base readings that must be far off, too.
    """

    pose: Ints
    target: Ints
    p_value: float
    base: int = 0

    @property
    def count(self) -> int:
        """Number of readings far off."""
        return len(self.pose) + self.base

    @classmethod
    def none(cls) -> OutlyingReadings:
        """No reading is far off."""
        nothing = np.zeros(0, np.int64)
        return cls(nothing, nothing, 1.0)


def far(
    seen: Linearised, family: Family, base: tuple[int, int] = (0, 0), used: float = 1.0
) -> OutlyingReadings:
    """Readings beyond `FAR_OFF` of their prediction by all others, and whether tails explain them.

    `FAR_OFF` is in widths of the core of the readings' noise, which is narrower than a scatter that
    includes mistakes, but at least in stated uncertainties.

    The distance is in the reading's own uncertainty, or in that of the prediction from the others
    where this is larger: with x and S as in `family.likelihood`, the sum of x^2 / max(1, S).

    p = k min_j P[Bin(n, p_f(d_j)) >= j], the largest over the families with any weight: k of n
    readings are far off, d_j is the distance of the j-th farthest and p_f(d) the mean probability
    of a distance of d in family f, mistakes excluded: a bound for unequal probabilities (Hoeffding,
    Annals of Mathematical Statistics 27, 1956), and for k distances (Bonferroni). Readings of the
    base count as just far off; the farthest reading alone is not asked, if there are others.

    Args:
        seen: The campaign linearised at a model, all readings weighted alike.
        family: Tails of its readings.
        base: Number of base readings that must be as far off, and of all base readings.
        used: Noise in use over the stated one [1].
    """
    owner = np.repeat(np.arange(len(seen.suspects)), [len(e.parameters) for e in seen.suspects])
    data, values = replace(seen.data, bends=False), seen.model.values
    flat = replace(seen.model.cell, equilibrium="undeformed")
    X = columns(seen, np.isin(owner, seen.model.accepted))
    beyond = RowsByPose.beside(seen, linear.orthonormal(X), errors(flat, data, values))
    readings = ReadingsOfRows.of(data, beyond.white)
    distance = FAR_OFF * max(family.width, 1 / used)
    away, reached, good, others = _away(beyond.base, readings, distance)
    pose, target = readings.state[:, 0], readings.targets(data)
    there = np.vstack([readings.state[good], np.full((base[1], 2), -1)])
    others = np.vstack([others, np.zeros((base[1], 3))])
    if not len(others):
        return OutlyingReadings.none()
    reached = np.sort(np.append(reached, np.full(base[0], distance)))[::-1]
    k = len(reached)
    every = [
        _chance(j, len(others), family.away(float(reached[j - 1]), others, there))
        for j in range(2 if k > 1 else 1, k + 1)
    ]
    return OutlyingReadings(
        pose[away], target[away], min(1.0, max(k, 1) * min(every, default=1.0)), base[0]
    )


def _away(
    base: Base, readings: ReadingsOfRows, distance: float
) -> tuple[Ints, Array, Bools, Array]:
    """Readings beyond a distance, their distances, which are controlled, and S of these, (n, 3).

    The farthest of each pose are freed and all others tested again, since an outlier shifts the
    predictions of its neighbours.
    """
    suspects, found = Suspects(readings.D, readings.blocks), np.zeros(0, np.int64)
    reached, told = np.zeros(0), None
    while True:
        square, variance, good = estimates(base, readings)
        others = np.maximum(variance - 1.0, 0.0)
        told = (good, others[good]) if told is None else told
        off = np.sum(square / np.maximum(others, 1.0), axis=1)
        far_off = np.where(good & (off > distance**2), np.sum(square / variance, axis=1), 0.0)
        worst = suspects.farthest(far_off)
        if not len(worst):
            return found, reached, *told
        worst = worst[np.argsort(-far_off[worst], kind="stable")]
        found, reached = np.append(found, worst), np.append(reached, np.sqrt(off[worst]))
        base = base.more(suspects.rows(base, worst))


def _chance(k: int, n: int, chances: Array) -> float:
    return float(np.max(special.bdtrc(k - 1, n, chances))) if k else 1.0
