"""Tables that a run keeps and shows: of the answer, and of the joint springs beside it."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer.posture import posture
from pipeline.answer.recommended import ModelValues
from pipeline.answer.results import CampaignResults, ReportedModel
from pipeline.answer.tables import (
    covariance_table,
    errors_table,
    estimate_table,
    residuals_table,
    system_table,
)
from pipeline.base import doors
from pipeline.diagnosis.tables import apart_table, clues_table, examined_table
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.validate import none as no_validation
from pipeline.prediction.validate import validate
from pipeline.prediction.workspace import none as no_workspace
from pipeline.prediction.workspace import workspace
from pipeline.reduction.bring import Keep, Step
from pipeline.reduction.pose_of_interest import PoseOfInterest

_SEED = 20261103
"""Of its draws: another one moves numbers within what they say of their scatter."""

_ANNEX = "pipeline.annex.figure_tables:pictured"
"""Tables of the figures behind the first page."""

_CORRECTED = (("22_forces", tables.FORCES), ("23_displacements", tables.DISPLACEMENTS))
"""Tables that a mistake in the data changes, and that the answer rests on."""


def predicted(
    model: IdentifiedModel, values: ModelValues, where: PoseOfInterest, step: Step
) -> ReportedModel:
    """One model's values with what they predict."""
    checked = None
    if values.found.identifiable.any():
        checked = step(validate)(values.hypotheses, where, np.random.default_rng(_SEED))
    return ReportedModel(values, model, checked)


def kept(found: CampaignResults, keep: Keep, step: Step) -> dict[str, pd.DataFrame]:
    """The tables of the answer, and of the joint springs beside it."""
    values, paper, where = found.told.values, found.springs.values, found.where
    system, said = values.first.system.of_pulls, found.diagnosis
    if found.mistakes:  # what the answer rests on stands under the usual names
        given, used = found.given.reduced.shown, found.right.reduced.shown
        for name, promise in _CORRECTED:
            part = name[3:]
            keep(f"{name}_as_given", given[part], promise)
            keep(name, used[part], promise)
    keep("30_system", system_table(system), tables.system(system.parameters))
    keep("31_errors", errors_table(system), tables.ERRORS)
    for suffix, one in (("", values), ("_joint_springs", paper)):
        names, held = one.parameters, one.found
        keep(f"40_estimate{suffix}", estimate_table(names, held), tables.ESTIMATE)
        cov = covariance_table(names, held.cov)
        keep(f"41_covariance{suffix}", cov, tables.covariance(names))
    residuals = residuals_table(system, values.first.estimate, values.left_out_m)
    cell, data = found.right.case.cell, found.right.data
    keep("44_influence", found.carried, tables.INFLUENCE)
    examined = examined_table(said, cell, data, found.right.system, found.right.estimate)
    mine, alone = found.told.model.hypotheses, found.springs.model.hypotheses
    soft = step(workspace)(mine, where)
    other = no_workspace() if found.mistakes or alone is mine else workspace(alone, where)
    checked = no_validation() if found.told.checked is None else found.told.checked
    posed = step(posture)(mine[0], where)
    pictured = doors.found(_ANNEX)
    return (pictured(found, keep, step) if pictured else {}) | {
        "posture": keep("73_posture", posed, tables.POSTURE),
        "residuals": keep("42_residuals", residuals, tables.RESIDUALS),
        "reliability": keep("43_reliability", found.control, tables.RELIABILITY),
        "examined": keep("50_examined", examined, tables.examined(found.raw.robot)),
        "diagnosis": keep("51_diagnosis", clues_table(said), tables.DIAGNOSIS),
        "separability": keep("52_separability", apart_table(said), tables.SEPARABILITY),
        "validation": keep("60_validation", checked, tables.VALIDATION),
        "workspace": keep("61_workspace", soft, tables.WORKSPACE),
        **_path(found, keep),
        "workspace_joint_springs": keep("62_workspace_joint_springs", other, tables.WORKSPACE),
    }


def _path(found: CampaignResults, keep: Keep) -> dict[str, pd.DataFrame]:
    """The machining path, where [tolerance] names one."""
    path = found.judged.path
    return {} if path is None else {"path": keep("63_path", path, tables.PATH)}
