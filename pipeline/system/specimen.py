"""Common factor of all stiffnesses of a machine relative to those of the robot file.

A factor on all forces is a factor on all stiffnesses and on nothing else, so no residual shows it:
only prior knowledge of the robot can. With y_j = log(k_j / k_nominal,j), for a range relative to
its nearer end,

    y_j = g + d_j + e_j,    d_j ~ N(0, tau^2),    e_j ~ N(0, u_j^2),

g is the common factor, d_j the individual deviation of one joint as delivered, u_j = u(k_j) / k_j.
tau is estimated from the joints, with a prior at `_OWN`; the posterior of g is Student's t about
the weighted mean (Gelman et al., Bayesian Data Analysis, 2013, 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base.arrays import Array
from pipeline.machine.robot import Joint

_SPECIMENS = 1.5
"""Maximum common factor between robots of one type [1]; a scale read in another unit gives 2.2
(lb and kg) or more: this is halfway between 1 and 2.2, by ratios."""

_OWN = 0.25
"""Prior standard deviation of the log stiffness of single joints about the file's value, as
delivered [1]."""
_OWN_JOINTS = 4.0
"""Number of joints that this prior counts as [1]."""

SURE = 0.95
"""Probability from which a common factor is reported, or a unit that explains it [1]: that of a 95
% interval."""


@dataclass(frozen=True)
class Common:
    """The logarithm g of the common factor: Student's t.

    Attributes:
        g: Its mean [1].
        std: Its scale [1].
        dof: Degrees of freedom.
    """

    g: float
    std: float
    dof: float

    @property
    def beyond(self) -> float:
        """Probability that |g| exceeds the spread of specimens, on the side of its estimate."""
        return self._below(abs(self.g) - np.log(_SPECIMENS))

    @property
    def within(self) -> float:
        """Probability that |g| is within the spread of specimens."""
        limit = np.log(_SPECIMENS)
        return self._below(limit - self.g) - self._below(-limit - self.g)

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the factor [1]."""
        half = float(special.stdtrit(self.dof, 0.975)) * self.std
        return float(np.exp(self.g - half)), float(np.exp(self.g + half))

    def _below(self, distance: float) -> float:
        return float(special.stdtr(self.dof, distance / self.std))


def common(value: Array, std: Array, joints: Sequence[Joint]) -> Common:
    """Estimate the common factor of some stiffnesses.

    Args:
        value: Stiffnesses [N/m] or [N m/rad], shape (n,).
        std: Their standard uncertainties, shape (n,).
        joints: Their entries in the robot file.
    """
    y = np.array([_off(float(k), joint) for k, joint in zip(value, joints, strict=True)])
    weight = 1 / (1 + (std / value / _OWN) ** 2)
    g = float(weight @ y / weight.sum())
    dof = _OWN_JOINTS + len(y) - 1
    variance = (_OWN_JOINTS * _OWN**2 + float(weight @ (y - g) ** 2)) / dof
    return Common(g, float(np.sqrt(variance / weight.sum())), dof)


def has_stated_stiffness(joint: Joint) -> bool:
    """Whether the robot file states a stiffness for a joint."""
    return bool(joint.stiffness or joint.stiffness_range)


def _off(value: float, joint: Joint) -> float:
    """Logarithm of a stiffness over the one the file states, 0 within a range."""
    low, high = joint.stiffness_range or (joint.typical_stiffness, joint.typical_stiffness)
    return float(np.log(value / np.clip(value, low, high)))
