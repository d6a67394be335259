"""Compliance map, deflection per newton over the plane that the arm sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.annex.bodies import arm_joints, links
from pipeline.annex.promises import ARM, WORKSPACE
from pipeline.base import linear
from pipeline.base.arrays import Array, Bools
from pipeline.machine.cell import Cell, jacobian, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.prediction.model import ModelHypothesis
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.tables import frame

_STEPS = 25
"""Number of values of each of the two joints that move the arm."""

_FORCE_N = 1000.0
"""Magnitude of the trial force [N]; it matters only for nonlinear effects."""

_UP = np.array([0.0, 0.0, 1.0])


def workspace(
    hypotheses: Sequence[ModelHypothesis], test: PoseOfInterest, steps: int = _STEPS
) -> pd.DataFrame:
    """Deflection of the load point per newton in the worst direction, over the arm's plane.

    Shoulder and elbow, the first two neighbouring joints with parallel axes, go through their
    ranges, up to 90 degrees from the test pose and on its side of the stretched arm; all other
    joints stay as in the test pose. The worst direction is the first singular vector of the 3 x 3
    compliance of the load point.

    Args:
        hypotheses: Possible sets of causes, weights sum to one; the uncertainty is infinite where
            an undetermined parameter acts.
        test: The test pose.
        steps: Number of values of each joint.

    Returns:
        Table WORKSPACE; row 0 is the test pose; empty for an arm without such a pair of joints.
    """
    cell = hypotheses[0].cell
    pair = arm_joints(cell.robot, test.q)
    if pair is None:
        return none()
    q, grid = _swept(cell.robot, test.q, pair, steps)
    inside, plane = _seen(configure(cell.robot, q), cell, pair)
    found = np.column_stack([grid[inside], plane[inside], *_softest(hypotheses, q[inside])])
    return pd.DataFrame(found, columns=WORKSPACE.names).astype({"row": "i4", "column": "i4"})


def _swept(robot: Robot, q: Array, pair: tuple[int, int], steps: int) -> tuple[Array, Array]:
    """Test pose, then the grid of the two joints: q (m, n) and grid indices (m, 2)."""
    low, high = np.maximum(robot.lower, q - np.pi / 2), np.minimum(robot.upper, q + np.pi / 2)
    index = np.indices((steps, steps)).reshape(2, -1).T
    swept = np.tile(q, (len(index), 1))
    for column, j in enumerate(pair):
        swept[:, j] = np.linspace(low[j], high[j], steps)[index[:, column]]
    return np.vstack([q, swept]), np.vstack([[-1, -1], index])


def _seen(here: Configuration, cell: Cell, pair: tuple[int, int]) -> tuple[Bools, Array]:
    """Visibility and coordinates of the load point in the arm's plane.

    Returns:
        Mask (m,) of poses in which the arm is bent the same way as in the first row, so that a
        point has one configuration; reach from the shoulder and height in F_b of the load point
        [m], (m, 2).
    """
    shoulder, elbow = pair
    point = here.points(cell.tool.load_point[None])[:, 0]
    axis, from_shoulder = here.axes[:, shoulder, :, 2], point - here.origin[:, shoulder]
    bend = np.einsum("mi,mi->m", axis, np.cross(from_shoulder, point - here.origin[:, elbow]))
    reach, up = _plane(here, shoulder, from_shoulder[0])
    inside = bend * (bend[0] or 1.0) > 0  # if it is stretched: positive bend
    inside[0] = True
    return inside, np.stack([from_shoulder @ reach, point @ up], axis=1)


def _plane(here: Configuration, shoulder: int, outwards: Array) -> tuple[Array, Array]:
    """Unit vectors of the first row's plane in F_b: away from the shoulder, and up, (3,) each."""
    axis = here.axes[0, shoulder, :, 2]
    up = _UP - axis * (axis @ _UP)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else here.axes[0, shoulder, :, 0]
    reach = np.cross(up, axis)
    return reach * (np.sign(outwards @ reach) or 1.0), up


def arm_in_plane(cell: Cell, test: PoseOfInterest) -> pd.DataFrame:
    """The arm at the test pose in the plane of `workspace`, table ARM; empty without a plane.

    Reach is relative to the shoulder's axis, height to F_b, as in WORKSPACE.
    """
    pair = arm_joints(cell.robot, test.q)
    if pair is None:
        return frame(ARM.empty_table())
    here = configure(cell.robot, test.q[None])
    shoulder, point = here.origin[0, pair[0]], here.points(cell.tool.load_point[None])[0, 0]
    reach, up = _plane(here, pair[0], point - shoulder)
    arm = links(cell.robot, here)[2]
    number = {joint.name: k for k, joint in enumerate(cell.robot.joints, 1)} | {"flange": 0}
    rod = np.stack([here.flange_origin[0], point])[None]
    ends = np.concatenate([arm.ends[0], rod])
    found = np.stack([(ends - shoulder) @ reach, ends @ up], axis=2).reshape(-1, 4)
    table = pd.DataFrame(found, columns=ARM.names[1:5])
    carried = [*(number[name] for name in arm.names), 0]
    thick = arm.radius[-1] if len(arm.radius) else 0.0
    return table.assign(joint=carried, radius_m=[*arm.radius, 0.35 * thick])


def _softest(hypotheses: Sequence[ModelHypothesis], q: Array) -> tuple[Array, Array, Array]:
    """Largest deflection per newton (m,), its standard uncertainty (m,), its direction (m, 3)."""
    m = len(q)
    force = np.tile(_FORCE_N * np.eye(3), (m, 1))
    pulls = Pulls.at(np.repeat(q, 3, axis=0), force)
    cells = [one.at() for one in hypotheses]
    each = [
        predict(cell, pulls, one.value).displacement.reshape(m, 3, 3) / _FORCE_N
        for cell, one in zip(cells, hypotheses, strict=True)
    ]
    moved = np.sum([one.weight * here for one, here in zip(hypotheses, each, strict=True)], axis=0)
    pulled, size, turned = linear.principal(moved)
    variance = np.zeros(m)
    for one, cell, here in zip(hypotheses, cells, each, strict=True):
        flat = replace(cell, equilibrium="undeformed")  # a sufficient approximation here
        by = jacobian(flat, pulls, one.value).reshape(m, 3, 3, -1)
        slope = np.einsum("mf,mfik,mi->mk", pulled[:, :, 0], by, turned[:, 0])
        own = one.through(slope[:, None])[:, 0, 0] / _FORCE_N**2
        off = np.einsum("mf,mfi,mi->m", pulled[:, :, 0], here - moved, turned[:, 0])
        if one.weight > 0:  # zero times an infinite variance would be NaN
            variance += one.weight * (own + off**2)
    return size[:, 0], np.sqrt(variance), turned[:, 0]


def none() -> pd.DataFrame:
    """Empty table, if there is no model."""
    return frame(WORKSPACE.empty_table())
