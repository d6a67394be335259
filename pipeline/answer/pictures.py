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
from pipeline.base.arrays import Ints
from pipeline.diagnosis.laws import laws
from pipeline.machine.effect import Pulls
from pipeline.prediction.workspace import arm_in_plane
from pipeline.reduction.bring import Keep, Step
from pipeline.system.enough import enough

_Tables = dict[str, pd.DataFrame]


def pictured(found: Findings, keep: Keep, step: Step) -> _Tables:
    """The scene, the models beside each other, the worth of poses, laws of causes, the arm."""
    values, right = found.told.values, found.right
    nominal = np.array([1 / (joint.stiffness or np.nan) for joint in right.case.robot.joints])
    left = values.first.estimate.residual
    models = models_table(right.system, right.estimate, left, nominal)
    seen = step(laws)(values.first, values.fitted.data)
    arm = step(arm_in_plane)(right.case.cell, found.where)
    return {
        "covariance": covariance_table(values.parameters, values.found.cov),
        "models": keep("46_models", models, tables.MODELS),
        "enough": keep("47_enough", _enough(found, step), tables.ENOUGH),
        "laws": keep("53_laws", seen, tables.LAWS),
        "arm": keep("63_arm", arm, tables.ARM),
        "posture": keep(
            "73_posture", step(posture)(found.told.model.hypotheses[0], found.where), tables.POSTURE
        ),
        **kept_scene(step(scene)(values), keep),
    }


def kept_scene(made: Mapping[str, pd.DataFrame], keep: Keep) -> _Tables:
    """The tables of a scene, checked and kept."""
    return {
        "scene": keep("70_scene", made["scene"], tables.SCENE),
        "poses": keep("71_poses", made["poses"], tables.POSES),
        "vectors": keep("72_vectors", made["vectors"], tables.VECTORS),
    }


def _enough(found: Findings, step: Step) -> pd.DataFrame:
    """Table ENOUGH of the stiffnesses that have a value."""
    values = found.told.values
    first, robot = values.first, values.fitted.case.robot
    size = np.where(values.found.identifiable, np.abs(values.found.value), 0.0)[: robot.n]
    names = [f"k_{joint.name}" for joint in robot.joints]
    order = _as_measured(values.fitted.data.pulls)
    return step(enough)(first.system, size, names, order, first.ratio)


def _as_measured(pulls: Pulls) -> Ints:
    """Poses in the order of measuring, by number where no time is known, (p,)."""
    order = np.lexsort((pulls.pose, np.nan_to_num(pulls.time)))
    poses, first = np.unique(pulls.pose[order], return_index=True)
    return np.asarray(poses[np.argsort(first)])
