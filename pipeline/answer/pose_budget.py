"""Uncertainty budget of the deflection at the test pose; its parts add up to the total."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from pipeline.answer.contract import PosePart, TestPose
from pipeline.answer.recommended import ModelValues
from pipeline.base.arrays import Array
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import jacobian, predict
from pipeline.machine.effect import Pulls
from pipeline.prediction.model import IdentifiedModel, of_machine
from pipeline.prediction.model import ModelHypothesis as Handed
from pipeline.prediction.tolerance import TipDeflection
from pipeline.system.budget import budget

HELD_OUT = "held_out"
"""Source of the part of the cross-validation error that exceeds the other sources."""


def pose_budget(
    values: ModelValues, model: IdentifiedModel, q: Array, force: Array, at: TipDeflection
) -> tuple[PosePart, ...]:
    """Contributions to the standard uncertainty u of a deflection, along it; u^2 = sum u_s^2.

    For hypotheses h with weight w_h, the direction n of the deflection and its derivative A_h with
    respect to the parameters, source s contributes

        u_s^2 = sum_h w_h n' A_h C_hs A_h' n,   C_hs the part of s in the parameters' covariance.

    Sources of their own are the differences between the hypotheses, the neglect of the deflected
    geometry, and the part of the cross-validation error that exceeds all others.

    Args:
        values: The answer's values, with the systems from which they were estimated.
        model: The identified model made from them, hypothesis by hypothesis.
        q: Joint values of the pose [m] or [rad], shape (n,).
        force: Force at the load point in F_b [N], shape (3,).
        at: The predicted deflection.

    Returns:
        Standard uncertainties by source [mm], the largest first; empty if a stiffness that acts
        there is not determined.
    """
    u, size = float(at.std[0]), float(at.size[0])
    if not (np.isfinite(u) and size > 0):
        return ()
    along, pull = at.moved[0] / size, Pulls.at(q, force)
    found: defaultdict[str, float] = defaultdict(float)
    for one, handed in zip(values.hypotheses, model.hypotheses, strict=True):
        moved, more = _moved(handed, pull)
        found["which_cause"] += handed.weight * float(along @ (moved - at.moved[0])) ** 2
        found["second_order"] += handed.weight * float(along**2 @ more**2)
        for source, variance in _of_parameters(one, handed, pull, along).items():
            found[source] += handed.weight * variance
    found[HELD_OUT] = max(0.0, u**2 - sum(found.values()))
    return tuple(
        PosePart(source=source, std_mm=1e3 * float(np.sqrt(variance)))
        for source, variance in sorted(found.items(), key=lambda item: -item[1])
        if variance > _ROUNDING * u**2
    )


def lowered_by_pulls(pose: TestPose | None) -> bool:
    """Whether more pulls lower the uncertainty; it is never below the cross-validation error."""
    return pose is None or all(part.source != HELD_OUT for part in pose.budget)


_ROUNDING = 1e-9
"""Share of the variance below which a contribution is rounding error and is omitted [1]."""


def _of_parameters(one: Hypothesis, handed: Handed, pull: Pulls, along: Array) -> dict[str, float]:
    """Variance of the deflection along a direction [m^2] by source of error of the parameters."""
    cell = replace(handed.at(), equilibrium="undeformed")
    a = along @ jacobian(cell, pull, handed.value).reshape(3, -1)
    mine = of_machine(one.cell)
    own, more = a[: mine.sum()], a[mine.sum() :]
    split = budget(one.system, one.estimate)
    parts = one.ratio**2 * np.einsum("i,sij,j->s", own, split.cov[:, mine][:, :, mine], own)
    beyond = handed.cov[mine.sum() :, mine.sum() :]  # of laws outside the range of the readings
    found = dict(zip(split.source.tolist(), parts.tolist(), strict=True))
    return found | {"law": found.get("law", 0.0) + float(more @ beyond @ more)}


def _moved(handed: Handed, pull: Pulls) -> tuple[Array, Array]:
    """Deflection of the load point, and its change by the deflected geometry [m], both (3,)."""
    cell = handed.at()
    bent = replace(cell, equilibrium="deformed")
    here, there = (predict(one, pull, handed.value).displacement[0, 0] for one in (cell, bent))
    return here, there - here
