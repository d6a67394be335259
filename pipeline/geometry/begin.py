"""First guess of tool and frames: where the nominal robot and the readings fit best."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.geometry.mechanism import Mechanism
from pipeline.geometry.readings import PositionReadings
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.letters import letters
from pipeline.machine.robot.weight import link_moments

_ROUNDS = 30
"""Of weighing anew, until what is far off counts nothing."""

_FAR = 3.0
"""Residuals beyond so many medians count less (Huber)."""

_ENOUGH = 400
"""Poses of a series that are enough for a first guess."""


def begin(robot: Robot, readings: PositionReadings, tool: dict[str, Array]) -> Mechanism:
    """The table as it is, with frames and tool points that fit it.

    p = R (o_i + F_i l) + t is linear in R l, R and t for one series; which rotation R is nearest
    follows by Procrustes. Points of the tool are estimated where they are not given.

    Args:
        robot: With its table as delivered.
        readings: All series.
        tool: Nominal points of targets in the flange frame [m], as far as they are known.
    """
    series, here = len(readings.names), configure(robot, readings.q)
    points = np.full((len(readings.targets), 3), np.nan)
    for k, name in enumerate(readings.targets):
        if name in tool:
            points[k] = tool[name]
    best = max(range(series), key=lambda s: int((readings.series == s).sum()))
    first = np.flatnonzero(readings.series == best)
    R, _, points = _placed(readings, here, first, points)
    frames = np.tile(np.eye(4), (series, 1, 1))
    for s in range(series):
        mine = np.flatnonzero(readings.series == s)
        if not len(mine):  # all of its poses were left out
            continue
        R, t, _ = _placed(readings, here, mine, points)
        frames[s, :3, :3], frames[s, :3, 3] = R, t
    targets = np.tile(np.eye(4), (len(points), 1, 1))
    targets[:, :3, 3] = points
    for six in np.flatnonzero(readings.six).tolist():
        targets[six, :3, :3] = _orientation(readings, here, frames, six)
    return Mechanism(
        table=robot,
        values=np.zeros(len(letters(robot))),
        tool=targets,
        frames=frames,
        compliance=np.zeros(robot.n),
        payload=np.zeros((len(readings.payloads), 4)),
        moments=link_moments(robot),
    )


def _placed(
    readings: PositionReadings, here: Configuration, mine: Ints, points: Array
) -> tuple[Array, Array, Array]:
    """Rotation, origin and tool points that fit one series."""
    mine = mine[:: max(1, len(mine) // _ENOUGH)]
    at = readings.at[mine]
    if np.isnan(points).any():
        points = _points(readings, here, mine, points)
    base = here.points(points)[mine]
    seen = np.isfinite(at).all(axis=2)
    weight = np.ones(int(seen.sum()))
    for _ in range(_ROUNDS):
        R, t = _rigid(base[seen], at[seen], weight)
        off = np.linalg.norm(at[seen] - base[seen] @ R.T - t, axis=1)
        limit = _FAR * max(float(np.median(off)), 1e-9)
        weight = np.minimum(1.0, limit / np.maximum(off, 1e-12)) ** 2
    return R, t, points


def _rigid(a: Array, b: Array, weight: Array) -> tuple[Array, Array]:
    """`linear.rigid` of weighted points."""
    w = weight / weight.sum()
    middle, other = w @ a, w @ b
    root = np.sqrt(w)[:, None]
    R, _ = linear.rigid(
        np.vstack([root * (a - middle), -root * (a - middle)]),
        np.vstack([root * (b - other), -root * (b - other)]),
    )
    return R, other - R @ middle


def _points(readings: PositionReadings, here: Configuration, mine: Ints, points: Array) -> Array:
    """Tool points from one series, by least squares over affine frames: p = A o + B F l + t.

    With R free to be any matrix, o and the nine numbers F_i taken as columns make the problem
    linear: vec p_i = [o_i' x 1, F_i-columns, 1] (R, R l e_k, t). Only R l is needed of each column.
    """
    out = points.copy()
    for k in np.flatnonzero(np.isnan(points).any(axis=1)):
        at = readings.at[mine, k]
        seen = np.isfinite(at).all(axis=1)
        out[k] = _point(here, mine[seen], at[seen])
    return out


def _point(here: Configuration, mine: Ints, at: Array) -> Array:
    """One tool point: alternately the frame for a point, and the point for a frame."""
    o, F = here.flange_origin[mine], here.flange_axes[mine]
    point, weight = np.zeros(3), np.ones(len(at))
    for _ in range(8 * _ROUNDS):
        R, t = _rigid(o + F @ point, at, weight)
        base = (at - t) @ R - o  # F l of each pose, in F_b
        new = np.einsum("mij,mi,m->j", F, base, weight) / weight.sum()
        off = np.linalg.norm(base - F @ new, axis=1)
        weight = np.minimum(1.0, _FAR * max(float(np.median(off)), 1e-9) / np.maximum(off, 1e-12))
        if np.linalg.norm(new - point) < 1e-9:
            break
        point = new
    return point


def _orientation(readings: PositionReadings, here: Configuration, frames: Array, k: int) -> Array:
    """How a 6D target is turned in the flange frame: the mean over all poses (Procrustes)."""
    own = frames[readings.series][:, :3, :3]
    seen = np.isfinite(readings.at[:, k]).all(axis=1)
    each = np.einsum("mji,mkj,mkl->mil", here.flange_axes, own, readings.turn[:, k])[seen]
    U, _, Vt = linear.principal(np.median(each, axis=0))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    return np.asarray(U @ flip @ Vt)
