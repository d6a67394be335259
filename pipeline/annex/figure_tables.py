"""Tables that only the figures of the annex need."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.annex import promises
from pipeline.annex.diagnosis_tables import apart_table, clues_table, examined_table
from pipeline.annex.position_tables import identified
from pipeline.annex.posture import posture, standing_posture
from pipeline.annex.scene import scene, scene_of_positions
from pipeline.annex.seen_laws import laws
from pipeline.annex.validate import none as no_validation
from pipeline.annex.workspace import arm_in_plane, workspace
from pipeline.annex.workspace import none as no_workspace
from pipeline.answer.results import CampaignResults
from pipeline.answer.tables import covariance_table, rows_table
from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Pulls
from pipeline.reduction.bring import Keep, Step
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener

if TYPE_CHECKING:
    from pipeline.positions.study import Study

_Tables = dict[str, pd.DataFrame]


def pictured(found: CampaignResults, keep: Keep, step: Step) -> _Tables:
    """Tables of the scene, of what causes explain, of the workspace, and of the readings."""
    values, right = found.told.values, found.right
    nominal = np.array([1 / (joint.stiffness or np.nan) for joint in right.case.robot.joints])
    left = values.first.estimate.residual
    models = models_table(right.system, right.estimate, left, nominal)
    arm = step(arm_in_plane)(right.case.cell, found.where)
    seen = step(laws)(values.first, values.fitted.data)
    posed = step(posture)(found.told.model.hypotheses[0], found.where)
    checked = no_validation() if found.told.checked is None else found.told.checked
    return {
        "covariance": covariance_table(values.parameters, values.found.cov),
        "models": keep("46_models", models, promises.MODELS),
        "arm": keep("63_arm", arm, promises.ARM),
        **_kept(step(scene)(values), keep),
        "enough": keep("47_enough", _enough(found, step), promises.ENOUGH),
        "laws": keep("53_laws", seen, promises.LAWS),
        **_examined(found, keep),
        **_soft(found, keep, step),
        **_controlled(found, keep),
        "posture": keep("73_posture", posed, promises.POSTURE),
        "validation": keep("60_validation", checked, promises.VALIDATION),
    }


def _examined(found: CampaignResults, keep: Keep) -> _Tables:
    """What the diagnosis examined, and which causes can be told apart."""
    right, diagnosis = found.right, found.diagnosis
    rows = examined_table(diagnosis, right.case.cell, right.data, right.system, right.estimate)
    return {
        "examined": keep("50_examined", rows, promises.examined(found.raw.robot)),
        "diagnosis": keep("51_diagnosis", clues_table(diagnosis), promises.DIAGNOSIS),
        "separability": keep("52_separability", apart_table(diagnosis), promises.SEPARABILITY),
    }


def _soft(found: CampaignResults, keep: Keep, step: Step) -> _Tables:
    """Compliance over the workspace, by the recommended values and by the joint springs alone."""
    mine, alone = found.told.model.hypotheses, found.springs.model.hypotheses
    here = step(workspace)(mine, found.where)
    same = found.mistakes or alone is mine
    other = no_workspace() if same else workspace(alone, found.where)
    return {
        "workspace": keep("61_workspace", here, promises.WORKSPACE),
        "workspace_joint_springs": keep("62_workspace_joint_springs", other, promises.WORKSPACE),
    }


def _controlled(found: CampaignResults, keep: Keep) -> _Tables:
    """How the readings check each other."""
    if found.control is None:
        return {}
    keep("44_influence", found.control.pulls, promises.INFLUENCE)
    return {"reliability": keep("43_reliability", found.control.readings, tables.RELIABILITY)}


def of_positions(found: Study, keep: Keep, step: Step) -> _Tables:
    """Tables of the figures of a campaign of positions."""
    return {
        **identified(found, keep),
        **_kept(step(scene_of_positions)(found), keep),
        "posture": keep("73_posture", _standing(found), promises.POSTURE),
    }


def _standing(found: Study) -> pd.DataFrame:
    """The robot at the first pose, for the picture on the certificate."""
    mechanism, readings = found.final.mechanism, found.final.readings
    points = mechanism.tool[:, :3, 3]
    tool = Tool(points[0], np.array(readings.targets, dtype=object), points)
    return standing_posture(mechanism.robot, tool, readings.q[0])


def _kept(made: _Tables, keep: Keep) -> _Tables:
    """Check and keep the tables of a scene."""
    return {
        "scene": keep("70_scene", made["scene"], promises.SCENE),
        "poses": keep("71_poses", made["poses"], promises.POSES),
        "vectors": keep("72_vectors", made["vectors"], promises.VECTORS),
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


def models_table(springs: System, paper: Estimate, residual: Array, nominal: Array) -> pd.DataFrame:
    """Table MODELS.

    Args:
        springs: The system of the joint springs.
        paper: Its solution.
        residual: Residuals of the recommended model [m], shape (M,).
        nominal: Compliances of the robot file, NaN where it states none, shape (n,).
    """
    return rows_table(springs).assign(
        measured_m=springs.c,
        nominal_m=springs.B @ nominal,
        joint_springs_m=springs.c - paper.residual,
        recommended_m=springs.c - residual,
    )


_STEPS = 14
"""Maximum number of steps in the number of poses."""


def enough(
    system: System, size: Array, names: list[str], order: Ints, ratio: float = 1.0
) -> pd.DataFrame:
    """Relative standard uncertainty of parameters as a function of the number of poses.

    u_j(n) = s sqrt([(sum_(p <= n) X_p' X_p + P)^-1]_jj) / |x_j| with X_p the whitened rows of the
    p-th pose and P the priors of the errors common to all poses, which further poses reduce only as
    far as they determine these errors. s is `ratio`. The last step has every pose twice.

    Args:
        system: c = B x + G e about the estimate.
        size: |x_j|, in the order of the system's first parameters, shape (k,).
        names: Names of these parameters.
        order: Poses in the order of measuring, shape (p,).
        ratio: Ratio of found to stated scatter that the uncertainties of the estimate include [1].

    Returns:
        Table ENOUGH.
    """
    white = whitener(system.errors, system.rows.pose)
    X = np.hstack([white.with_priors(system.B * system.typical), white.columns])
    rank = _ranks(system, white, order)
    parts = []
    for count, weight in [*((n, 1.0) for n in _counts(len(order))), (2 * len(order), np.sqrt(2.0))]:
        rows = X[rank < count] * np.where(rank[rank < count] < 0, 1.0, weight)[:, None]
        var = np.diag(linear.pseudoinverse(rows).cov)[: len(size)]
        std = ratio * np.sqrt(var) * system.typical[: len(size)]
        parts.append(_part(count, names, std, size))
    return pd.concat(parts, ignore_index=True)


def _ranks(system: System, white: Whitener, order: Ints) -> Ints:
    """Rank of each row's pose in the order of measuring, from 0; -1 for priors."""
    place = {pose: k for k, pose in enumerate(order.tolist())}
    own = [place.get(pose, -1) for pose in system.rows.pose.tolist()]
    return np.array(own + [-1] * white.common.shape[1], dtype=np.int64)


def _counts(poses: int) -> list[int]:
    """Numbers of poses from two to all, in a geometric progression."""
    steps = np.geomspace(min(2, poses), poses, _STEPS).round().astype(int)
    return [int(n) for n in np.unique(steps)]


def _part(count: int, names: list[str], std: Array, size: Array) -> pd.DataFrame:
    share = np.divide(std, size, out=np.full(len(size), np.inf), where=size > 0)
    return pd.DataFrame({"poses": count, "parameter": names, "relative_std": share})
