"""Values of one model: its stiffnesses, its fit, its predictions and their validation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from pipeline.answer import contract
from pipeline.answer.contract import Drawn, Fit, NoiseFrom, TargetDeflection, Validation
from pipeline.answer.recommended import ModelValues, left_out_mm
from pipeline.answer.results import ReportedModel
from pipeline.answer.stiffness import stiffness_entries
from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.machine.cell import Cell
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.validate import by_payload
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
    left, checked = reported.values.left_out_m, reported.checked
    validation = (
        None if checked is None else _validation_entry(checked, left, where, reported.values)
    )
    return contract.Values(validation=validation, **stated(reported.values, reported.model, where))


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


def _validation_entry(
    checked: pd.DataFrame, left_out_m: Array, where: PoseOfInterest, values: ModelValues
) -> Validation:
    """Means of Eq. (22) per target, with full covariance and as in Eq. (23), and held-out error.

    Args:
        checked: Table VALIDATION.
        left_out_m: Cross-validation residuals [m]; NaN where no other pose predicts them.
        where: The test pose.
        values: The model's values, with the campaign from which they were estimated.
    """
    fitted = values.fitted
    loads = by_payload(fitted.case.settings, fitted.data, values.first.system)
    full = _drawn(checked, "covariance")
    return Validation(
        test_pose=full.test_pose,
        global_=full.global_,
        held_out_rms_mm=left_out_mm(left_out_m),
        independent=_drawn(checked, "independent"),
        poses=int(checked["index"].max()),
        test_pose_stated=where.stated,
        by_payload={name: None if r is None else 1e3 * r for name, r in loads.items()},
    )


def _drawn(checked: pd.DataFrame, draw: str) -> Drawn:
    """Means for one distribution of the stiffnesses, `covariance` or `independent`."""
    drawn = checked[checked["draw"] == draw]
    near, far = (drawn[drawn["set"] == name] for name in ("test_pose", "global"))
    return Drawn(test_pose=_means(near), global_=_means(far))


def _means(rows: pd.DataFrame) -> contract.PerTarget:
    """Mean relative error of each target, in their order."""
    means = rows.groupby("target", sort=False)["mu"].mean()
    return {str(target): float(mean) for target, mean in means.items()}


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
