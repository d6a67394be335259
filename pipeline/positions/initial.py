"""Initial estimate of tool points and frames by fitting the nominal robot to the readings."""

from __future__ import annotations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.machine.robot.weight import link_moments
from pipeline.positions.mechanism import Mechanism
from pipeline.positions.readings import PositionReadings

_ROUNDS = 30
"""Number of reweighting iterations, enough for the weights of outliers to become negligible."""

_FAR = 3.0
"""Multiple of the median residual above which residuals are down-weighted [1]."""

_ENOUGH = 400
"""Maximum number of poses of a series used for the initial estimate."""


def begin(robot: Robot, readings: PositionReadings, tool: dict[str, Array]) -> Mechanism:
    """The robot with its nominal parameters, with frames and tool points fitted to the readings.

    p = R (o_i + F_i l) + t holds for the poses i of one series; R and t follow by Procrustes. Tool
    points are estimated where they are not given.

    Args:
        robot: Robot with its DH parameters as delivered.
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
        values=np.zeros(len(dh_parameters(robot))),
        tool=targets,
        frames=frames,
        compliance=np.zeros(robot.n),
        payload=np.zeros((len(readings.payloads), 4)),
        moments=link_moments(robot),
    )


def _placed(
    readings: PositionReadings, here: Configuration, mine: Ints, points: Array
) -> tuple[Array, Array, Array]:
    """Rotation R, origin t [m] and tool points [m] that fit one series, by robust Procrustes."""
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
        weight = _weights(off)
    return R, t, points


def _weights(off: Array) -> Array:
    """Weights w = min(1, k / r)^2 of residuals r, with k `_FAR` medians of them, shape (m,).

    Squared, unlike those of Huber: the pull w r of a reading falls with its distance.
    """
    limit = _FAR * max(float(np.median(off)), 1e-9)
    return np.asarray(np.minimum(1.0, limit / np.maximum(off, 1e-12)) ** 2)


def _rigid(a: Array, b: Array, weight: Array) -> tuple[Array, Array]:
    """Rotation and translation as of `linear.rigid`, for weighted points."""
    w = weight / weight.sum()
    middle, other = w @ a, w @ b
    root = np.sqrt(w)[:, None]
    R, _ = linear.rigid(
        np.vstack([root * (a - middle), -root * (a - middle)]),
        np.vstack([root * (b - other), -root * (b - other)]),
    )
    return R, other - R @ middle


def _points(readings: PositionReadings, here: Configuration, mine: Ints, points: Array) -> Array:
    """Tool points [m], the unknown (NaN) ones estimated one by one from the poses `mine`."""
    out = points.copy()
    for k in np.flatnonzero(np.isnan(points).any(axis=1)):
        at = readings.at[mine, k]
        seen = np.isfinite(at).all(axis=1)
        out[k] = _point(here, mine[seen], at[seen])
    return out


def _point(here: Configuration, mine: Ints, at: Array) -> Array:
    """One tool point [m] in the flange frame, alternately estimating the frame and the point."""
    o, F = here.flange_origin[mine], here.flange_axes[mine]
    point, weight = np.zeros(3), np.ones(len(at))
    for _ in range(8 * _ROUNDS):
        R, t = _rigid(o + F @ point, at, weight)
        base = (at - t) @ R - o  # F l of each pose, in F_b
        new = np.einsum("mij,mi,m->j", F, base, weight) / weight.sum()
        off = np.linalg.norm(base - F @ new, axis=1)
        weight = _weights(off)
        if np.linalg.norm(new - point) < 1e-9:
            break
        point = new
    return point


def _orientation(readings: PositionReadings, here: Configuration, frames: Array, k: int) -> Array:
    """Rotation of a 6D target in the flange frame: median over all poses, by Procrustes."""
    own = frames[readings.series][:, :3, :3]
    seen = np.isfinite(readings.at[:, k]).all(axis=1)
    each = np.einsum("mji,mkj,mkl->mil", here.flange_axes, own, readings.turn[:, k])[seen]
    U, _, Vt = linear.principal(np.median(each, axis=0))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    return np.asarray(U @ flip @ Vt)
