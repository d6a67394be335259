"""A target that [tool] has in the wrong place: the effector's own triangle contradicts it.

No pose, no joint table and no base frame plays a part in distances within the effector. Left as it
is, the wrong lever would be laid on readings, and on the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
from pipeline.base.linear import rigid
from pipeline.faults.conventions import FEWEST_POSES, unloaded
from pipeline.faults.fault import Fault
from pipeline.faults.labels import GROSS_M
from pipeline.faults.mistake import Mistake, outlying
from pipeline.machine.robot import configure
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ


def tool_target(case: Case) -> list[Mistake]:
    """The one target whose distances to all others are not those of [tool], and theirs are.

    Distances are medians over the unloaded states. Put right, the target is where its readings put
    it: the mean over the poses in the flange frame, the robot's table moved onto the other targets.
    """
    names, zeros = case.settings.measured, unloaded(case)
    if len(names) < 3 or zeros["pose"].nunique() < FEWEST_POSES:
        return []
    seen, stated = _distances(zeros, names), _between(case.tool.points)
    wrong = np.abs(seen - stated) > GROSS_M
    pair = ~np.eye(len(names), dtype=bool)
    alone = [t for t in range(len(names)) if (wrong | ~pair)[t].all()]
    if len(alone) != 1 or np.delete(np.delete(wrong, alone, 0), alone, 1).any():
        return []
    t = alone[0]
    return [_finding(case, zeros, names, t, seen[t], stated[t])]


def _between(points: Array) -> Array:
    """Distances [m] between points (..., t, 3), shape (..., t, t)."""
    return np.asarray(np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1))


def _distances(zeros: pd.DataFrame, names: Sequence[str]) -> Array:
    """Median distance between targets over states, NaN where never read together, (t, t)."""
    groups = pd.Index(zeros["group"].unique())
    at = {name: zeros[zeros["target"] == name].drop_duplicates("group") for name in names}
    there = [at[name].set_index("group")[XYZ].reindex(groups).to_numpy(float) for name in names]
    points = np.stack(there, axis=1)
    every = pd.DataFrame(_between(points).reshape(len(points), -1)).median()  # NaN left out
    return every.to_numpy(float).reshape(len(names), len(names))


def _finding(
    case: Case, zeros: pd.DataFrame, names: Sequence[str], t: int, seen: Array, stated: Array
) -> Mistake:
    name, place = names[t], _read_at(case, zeros, names[t])
    size = float(np.linalg.norm(place - case.tool.points[t]))
    pairs = [k for k in range(len(names)) if k != t]
    told = " and ".join(
        f"{1e3 * seen[k]:.0f} mm from {names[k]} ([tool]: {1e3 * stated[k]:.0f} mm)" for k in pairs
    )
    where = ", ".join(f"{x:.4f}" for x in place)
    return outlying(
        name,
        f"the target {name} was read {told}, and the distances between the others are right: its "
        f"place in [tool] is wrong by {1e3 * size:.0f} mm",
        f"recomputed with {name} at [{where}] m, where the readings put it",
        before=1e3 * float(np.abs(seen - stated)[pairs].max()),
        unit="mm",
        size=size,
        correct=partial(_moved, name=name, place=place),
    )


def _read_at(case: Case, zeros: pd.DataFrame, name: str) -> Array:
    """Where a target is in the flange frame [m], the other targets telling where the flange is."""
    poses, at = np.unique(zeros["pose"].to_numpy(int), return_inverse=True)
    target = pd.Index(case.settings.measured).get_indexer(pd.Index(zeros["target"]))
    frame = np.vstack([np.zeros(3), np.eye(3)])
    origin, *ends = np.moveaxis(configure(case.robot, case.q(poses)).points(frame), 1, 0)
    axes = np.stack([end - origin for end in ends], axis=2)
    expected = origin[at] + np.einsum("nij,nj->ni", axes[at], case.tool.points[target])
    mine = (zeros["target"] == name).to_numpy()
    seen = zeros[XYZ].to_numpy(float)
    R, t = rigid(seen[~mine], expected[~mine])
    own = seen[mine] @ R.T + t - origin[at[mine]]
    return np.asarray(np.einsum("nji,nj->ni", axes[at[mine]], own).mean(axis=0))


def _moved(case: Case, name: str, place: Array) -> Case:
    """The campaign with a target of [tool] in another place."""
    tool = {**case.settings.tool, name: (float(place[0]), float(place[1]), float(place[2]))}
    return replace(case, settings=case.settings.model_copy(update={"tool": tool}))


FAULT = Fault("outlier", "outlying reading", lambda asked: tool_target(asked.case), in_files=True)
