"""Tables that are there for the figures alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer.findings import Findings
from pipeline.answer.posture import posture
from pipeline.answer.scene import scene
from pipeline.answer.tables import covariance_table, models_table
from pipeline.base import doors
from pipeline.prediction.workspace import arm_in_plane
from pipeline.reduction.bring import Keep, Step

_ANNEX = "pipeline.annex.pictured:pictured"
"""Tables of the figures behind the first page."""

_Tables = dict[str, pd.DataFrame]


def pictured(found: Findings, keep: Keep, step: Step) -> _Tables:
    """The scene, the models beside each other, the arm; and what the annex draws."""
    annexed = doors.found(_ANNEX)
    values, right = found.told.values, found.right
    nominal = np.array([1 / (joint.stiffness or np.nan) for joint in right.case.robot.joints])
    left = values.first.estimate.residual
    models = models_table(right.system, right.estimate, left, nominal)
    arm = step(arm_in_plane)(right.case.cell, found.where)
    return {
        "covariance": covariance_table(values.parameters, values.found.cov),
        "models": keep("46_models", models, tables.MODELS),
        "arm": keep("63_arm", arm, tables.ARM),
        "posture": keep(
            "73_posture", step(posture)(found.told.model.hypotheses[0], found.where), tables.POSTURE
        ),
        **kept_scene(step(scene)(values), keep),
        **(annexed(found, keep, step) if annexed else {}),
    }


def kept_scene(made: Mapping[str, pd.DataFrame], keep: Keep) -> _Tables:
    """The tables of a scene, checked and kept."""
    return {
        "scene": keep("70_scene", made["scene"], tables.SCENE),
        "poses": keep("71_poses", made["poses"], tables.POSES),
        "vectors": keep("72_vectors", made["vectors"], tables.VECTORS),
    }
