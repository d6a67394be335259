"""Noise and misfit of a campaign, as they are held against their bounds."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.bounds import UNSTATED_M, Bounds
from pipeline.machine import six
from pipeline.system.fit import Fitted
from pipeline.system.outlying import OutlyingReadings
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener

_CHANCE = 2.7e-3
"""Maximum p-value of what a model explains, for it to be distinguished from nothing [1]: three
standard uncertainties of one parameter."""


def bounds(
    right: Fitted, system: System, estimate: Estimate, left: OutlyingReadings, force: float
) -> Bounds:
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
    return bool(chi2_beyond((whole - rest) / variance, max(linear.rank(B.T @ B), 1)) < _CHANCE)


def _scale(right: Fitted, name: str) -> float:
    found = right.noise
    mine = found.name == name
    return float(found.scale[mine][0]) if (mine & found.replaced).any() else 1.0


def _tracker(right: Fitted) -> float:
    """Rms scatter by which the readings are weighted, over the stated uncertainty."""
    if right.noise.stated:
        return right.scatter
    wide = right.shape.wide_m / right.shape.wander.unit
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
