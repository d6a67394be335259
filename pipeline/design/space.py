"""The search box of plans: joint limits and the reach of the anchor, as a unit cube."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.design.information import PlannedPoses, station
from pipeline.design.problem import Problem


@dataclass(frozen=True, eq=False)
class PlanCoordinates(Locked):
    """Unit coordinates of several poses and the free coordinates of their common anchor.

    Attributes:
        problem: The problem whose limits are the box.
        poses: Number of poses.
    """

    problem: Problem
    poses: int

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.poses * len(self.problem.lower) + int(self.problem.free.sum())

    def opened(self, x: Array) -> tuple[Array, Array]:
        """Joint values (k, poses, n) and anchors (k, 3) from unit coordinates (k, d)."""
        p = self.problem
        n, k = len(p.lower), len(x)
        inner = x[:, : self.poses * n].reshape(k, self.poses, n)
        anchor = np.broadcast_to(p.anchor_lower, (k, 3)).copy()
        anchor[:, p.free] += x[:, self.poses * n :] * (p.anchor_upper - p.anchor_lower)[p.free]
        return p.lower + inner * (p.upper - p.lower), anchor

    def stations(self, x: Array) -> PlannedPoses:
        """Every pose of the plans at unit coordinates (k, d), k * poses of them."""
        q, anchor = self.opened(x)
        each = q.reshape(-1, q.shape[-1])
        return station(self.problem.experiment, each, np.repeat(anchor, self.poses, axis=0))

    def closed(self, q: Array, anchor: Array) -> Array:
        """The inverse of `opened`."""
        p = self.problem
        inner = ((q - p.lower) / (p.upper - p.lower)).reshape(len(q), -1)
        span = (p.anchor_upper - p.anchor_lower)[p.free]
        return np.hstack([inner, (anchor - p.anchor_lower)[:, p.free] / span])

    def slopes(self, by_q: Array, by_anchor: Array) -> Array:
        """Derivative by unit coordinates (k, d), from (k * poses, n) and (k * poses, 3)."""
        p = self.problem
        inner = (by_q * (p.upper - p.lower)).reshape(-1, self.poses * len(p.lower))
        anchor = by_anchor.reshape(-1, self.poses, 3).sum(axis=1)
        return np.hstack([inner, (anchor * (p.anchor_upper - p.anchor_lower))[:, p.free]])
