"""Values of one model: its stiffnesses, its fit, its predictions and their validation."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.answer import contract
from pipeline.answer.contract import Drawn, Fit, NoiseFrom, TargetDeflection, Validation
from pipeline.answer.recommended import ModelValues, left_out_mm
from pipeline.answer.results import ReportedModel
from pipeline.answer.stiffness import stiffness_entries
from pipeline.base import doors, linear
from pipeline.base.quantities import plain
from pipeline.diagnosis.facts import UnloadedFacts
from pipeline.machine.cell import Cell
from pipeline.prediction.model import IdentifiedModel
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.assemble import second_order
from pipeline.system.estimate import is_plausible
from pipeline.system.fit import Fitted
from pipeline.system.system import Estimate


def stated(values: ModelValues, model: IdentifiedModel, where: PoseOfInterest) -> dict[str, Any]:
    """Stiffnesses, fit and deflection at the test pose of one model."""
    fitted = values.fitted
    return {
        "stiffness": stiffness_entries(fitted.case.cell, values.hypotheses, where),
        "fit": _fit_entry(fitted, values.first.estimate),
        "test_pose_deflection": _deflection_entries(model, where),
    }


def values_entry(reported: ReportedModel, where: PoseOfInterest) -> contract.Values:
    """Stiffnesses, fit, deflection at the test pose and validation of one model."""
    return contract.Values(
        validation=_validation_entry(reported, where),
        **stated(reported.values, reported.model, where),
    )


def _fit_entry(fitted: Fitted, estimate: Estimate) -> Fit:
    """Residuals of a model of a campaign, and the test of its fit."""
    cell, data = fitted.case.cell, fitted.data
    return Fit(
        rms_mm=1e3 * linear.rms(estimate.residual),
        chi2=estimate.chi2,
        dof=estimate.dof,
        p_value=estimate.p_value,
        noise_from=NoiseFrom(estimate.noise_from),
        residual_std_mm=1e3 * estimate.residual_std_m,
        second_order_rms_mm=_second_order_mm(cell, data, estimate),
        noise_statement=_noise_statement(fitted, estimate),
    )


def _second_order_mm(cell: Cell, data: Measured, estimate: Estimate) -> float:
    """Effect of the deflected geometry on the targets, rms [mm], which c = B x neglects."""
    n = len(cell.parameters)  # the springs come first
    known = estimate.identifiable[:n] & (estimate.value[:n] > 0)
    x = np.where(known, estimate.value[:n], cell.robot.nominal_compliance)
    return 1e3 * linear.rms(second_order(cell, data, x))


_TEST = "chi-squared and its p-value rest on the noise"


def _rests_on(fitted: Fitted, noise_from: str) -> str:
    """What uncertainties and test rest on, where the noise is not that of the residuals.

    Once readings have variances of their own, these hold the scatter found, whatever is stated.
    """
    times = f"{plain(fitted.scatter, 2)} times the noise stated"
    if noise_from == "replicates":
        stated = f", {times} for the readings" if fitted.noise.stated else ""
        return (
            f"Uncertainties, {_TEST} found in the data{stated}: repeated zeros and pulls, and the "
            "effector's own triangle."
        )
    if fitted.shape.weighed:
        return (
            f"Uncertainties rest on the scatter found in the readings, {times}; {_TEST} stated for "
            "the readings."
        )
    return f"Uncertainties, {_TEST} stated for the readings."


def _of_the_test(estimate: Estimate) -> str:
    """Sentence on noise with tails in the test of the model, or on a missing test; may be empty."""
    if estimate.p_value is None:
        return " Nothing is left beside these that could test the model."
    if estimate.goodness.tails:
        return " Its p-value is that of noise with the tails that the readings show."
    return ""


def _noise_statement(fitted: Fitted, estimate: Estimate) -> str:
    """Sentences on the origin of the noise and on what depends on it."""
    if estimate.noise_from != "residuals":
        return _rests_on(fitted, estimate.noise_from) + _of_the_test(estimate)
    std = 1e3 * estimate.residual_std_m
    more = (
        "; a laser tracker measures better than that, so the model does not fit as well as a "
        "tracker measures"
        if not is_plausible(estimate, fitted.data.tracked)
        else ""
    )
    return (
        f"No noise is stated, so every uncertainty rests on the residuals' own scatter of "
        f"{std:.3f} mm; there is no independent test of the model{more}."
    )


def _validation_entry(reported: ReportedModel, where: PoseOfInterest) -> Validation | None:
    """Held-out error, and what the annex draws of Eq. (22); None where nothing is determined."""
    values, means = reported.values, doors.found(_MEANS)
    if not values.found.identifiable.any():
        return None
    return Validation(
        held_out_rms_mm=left_out_mm(values.left_out_m),
        test_pose_stated=where.stated,
        **(means(reported.checked, values) if means else _NOT_DRAWN),
    )


_MEANS = "pipeline.annex.validate:means"
"""Door of the annex: mean errors of predictions by target and by payload."""
_NONE = Drawn(test_pose={}, global_={})
_NOT_DRAWN = {"test_pose": {}, "global_": {}, "independent": _NONE, "poses": 0}


def _deflection_entries(
    model: IdentifiedModel, where: PoseOfInterest
) -> tuple[TargetDeflection, ...]:
    """Predicted deflection of each target at the test pose, with its standard uncertainty [mm]."""
    moved, std = (1e3 * part for part in model.deflection(where.q, where.force))
    return tuple(
        TargetDeflection(target=name, dx_mm=x, dy_mm=y, dz_mm=z, std_mm=(a, b, c))
        for name, (x, y, z), (a, b, c) in zip(
            model.tool.targets, moved.tolist(), std.tolist(), strict=True
        )
    )


def with_positions(values: contract.Values, stood: UnloadedFacts) -> contract.Values:
    """Values with the held-out error of unloaded positions, predicted by the estimated geometry."""
    if stood.gain is None or values.validation is None:
        return values
    off = 1e3 * np.linalg.norm(stood.gain.after.reshape(-1, 3), axis=1)
    distances = contract.HeldOutPosition(
        mean=float(off.mean()), rms=linear.rms(off), p95=float(np.quantile(off, 0.95))
    )
    checked = values.validation.model_copy(update={"held_out_position_mm": distances})
    return values.model_copy(update={"validation": checked})
