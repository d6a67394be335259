"""Tables that only the figures of the annex need."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.annex.fewer_poses import enough
from pipeline.annex.scene import scene, scene_of_positions
from pipeline.annex.seen_laws import laws
from pipeline.answer.results import CampaignResults
from pipeline.answer.tables import covariance_table, models_table
from pipeline.base.arrays import Ints
from pipeline.geometry.study import Study
from pipeline.machine.effect import Pulls
from pipeline.prediction.workspace import arm_in_plane
from pipeline.reduction.bring import Keep, Step

_Tables = dict[str, pd.DataFrame]


def pictured(found: CampaignResults, keep: Keep, step: Step) -> _Tables:
    """Tables of the scene, comparison of models, arm, covariance, number of poses, and laws."""
    values, right = found.told.values, found.right
    nominal = np.array([1 / (joint.stiffness or np.nan) for joint in right.case.robot.joints])
    left = values.first.estimate.residual
    models = models_table(right.system, right.estimate, left, nominal)
    arm = step(arm_in_plane)(right.case.cell, found.where)
    seen = step(laws)(values.first, values.fitted.data)
    return {
        "covariance": covariance_table(values.parameters, values.found.cov),
        "models": keep("46_models", models, tables.MODELS),
        "arm": keep("63_arm", arm, tables.ARM),
        **_kept(step(scene)(values), keep),
        "enough": keep("47_enough", _enough(found, step), tables.ENOUGH),
        "laws": keep("53_laws", seen, tables.LAWS),
    }


def of_positions(found: Study, keep: Keep, step: Step) -> _Tables:
    """Tables of the scene of a campaign of positions."""
    return _kept(step(scene_of_positions)(found), keep)


def _kept(made: _Tables, keep: Keep) -> _Tables:
    """Check and keep the tables of a scene."""
    return {
        "scene": keep("70_scene", made["scene"], tables.SCENE),
        "poses": keep("71_poses", made["poses"], tables.POSES),
        "vectors": keep("72_vectors", made["vectors"], tables.VECTORS),
    }


def _enough(found: CampaignResults, step: Step) -> pd.DataFrame:
    """Table ENOUGH; a stiffness without a value has an infinite relative uncertainty."""
    values = found.told.values
    first, robot = values.first, values.fitted.case.robot
    size = np.where(values.found.identifiable, np.abs(values.found.value), 0.0)[: robot.n]
    names = [f"k_{joint.name}" for joint in robot.joints]
    order = _as_measured(values.fitted.data.pulls)
    return step(enough)(first.system, size, names, order, first.ratio)


def _as_measured(pulls: Pulls) -> Ints:
    """Poses in the order of measuring, or by number where no time is known, shape (p,)."""
    order = np.lexsort((pulls.pose, np.nan_to_num(pulls.time)))
    poses, first = np.unique(pulls.pose[order], return_index=True)
    return np.asarray(poses[np.argsort(first)])
