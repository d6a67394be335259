"""One robot over its campaigns: compliances with their covariance, days, and repairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked

FEWEST = 2
"""Minimum number of campaigns from which a change can be separated from the expected day-to-day
scatter."""

_FLAT = 10.0
"""Prior standard deviation of a relative compliance [1], and of its trend [1/year]; so wide that it
has no influence."""


@dataclass(frozen=True, eq=False)
class Visit(Locked):
    """Estimates of a robot from one campaign.

    Attributes:
        campaign: Name of the campaign.
        year: Day of measurement, in years of 365.25 days.
        x: Compliance of each joint [m/N] or [rad/(N m)], NaN if not determined, shape (n,).
        cov: Their covariance [SI], shape (n, n).
    """

    campaign: str
    year: float
    x: Array
    cov: Array


@dataclass(frozen=True)
class Repair:
    """Day from which some joints have new properties.

    Attributes:
        year: As in `Visit`; campaigns of that day are after the repair.
        joints: Indices of the joints, from 0.
    """

    year: float
    joints: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Machine(Locked):
    """One robot over time, relative to its mean compliances.

    A repair begins a new life of its joints, whose level and trend are independent of those of the
    life before.

    Attributes:
        name: Which robot.
        visits: Its campaigns by day.
        reference: Mean compliance of each joint, weighted by its uncertainty; NaN if no campaign
            determines it, shape (n,).
        t: Time since the first campaign [years], shape (K,).
        y: x / reference - 1, zero if not determined, shape (K, n).
        C: Covariance of y, zero if not determined, shape (K, n, n).
        seen: Which joints a campaign determines, shape (K, n).
        life: Number of each joint's life, the present one last, shape (K, n).
        last: Number of the present life of each joint, shape (n,).
    """

    name: str
    visits: tuple[Visit, ...]
    reference: Array
    t: Array
    y: Array
    C: Array
    seen: Bools
    life: Ints
    last: Ints

    @classmethod
    def of(cls, name: str, visits: Sequence[Visit], repairs: Sequence[Repair] = ()) -> Machine:
        """A robot from its campaigns and repairs, both in any order."""
        visits = sorted(visits, key=lambda one: (one.year, one.campaign))
        x, cov = np.array([v.x for v in visits]), np.array([v.cov for v in visits])
        seen = np.isfinite(x)
        reference = _means(x, np.einsum("kii->ki", cov), seen)
        scale = np.where(np.isfinite(reference), reference, 1.0)
        y = np.where(seen, x, scale) / scale - 1
        both = seen[:, :, None] & seen[:, None, :]
        C = np.where(both, cov, 0.0) / (scale * scale[:, None])
        year = np.array([v.year for v in visits])
        days = [[r.year for r in repairs if j in r.joints] for j in range(x.shape[1])]
        life = np.array([[sum(d <= at for d in own) for own in days] for at in year])
        last = np.array([len(own) for own in days])
        return cls(name, tuple(visits), reference, year - year[0], y, C, seen, life, last)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.y.shape[1]

    @cached_property
    def present(self) -> Bools:
        """Which values belong to the present life, shape (K, n)."""
        return np.asarray(self.life == self.last)

    @cached_property
    def nuisance(self) -> Array:
        """Columns of the levels of all lives and the trends of earlier ones, shape (K, n, p)."""
        columns = []
        for j in range(self.joints):
            for one in range(int(self.last[j]) + 1):
                within = np.where(self.life[:, j] == one, 1.0, 0.0)
                columns.append((j, within))
                if one < self.last[j]:
                    columns.append((j, within * self.t))
        A = np.zeros((len(self.t), self.joints, len(columns)))
        for k, (j, column) in enumerate(columns):
            A[:, j, k] = column
        return A

    @cached_property
    def trend(self) -> Array:
        """Columns of the trends of the present lives, shape (K, n, n)."""
        return np.asarray(np.eye(self.joints) * (self.present * self.t[:, None])[:, None, :])

    def weights(self, variance: Array) -> Array:
        """V^-1 of each campaign, zero if not determined, shape (K, n, n).

        V = C + diag(variance[:n]) + variance[n] 1 1': the campaign's own covariance, and the
        day-to-day scatter of each joint and of all joints alike.
        """
        n = self.joints
        both = self.seen[:, :, None] & self.seen[:, None, :]
        V = self.C + np.where(both, np.diag(variance[:n]) + variance[n], 0.0)
        V = V + np.eye(n) * ~self.seen[:, None, :]
        return np.asarray(np.where(both, linear.regular_inverse(V), 0.0))


def _means(x: Array, variance: Array, seen: Bools) -> Array:
    """Weighted means over campaigns, NaN if no campaign determines the joint, shape (n,)."""
    weight = np.divide(1.0, variance, out=np.zeros_like(x), where=seen)
    total = weight.sum(axis=0)
    mean = np.sum(weight * np.where(seen, x, 0.0), axis=0)
    return np.divide(mean, total, out=np.full(len(total), np.nan), where=total > 0)


def products(X: Array, WX: Array) -> Array:
    """X' W X summed over campaigns, plus the uninformative prior, shape (p, p)."""
    return np.asarray(np.einsum("kip,kiq->pq", X, WX) + np.eye(X.shape[-1]) / _FLAT**2)
