"""Tables of a run: what each holds, and all that a run keeps and shows of its answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer.recommended import ModelValues
from pipeline.answer.results import CampaignResults, ReportedModel
from pipeline.base import doors
from pipeline.base.arrays import Array, Parameter
from pipeline.diagnosis.average import Springs
from pipeline.prediction.model import IdentifiedModel
from pipeline.reduction.bring import Keep, Step
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener

_AXES = np.array(["x", "y", "z"], dtype=object)


def rows_table(system: System) -> pd.DataFrame:
    """Number, pose, repeat, target and axis of each row of a system."""
    rows = system.rows
    return pd.DataFrame(
        {
            "row": np.arange(len(rows)),
            "pose": rows.pose,
            "repeat": rows.repeat,
            "target": rows.target,
            "axis": _AXES[rows.axis],
        }
    )


def _system_table(system: System) -> pd.DataFrame:
    """Table `tables.system`."""
    columns = {f"B_{p.name}": system.B[:, k] for k, p in enumerate(system.parameters)}
    return rows_table(system).assign(c_m=system.c, **columns)


def _errors_table(system: System) -> pd.DataFrame:
    """Table ERRORS."""
    G = system.errors.G.tocoo()
    return pd.DataFrame(
        {
            "error": G.col,
            "source": system.errors.source[G.col],
            "common": system.errors.common[G.col],
            "row": G.row,
            "value_m": G.data,
        }
    )


def _residuals_table(system: System, estimate: Estimate, left_out_m: Array) -> pd.DataFrame:
    """Table RESIDUALS; without stated noise, the residuals are whitened by their own scatter.

    Args:
        system: The system.
        estimate: Its solution.
        left_out_m: Residuals of each pose when it is left out of the estimate [m], shape (M,).
    """
    whitened = whitener(system.errors, system.rows.pose)(estimate.residual)
    if not system.noise_stated:
        whitened = whitened / np.sqrt(np.sum(whitened**2) / max(estimate.dof, 1))
    return rows_table(system).assign(
        residual_m=estimate.residual, whitened=whitened, left_out_m=left_out_m
    )


def _estimate_table(names: Sequence[Parameter], found: Estimate | Springs) -> pd.DataFrame:
    """Table ESTIMATE."""
    return pd.DataFrame(
        {
            "parameter": [p.name for p in names],
            "unit": [p.unit for p in names],
            "value": found.value,
            "std": found.std,
            "identifiable": found.identifiable,
        }
    )


def covariance_table(names: Sequence[Parameter], cov: Array) -> pd.DataFrame:
    """Table `tables.covariance`."""
    named = [p.name for p in names]
    return pd.DataFrame(cov, columns=named).assign(parameter=named)


_ANNEX = "pipeline.annex.figure_tables:pictured"
"""Tables of the figures behind the first page."""

_VALIDATED = "pipeline.annex.validate:validated"
"""Deflections drawn from what the estimate leaves open."""

_CORRECTED = (("22_forces", tables.FORCES), ("23_displacements", tables.DISPLACEMENTS))
"""Tables that a mistake in the data changes, and that the answer rests on."""


def predicted(
    model: IdentifiedModel, values: ModelValues, where: PoseOfInterest, step: Step
) -> ReportedModel:
    """One model's values with what they predict."""
    checked, validated = None, doors.found(_VALIDATED)
    if validated and values.found.identifiable.any():
        checked = step(validated)(values.hypotheses, where)
    return ReportedModel(values, model, checked)


def kept(found: CampaignResults, keep: Keep, step: Step) -> dict[str, pd.DataFrame]:
    """The tables of the answer, and of the joint springs beside it."""
    values, paper = found.told.values, found.springs.values
    system = values.first.system.of_pulls
    if found.mistakes:  # what the answer rests on stands under the usual names
        given, used = found.given.reduced.shown, found.right.reduced.shown
        for name, promise in _CORRECTED:
            part = name[3:]
            keep(f"{name}_as_given", given[part], promise)
            keep(name, used[part], promise)
    keep("30_system", _system_table(system), tables.system(system.parameters))
    keep("31_errors", _errors_table(system), tables.ERRORS)
    for suffix, one in (("", values), ("_joint_springs", paper)):
        names, estimate = one.parameters, one.found
        keep(f"40_estimate{suffix}", _estimate_table(names, estimate), tables.ESTIMATE)
        cov = covariance_table(names, estimate.cov)
        keep(f"41_covariance{suffix}", cov, tables.covariance(names))
    residuals = _residuals_table(system, values.first.estimate, values.left_out_m)
    pictured = doors.found(_ANNEX)
    return (pictured(found, keep, step) if pictured else {}) | {
        "residuals": keep("42_residuals", residuals, tables.RESIDUALS),
        **_path(found, keep),
    }


def _path(found: CampaignResults, keep: Keep) -> dict[str, pd.DataFrame]:
    """The machining path, where [tolerance] names one."""
    path = found.judged.path
    return {} if path is None else {"path": keep("63_path", path, tables.PATH)}
