"""Points of the effector as stated, and where a load point is that measured targets carry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.tails import chi2_beyond
from pipeline.reduction.settings import Settings

_FLANGE_STD = np.repeat(1e-3, 6)
"""Standard deviation of the rotation [rad] and the shift [m] of the flange in which a tool is
stated, relative to that of the table: as of any entry of a table as delivered."""


class StatedTool(NamedTuple):
    """Points of the effector as stated.

    Attributes:
        points: Their coordinates [m], flange frame, by name.
        std: Standard uncertainty per axis of the targets [m]; 0 where it is not stated.
        load_std: The same of the load point.
    """

    points: dict[str, Array]
    std: float
    load_std: float

    @classmethod
    def of(cls, settings: Settings) -> StatedTool:
        """Measured targets and load point as campaign.toml states them."""
        std, load = settings.tool_uncertainty.sigma_m, settings.tool_uncertainty.load_point_sigma_m
        points = {one: np.array(settings.tool[one]) for one in ("load_point", *settings.measured)}
        return cls(points, std, std if load is None else load)

    def carried(self, known: dict[str, Array], cov: Array) -> tuple[Array, Array, Array, float]:
        """The load point where the measured targets carry it.

        Targets p and load point l are stated in a frame that a motion m ~ N(0, M) displaces,

            p = p_s + J m + e,    l = l_s + J_l m + e_l,    l | p = l_s + G (p - p_s).

        Args:
            known: Measured points [m], flange frame, t of them.
            cov: Their covariance, shape (3 t, 3 t).

        Returns:
            l given p (3,), G (3, 3 t), covariance of l given p, and p-value of p as stated.
        """
        names, where = list(known), self.points["load_point"]
        stated = np.array([self.points[name] for name in names])
        J, Jl = _by_flange(stated), _by_flange(where[None])
        off = np.array([known[name] for name in names]) - stated
        V = J @ J.T + self.std**2 * np.eye(len(J))
        G = linear.solve(V, J @ Jl.T).T
        rest = Jl @ Jl.T - G @ J @ Jl.T + self.load_std**2 * np.eye(3)
        chi2 = off.ravel() @ linear.solve(V + cov, off.ravel())
        return where + G @ off.ravel(), G, rest, float(chi2_beyond(chi2, off.size))


def _by_flange(points: Array) -> Array:
    """Motion of points (t, 3) by one standard deviation of the flange's frame, (3 t, 6)."""
    along = np.tile(np.eye(3), (len(points), 1, 1))
    moved = np.concatenate([linear.turning(points), along], axis=2).reshape(-1, 6)
    return np.asarray(moved * _FLANGE_STD)
