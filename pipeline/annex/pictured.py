"""Tables that are there for the figures of the annex alone."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.annex.fewer_poses import enough
from pipeline.annex.seen_laws import laws
from pipeline.answer.findings import Findings
from pipeline.base.arrays import Ints
from pipeline.machine.effect import Pulls
from pipeline.reduction.bring import Keep, Step


def pictured(found: Findings, keep: Keep, step: Step) -> dict[str, pd.DataFrame]:
    """The worth of poses, and the laws of causes."""
    values = found.told.values
    seen = step(laws)(values.first, values.fitted.data)
    return {
        "enough": keep("47_enough", _enough(found, step), tables.ENOUGH),
        "laws": keep("53_laws", seen, tables.LAWS),
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
