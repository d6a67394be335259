"""Covariances of an export that are stated in another frame than the coordinates beside them.

The columns are read as along the axes of the tracker. Some software states them along the axes of
the base frame, some along the beam and across it. What no model of the robot can make of the
readings (`contrasts.pure_error`) scatters along the axes that are right: with L minus twice the
restricted log likelihood, the scale of all covariances free, another frame has p = exp((L - L_0) /
2) for each that is tried, as no ratio of likelihoods is above 1 / p more often than p where the
frame is as read (Markov). It is named where the scatter then is the stated one, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools
from pipeline.faults.conventions import with_covariance
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms
from pipeline.system.assemble import TRACKED
from pipeline.system.contrasts import pure_error
from pipeline.system.noise import TOLERATED
from pipeline.system.restricted import Blocks, lowest

_FEWEST = 30
"""Contrasts below which their scatter says nothing of axes."""

_ROUND = 0.1
"""Difference of the variances along the axes, over their mean, that no frame changes much [1]."""


def other_frame(asked: Screening) -> list[Mistake]:
    """The frame in which the covariances are stated, where it is not the one of the tracker."""
    case = asked.case
    own = (case.readings["covariance_from"] == "file").to_numpy()
    if not own.any() or case.settings.displacements is not None or not _elongated(case, own):
        return []
    seen = _scatter(asked)
    if seen is None:
        return []
    R, frames = asked.reduced.registration.R, []
    for says, axes in (("the base frame", partial(_base, R)), ("the beam", _beam)):
        correct = partial(_stated_along, own, axes)
        found = _scatter(replace(asked, case=correct(case), known=None))
        frames.append((found or (np.inf, np.inf), says, correct))
    (loss, scale), says, correct = min(frames, key=lambda one: one[0][0])
    p = len(frames) * float(np.exp(min(loss - seen[0], 0.0) / 2))
    if p >= alarms.FRAME or abs(np.log(scale)) > np.log(TOLERATED):
        return []
    return [
        Mistake(
            name="sign_or_convention",
            where="covariance_frame",
            evidence=f"the uncertainties of the readings are stated along {says} and were read "
            f"along the axes of the tracker: the reflectors of the effector scatter against each "
            f"other {seen[1]:.2f} times as stated as given, {scale:.2f} times with that corrected",
            correction=f"recomputed with the uncertainties along {says}",
            before=seen[1],
            after=scale,
            unit="1",
            p_value=p,
            correct=correct,
        )
    ]


def _scatter(asked: Screening) -> tuple[float, float] | None:
    """Minus twice the restricted log likelihood of the contrasts, and their scale over the stated.

    None where there are too few.
    """
    left = asked.estimate.residual
    pure = pure_error(asked.system, left, asked.reduced.data, asked.zeros, asked.cell)
    if len(pure.rows) < _FEWEST:
        return None
    blocks = Blocks.of(pure, pure.B, [TRACKED])
    t = lowest(blocks.of_scales(np.array([True])), np.array([blocks.rough]))
    return blocks.whole(t), float(np.exp(t[0]))


def _elongated(case: Case, own: Bools) -> bool:
    values = linear.directions(covariance.matrices(case.readings[own]))[0]
    return bool(np.median(np.ptp(values, axis=1) / values.mean(axis=1)) > _ROUND)


def _stated_along(own: Bools, axes: Callable[[Array], Array], case: Case) -> Case:
    """The covariances of some rows turned from axes (m, 3, 3), by columns, into the tracker's."""
    C = covariance.matrices(case.readings)
    A = axes(case.readings[list(XYZ)].to_numpy(float)[own])
    C[own] = A @ C[own] @ np.swapaxes(A, 1, 2)
    return replace(case, readings=with_covariance(case.readings, covariance.flat(C)))


def _base(R: Array, points: Array) -> Array:
    """Axes of F_b in the frame of the tracker."""
    return np.broadcast_to(R.T, (len(points), 3, 3))


def _beam(points: Array) -> Array:
    """Along the beam to each point, then across it level and upright, in the tracker's frame."""
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    level = np.cross([0.0, 0.0, 1.0], along)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.stack([along, level, np.cross(along, level)], axis=2)


FAULT = Fault(
    "sign_or_convention", "covariances stated in another frame", other_frame, in_files=True
)
