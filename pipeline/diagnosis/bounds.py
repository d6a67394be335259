"""Bounds on noise and misfit that a sound campaign must keep, whatever causes were found in it.

What no other mechanism explains becomes noise; these bounds limit how much of it is possible.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.base import linear
from pipeline.base.tails import chi2_beyond
from pipeline.machine import six
from pipeline.system import alarms
from pipeline.system.family import AWAY
from pipeline.system.far import Far
from pipeline.system.fit import Fitted
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener

FAULTY = 10.0
"""Scatter over the stated one above which an instrument is not in order [1]. A tracker that is
twice as noisy as its certificate is usual; stating an MPE, an expanded uncertainty or the noise at
short range for that at the far end errs by a factor of 2 or 3 (see `variance.FAR`). With a factor
of 2 for one standard deviation of its logarithm, ten times is one instrument in two thousand."""

UNSTATED_M = 1e-4
"""Substitute for the stated noise where none is stated [m]: what cameras and measuring arms in a
workshop reach."""

_LEFT = 0.25
"""Maximum fraction of the squared displacements that a model may leave beyond the stated noise [1];
one that leaves more predicts less than half of a deflection."""


_CHANCE = 2.7e-3
"""Maximum p-value of what a model explains, for it to be distinguished from nothing [1]: three
standard uncertainties of one parameter."""


@dataclass(frozen=True)
class Bounds:
    """Noise and misfit of a campaign, to be compared with their bounds.

    Attributes:
        tracker: Scatter of the readings in use over the stated one, tails and wander included;
            where none is stated, over a tenth of a millimetre.
        stated: Whether a noise of the tracker is stated.
        force: Scatter of the scale over the stated one.
        left: Fraction of the squared displacements that the model leaves beyond the stated noise.
        determined: Whether the model explains more than chance does.
        far: Readings in use that are farther off than noise explains.
        worst_pose: Pose with the largest residual.
        worst_target: Its target.
        worst_m: Residual there, rms [m].
        turn_rad: The same as a rotation, where that is a pose's rotation [rad]; None for a
            position.
        doubted: Readings that deviate by more than `AWAY` from all others and stay in use, since
            the tails of the noise explain as many: `file:line`.
        unit_m: Substitute for the noise where none is stated, or where unmodelled errors of the
            machine are to be included [m].
    """

    tracker: float = 1.0
    stated: bool = True
    force: float = 1.0
    left: float = 0.0
    determined: bool = True
    far: Far = field(default_factory=Far.none)
    worst_pose: int = 0
    worst_target: str = ""
    worst_m: float = 0.0
    turn_rad: float | None = None
    doubted: tuple[str, ...] = ()
    unit_m: float = UNSTATED_M

    @property
    def faulty(self) -> bool:
        """Whether tracker or scale scatter more than an instrument in order can."""
        return max(self.tracker, self.force) > FAULTY

    @property
    def scattered(self) -> bool:
        """Whether too many readings are too far off for any tails.

        One of a pose is tolerated, since it changes little. One of the base is not: a single wrong
        one would have been found, so it is the least evidence that several are wrong.
        """
        return self.far.count > (self.far.base == 0) and self.far.p_value < alarms.READING

    @property
    def predicts(self) -> bool:
        """Whether the model predicts the measured displacements to any useful extent."""
        return self.determined and self.left <= _LEFT


def bounds(right: Fitted, system: System, estimate: Estimate, left: Far, force: float) -> Bounds:
    """Noise and misfit of a campaign.

    Args:
        right: The campaign, for its noise.
        system: The rows of the final model.
        estimate: Its solution.
        left: Readings in use that are far off.
        force: Scatter of the scale over the one in use, from the joint springs [1].
    """
    pose, target, worst_m = _worst(system, estimate)
    tool = right.case.tool
    turned = tool.six and target == six.ROWS[1]
    return Bounds(
        tracker=_tracker(right),
        stated=right.noise.stated,
        force=force * _scale(right, "force_reading"),
        left=_left(right, system, estimate),
        determined=_determined(system, estimate),
        far=left,
        worst_pose=pose,
        worst_target=target,
        worst_m=worst_m,
        turn_rad=worst_m / six.radius(tool.points) if turned else None,
    )


def _determined(system: System, estimate: Estimate) -> bool:
    """Whether the model explains more than chance does.

    P[chi2(k) > (c' V^-1 c - r' V^-1 r) / v] < `_CHANCE` with k parameters and v the residual
    variance where no noise is stated, else 1. False for a robot that does not deflect.
    """
    white = whitener(system.errors, system.rows.pose)
    whole, rest = (float(np.sum(white(rows) ** 2)) for rows in (system.c, estimate.residual))
    told = system.noise_stated or estimate.dof < 1
    variance = 1.0 if told else max(rest / estimate.dof, np.finfo(float).tiny)
    B = system.B * system.typical
    chance = chi2_beyond((whole - rest) / variance, max(linear.rank(B.T @ B), 1))
    return bool(chance < _CHANCE)


def _scale(right: Fitted, name: str) -> float:
    found = right.noise
    mine = found.name == name
    return float(found.scale[mine][0]) if (mine & found.replaced).any() else 1.0


def _tracker(right: Fitted) -> float:
    """Rms scatter by which the readings are weighted, over the stated uncertainty.

    The variance of a single reading counts up to that of one at `AWAY`.
    """
    variance, wander = np.minimum(right.shape.variance, AWAY**2 / 3), right.shape.wander
    wide = float(np.sqrt(np.mean(variance) + (wander.size / wander.unit) ** 2))
    if right.noise.stated:
        return _scale(right, "tracker") * wide
    found_m = right.noise.of("tracker") if right.noise.replaced[0] else right.system.found_m
    return (found_m or 0.0) * wide / UNSTATED_M


def _left(right: Fitted, system: System, estimate: Estimate) -> float:
    """Fraction of the squared displacements in the residuals beyond the stated noise."""
    moved = float(np.sum(right.reduced.data.delta**2))
    data = right.reduced.data
    noise = np.einsum("dii->", data.loaded_cov) + np.einsum("dii->", data.zero_cov)
    noise = noise if data.noise_stated else 0.0
    left = float(np.sum(estimate.residual**2)) - float(noise)
    return max(left, 0.0) / moved if moved > 0 else 1.0


def _worst(system: System, estimate: Estimate) -> tuple[int, str, float]:
    """Pose and target with the largest residual, and its rms [m]."""
    key = np.array([f"{p} {t}" for p, t in zip(system.rows.pose, system.rows.target, strict=True)])
    names, at = np.unique(key, return_inverse=True)
    mean = np.bincount(at, estimate.residual**2) / np.bincount(at)
    worst = int(np.argmax(mean))
    pose, target = str(names[worst]).split(" ", 1)
    return int(pose), target, float(np.sqrt(3 * mean[worst]))
