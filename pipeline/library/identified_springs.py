"""Springs of the joints of an identified model, over all its hypotheses, as files state them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.diagnosis.average import average
from pipeline.machine import sides
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis


@dataclass(frozen=True, eq=False)
class IdentifiedSprings(Locked):
    """Compliances and stiffnesses of the joints of a model.

    Attributes:
        model: The identified model.
    """

    model: IdentifiedModel

    def stiffness(self, joint: int) -> tuple[float, float, str] | None:
        """Stiffness of a joint, its standard uncertainty and unit [N/m] or [N m/rad].

        None if it is not stated: not determined, or not positive.
        """
        x, std = float(self.value[joint]), float(self.std[joint])
        known = self.model.stated is None or bool(self.model.stated[joint])
        if not (known and np.isfinite(std) and x > 0):
            return None
        return 1 / x, std / x**2, self.model.robot.joints[joint].stiffness_unit

    @cached_property
    def springs(self) -> tuple[Array, Array]:
        """Compliances of the joints (n,) and their covariance (n, n), over all hypotheses.

        For a joint with one compliance per sign of its torque, that at the test pose.
        """
        values, covs = zip(*map(self._springs, self.model.hypotheses), strict=True)
        weights = [one.weight for one in self.model.hypotheses]
        return average(weights, np.stack(values), np.stack(covs))

    def _springs(self, one: ModelHypothesis) -> tuple[Array, Array]:
        """Compliances and covariance of one hypothesis."""
        T = np.eye(len(one.value))[: self.model.robot.n]
        if self.model.at_pose is not None:
            both = sides.columns(self.model.robot.n, one.more)
            for joint, sign in sides.at_pose(one.cell, one.value, *self.model.at_pose).items():
                T[joint, both[joint]] = sign
        return sides.taken(one.value, one.cov, T)

    @property
    def value(self) -> Array:
        """Compliances of the joints [m/N] or [rad/(N m)], shape (n,)."""
        return self.springs[0]

    @property
    def cov(self) -> Array:
        """Covariance of `value`, shape (n, n); infinite on the diagonal where undetermined."""
        return self.springs[1]

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (n,)."""
        return np.sqrt(np.diag(self.cov))
