"""The information of an existing campaign, as prior for planning further poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.toml import given
from pipeline.design.spec import ProblemFile, validated
from pipeline.reduction.settings import Settings
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener


def information_of(system: System, estimate: Estimate, scale: Array) -> Array:
    """Fisher information of a campaign's readings about the scaled compliances, shape (n, n).

    Args:
        system: c = B x + G e, with the noise that the campaign shows.
        estimate: Its solution; where no noise is stated, its residuals determine the noise.
        scale: Unit of each compliance, shape (n,).
    """
    white = whitener(system.errors, system.rows.pose)
    B = white(system.B) * scale
    noise = (
        1.0 if system.noise_stated else float(np.sum(white(estimate.residual) ** 2)) / estimate.dof
    )
    return np.asarray(B.T @ B / noise)


def continued(spec: ProblemFile, settings: Settings, name: str) -> ProblemFile:
    """The problem with robot, tool, noise and test pose of a campaign.

    Args:
        spec: Plan, pull, anchor and limits.
        settings: The campaign's settings.
        name: Name of the plan.

    Raises:
        InputError: The problem asks for points that the campaign's tool does not have.
    """
    content: dict[str, Any] = spec.model_dump(exclude_unset=True)
    content |= {"name": name, "robot": settings.robot, "diagnosis": None}
    names = ["load_point", *settings.measured]
    content["tool"] = {point: settings.tool[point] for point in names}
    content |= settings.around
    points = [p for p in spec.criterion.points or [] if p in settings.measured]
    content["criterion"] = content.get("criterion", {}) | {"points": points or None}
    if settings.test_pose is not None:
        content["test_pose"] = [settings.test_pose.model_dump(exclude_none=True)]
    noise = _noise(settings)
    return validated(content | ({"noise": noise} if noise else {}), "the options")


def _noise(settings: Settings) -> dict[str, Any] | None:
    tracker, scale = settings.tracker, settings.scale
    if tracker is None or scale is None:
        return None
    beam = settings.reading_noise
    stated = beam if isinstance(beam, str) or beam is None else beam.model_dump()
    reading = given({"reading_sigma_m": tracker.sigma_m, "tracker": stated})
    if not reading:
        return None
    return reading | {"scale_sigma_n": scale.sigma_n, "scale_sigma_rel": scale.sigma_rel}
