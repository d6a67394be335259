"""Outliers among readings of positions, tested jointly with the whole model.

An outlying reading is a suspect with one column per coordinate, estimated together with all
parameters and their priors: T = g' N^+ g as in `system.score_tests`, chi-square with as many
degrees of freedom as it has directions. The estimated scatter may include the outliers, so the
median of all T determines the variance; it is unaffected while fewer than half of the readings are
outliers (Hampel, J. Am. Stat. Assoc. 69, 1974). The caller leaves the outliers out, estimates
again, and tests all readings again until the same ones are found: forward search with deletion, as
in `system.simultaneous`, one reading per pose at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import Posterior, ReadRows, rows, solved
from pipeline.positions.left_out import distances
from pipeline.positions.mechanism import ArmWeights, Linear, linearised
from pipeline.positions.readings import PositionReadings
from pipeline.system import alarms
from pipeline.system.simultaneous import chance

_TAILS = 3.0
"""Factor by which a sum of squares must exceed its critical value [1], so that readings from the
heavy tails of ordinary noise are not called outliers."""

_LEAST = 1e-4
"""Lower limit of the variance of the whitened rows [1]: outliers may have inflated the scatter to a
hundred times that of the other readings."""


class Outliers(NamedTuple):
    """Outlying readings.

    Attributes:
        which: Mask of the outliers, shape (m, t).
        size_m: Distance of each reading from its position according to the model [m], NaN where not
            read, shape (m, t).
        p: Probability that chance makes any reading deviate as much, shape (m, t).
    """

    which: Bools
    size_m: Array
    p: Array


def find_outliers(
    found: Calibration, readings: PositionReadings, weights: ArmWeights, held: Bools
) -> Outliers:
    """Find the outliers, testing each reading given those in `held`.

    In each pose only the worst outlier is added, since it may distort others of its pose. A reading
    in `held` is compared with its prediction by all that are not, and may be reinstated.

    Args:
        found: The model, estimated without the readings in `held`.
        readings: All readings.
        weights: Gravity and payloads on the arm.
        held: Readings presently taken for outliers, shape (m, t).
    """
    free = _Asked.of(found, readings, weights, held)
    which, p = _farthest(free), free.p(free.variance)
    for layer in range(int(held.sum(axis=1).max(initial=0))):
        back = held & (np.cumsum(held, axis=1) == layer + 1)
        one = _Asked.of(found, readings, weights, held & ~back, free.estimate)
        which = np.where(back, one.far(free.variance), which)
        p = np.where(back, one.p(free.variance), p)
    here = linearised(readings, found.mechanism, weights)
    return Outliers(which, distances(here.y, readings.read), np.minimum(p, 1.0))


@dataclass(frozen=True, eq=False)
class _Asked(Locked):
    """Test statistics of each reading as a single outlier.

    Attributes:
        drop: Decrease of the sum of squares if it is an outlier, shape (m, t).
        rank: Number of its testable directions, 0 where it is not tested, shape (m, t).
        dof: Rows minus parameters.
        estimate: The estimate that they are compared with.
    """

    drop: Array
    rank: Ints
    dof: int
    estimate: Posterior

    @classmethod
    def of(
        cls,
        found: Calibration,
        readings: PositionReadings,
        weights: ArmWeights,
        without: Bools,
        by: Posterior | None = None,
    ) -> _Asked:
        """Of all readings but those in `without`, which determine the estimate, or by another."""
        at = np.where(without[..., None], np.nan, readings.at)
        readings = replace(readings, at=at)
        here = linearised(readings, found.mechanism, weights)
        white = rows(here, found.mechanism, found.scatter)
        columns, sign = _columns(white.W, here, readings.six), 1.0 if by else -1.0
        by = by or solved(white, found.mechanism, found.known)
        drop, rank = _each(white, columns, by, sign)
        return cls(drop, rank, int(readings.read.sum()) - white.D.shape[2], by)

    @property
    def variance(self) -> float:
        """Variance of the whitened rows, from the median test statistic."""
        there = self.rank > 0
        ratio = self.drop[there] / special.chdtri(self.rank[there], 0.5)
        return max(float(np.median(ratio)), _LEAST) if there.any() else 1.0

    def far(self, variance: float) -> Bools:
        """Readings beyond `_TAILS` times the critical value of the whole family, shape (m, t)."""
        tests = max(int((self.rank > 0).sum()), 1)
        limit = special.chdtri(np.maximum(self.rank, 1), alarms.READING / tests)
        return np.asarray((self.rank > 0) & (self.drop > _TAILS * limit * variance))

    def p(self, variance: float) -> Array:
        """Probability by chance that any reading deviates as much, shape (m, t); may exceed 1."""
        tests = int((self.rank > 0).sum())
        return tests * chance(self.drop, self.rank, variance, self.dof)


def _farthest(asked: _Asked) -> Bools:
    """The worst outlier of each pose that has any, as a mask, shape (m, t)."""
    far = asked.far(asked.variance)
    best = np.argmax(np.where(far, asked.drop, -1.0), axis=1)
    return far & (np.arange(far.shape[1]) == best[:, None])


def _columns(W: Array, here: Linear, six: Bools) -> Array:
    """Whitened unit columns of the coordinates read, (m, r, t, 3), or (..., 6) where any is 6D."""
    every = np.zeros((*W.shape[:2], here.read.shape[1]))
    every[..., here.used] = W
    each = (every * here.read[:, None, :]).reshape(*W.shape[:2], -1, 6)
    return each if six.any() else each[..., :3]


def _each(white: ReadRows, D: Array, by: Posterior, sign: float) -> tuple[Array, Ints]:
    """Decrease of the sum of squares by each suspect alone, and its rank, (m, t) each.

    T = g' (D'D + s D' X C X' D)^+ g, g = D' e, with C the covariance of the estimate. D'D is the
    inverse covariance of a reading given all others of its pose, (D'D)^-1 g its deviation from what
    they let expect. The sign s is -1 for readings that the estimate rests on, else 1.
    """
    e = white.y - white.along(by.x)
    whole = np.einsum("mrti,mrtj->mtij", D, D)
    known = np.einsum("mrti,mrs,mstj->mtij", D, white.variance(by), D, optimize=True)
    cov, rank = linear.left(whole + sign * known, np.einsum("mtii->mti", whole))
    g = np.einsum("mrti,mr->mti", D, e)
    return np.einsum("mti,mtij,mtj->mt", g, cov, g), rank
