"""Predicted targets of a robot, whatever model predicts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Locked


@dataclass(frozen=True, eq=False)
class PredictedTargets(Locked):
    """Predicted poses of the targets.

    Attributes:
        at: Positions [m], F_b, shape (m, t, 3).
        turn: Orientation, shape (m, t, 3, 3).
        cov: Covariance of position [m^2] and of rotation about the axes of F_b [rad^2], (m, t, 6,
            6).
        moved: Displacement by the force [m], F_b, shape (m, t, 3).
        moved_std: Its standard uncertainty, shape (m, t, 3).
    """

    at: Array
    turn: Array
    cov: Array
    moved: Array
    moved_std: Array

    @property
    def std(self) -> Array:
        """Standard uncertainties, x, y, z [m] and about x, y, z [rad], (m, t, 6)."""
        return np.sqrt(np.maximum(np.einsum("mtii->mti", self.cov), 0.0))
