"""Initial estimate of tool points and frames by fitting the nominal robot to the readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.geometry.mechanism import Mechanism
from pipeline.geometry.readings import PositionReadings
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.machine.robot.weight import link_moments

_ROUNDS = 30
"""Number of reweighting iterations, enough for the weights of outliers to become negligible."""

_FAR = 3.0
"""Multiple of the median residual above which residuals are down-weighted [1]."""

_ENOUGH = 400
"""Maximum number of poses of a series used for the initial estimate."""


def begin(robot: Robot, readings: PositionReadings, tool: dict[str, Array]) -> Mechanism:
    """The robot with its nominal parameters, with frames and tool points fitted to the readings.

    p = R (o_i + F_i l) + t holds for the poses i of one series; R and t follow by Procrustes. The
    points l of the tool, common to all series, are estimated where they are not given.

    Args:
        robot: Robot with its DH parameters as delivered.
        readings: All series.
        tool: Nominal points of targets in the flange frame [m], as far as they are known.
    """
    series, here, at = len(readings.names), configure(robot, readings.q), with_tips(readings)
    points = np.full((at.shape[1], 3), np.nan)
    for k, name in enumerate(readings.targets):
        if name in tool:
            points[k] = tool[name]
    each = [some_of(readings, s) for s in range(series)]
    points = common_points(here, at, [mine for mine in each if len(mine)], points)[0]
    frames = np.tile(np.eye(4), (series, 1, 1))
    for s, mine in enumerate(each):
        if len(mine):  # else all of its poses were left out
            frames[s, :3, :3], frames[s, :3, 3] = _placed(here.points(points)[mine], at[mine])
    count = len(readings.targets)
    targets = np.tile(np.eye(4), (count, 1, 1))
    targets[:, :3, 3] = points[:count]
    tips = points[count:].reshape(-1, 3, 3) - points[:count][readings.six, None]
    for six, one in zip(np.flatnonzero(readings.six).tolist(), tips, strict=True):
        U, _, Vt = linear.principal(one.T)
        targets[six, :3, :3] = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return Mechanism(
        table=robot,
        values=np.zeros(len(dh_parameters(robot))),
        tool=targets,
        frames=frames,
        compliance=np.zeros(robot.n),
        payload=np.zeros((len(readings.payloads), 4)),
        moments=link_moments(robot),
    )


def with_tips(readings: PositionReadings) -> Array:
    """Positions of all targets [m], then the tips of the axes of 6D ones, (m, t + 3 s, 3).

    What turns a 6D target turns its axes, which are points of the flange like any other.
    """
    six = readings.six
    tips = readings.at[:, six, None] + _LEVER_M * np.swapaxes(readings.turn[:, six], 2, 3)
    return np.concatenate([readings.at, tips.reshape(len(readings), -1, 3)], axis=1)


_LEVER_M = 1.0
"""Length of the axes of a 6D target [m]: as in a table as delivered, a milliradian counts as a
millimetre."""


def some_of(readings: PositionReadings, series: int) -> Ints:
    """Poses of a series, not more than are needed."""
    mine = np.flatnonzero(readings.series == series)
    return mine[:: max(1, len(mine) // _ENOUGH)]


def _placed(base: Array, at: Array) -> tuple[Array, Array]:
    """Rotation R and origin t [m] of one series by robust Procrustes, points (m, t, 3)."""
    seen = np.isfinite(at).all(axis=2)
    weight = np.ones(int(seen.sum()))
    for _ in range(_ROUNDS):
        R, t = _rigid(base[seen], at[seen], weight)
        off = np.linalg.norm(at[seen] - base[seen] @ R.T - t, axis=1)
        weight = _weights(off)
    return R, t


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


def common_points(
    here: Configuration,
    at: Array,
    series: Sequence[Ints],
    points: Array,
    start: Array | None = None,
) -> tuple[Array, float]:
    """Points of the flange that fit several series at once, (t, 3), and what they leave [m].

    Unknown ones (NaN) are estimated alternately with a frame for each series. They need all series:
    the joint angles of a single one may hardly turn the flange, and then fit any point. What is
    left is the median deviation of the worst point in the worst series.

    Args:
        here: The robot.
        at: Readings of the points in the frame of the instrument [m], shape (m, t, 3).
        series: Poses of each series.
        points: Points of the flange [m], shape (t, 3).
        start: Where the search for the unknown ones starts [m], shape (t, 3).
    """
    unknown = np.isnan(points).any(axis=1)
    now: Array = np.nan_to_num(points)
    if start is not None:
        now[unknown] = start[unknown]
    worst = np.zeros(1)
    seen = [np.asarray(np.isfinite(at[mine]).all(axis=2)) for mine in series]
    weight = [one.astype(float) for one in seen]
    for _ in range(8 * _ROUNDS):
        sums, total, off = np.zeros_like(now), np.zeros(len(now)), []
        for mine, read, w in zip(series, seen, weight, strict=True):
            F, o = here.flange_axes[mine], here.flange_origin[mine][:, None]
            base = o + np.einsum("mij,tj->mti", F, now)
            R, t = _rigid(base[read], at[mine][read], w[read])
            back = np.einsum("mij,mti->mtj", F, (at[mine] - t) @ R - o)
            left = np.linalg.norm(back - now, axis=2)
            w[read] = _weights(left[read])
            sums += np.einsum("mt,mti->ti", w, np.where(read[..., None], back, 0.0))
            total += w.sum(axis=0)
            off.append(np.nanmedian(left[:, read.any(axis=0)], axis=0).max())
        fitted = sums / np.maximum(total, np.finfo(float).tiny)[:, None]
        new, worst = np.where((unknown & (total > 0))[:, None], fitted, now), np.array(off)
        if np.linalg.norm(new - now) < 1e-9:
            break
        now = new
    return now, float(worst.max())
