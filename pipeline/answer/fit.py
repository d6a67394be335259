"""`fit`: how well the model meets the data, and what the noise rests on."""

from __future__ import annotations

import numpy as np

from pipeline.answer.contract import Fit, NoiseFrom
from pipeline.answer.numbers import rms_mm
from pipeline.machine.cell import Cell
from pipeline.reduction.measured import Measured
from pipeline.system.assemble import second_order
from pipeline.system.estimate import fits
from pipeline.system.system import Estimate


def fit_entry(cell: Cell, data: Measured, estimate: Estimate) -> Fit:
    """How well the model meets the data."""
    return Fit(
        rms_mm=rms_mm(estimate.residual),
        chi2=estimate.chi2,
        dof=estimate.dof,
        p_value=estimate.p_value,
        noise_from=NoiseFrom(estimate.noise_from),
        residual_std_mm=1e3 * estimate.residual_std_m,
        second_order_rms_mm=_second_order_mm(cell, data, estimate),
        noise_statement=noise_statement(estimate),
    )


def _second_order_mm(cell: Cell, data: Measured, estimate: Estimate) -> float:
    """How far the deflected robot's geometry would move the targets, rms [mm]; c = B x omits it."""
    n = len(cell.parameters)  # the springs stand first
    known = estimate.identifiable[:n] & (estimate.value[:n] > 0)
    x = np.where(known, estimate.value[:n], cell.robot.nominal_compliance)
    return rms_mm(second_order(cell, data, x))


_RESTS_ON = "Uncertainties, chi-squared and its p-value rest on the noise"

_STATEMENTS = {
    "stated": f"{_RESTS_ON} stated in campaign.toml.",
    "replicates": f"{_RESTS_ON} found in the data: repeated zeros and pulls, and the effector's "
    "own triangle.",
}


def noise_statement(estimate: Estimate) -> str:
    """One sentence on where the noise comes from and what depends on it."""
    if estimate.noise_from in _STATEMENTS:
        return _STATEMENTS[estimate.noise_from]
    std = 1e3 * estimate.residual_std_m
    more = (
        "; a laser tracker measures better than that, so the model does not fit as well as a "
        "tracker measures"
        if not fits(estimate)
        else ""
    )
    return (
        f"No noise is stated, so every uncertainty rests on the residuals' own scatter of "
        f"{std:.3f} mm; there is no independent test of the model{more}."
    )
