"""Rows of the joint log that are not those of their pose.

The unloaded reflectors of all poses are fitted to the robot's table at the logged joint values,
with base frame and tool points estimated: the residuals are the errors of the table, similar in all
poses. A single pose that deviates far more than all others has a wrong row, a duplicate or that of
another pose. If most poses deviate, something else is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy import optimize
from scipy.spatial.transform import Rotation

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.linear import rigid, rms
from pipeline.base.quantities import plain
from pipeline.base.tails import chi2_beyond
from pipeline.faults.conventions import unloaded
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, outlying
from pipeline.machine.robot import configure
from pipeline.reduction.case import Case
from pipeline.reduction.limits import beyond
from pipeline.reduction.register import XYZ, register
from pipeline.system import alarms
from pipeline.system.score_tests import Base

_STANDS_OUT = 10.0
"""Minimum deviation caused by a wrong row over the scatter of the other poses [1]."""

_LEAST_M = 1e-3
"""Minimum deviation caused by a wrong row [m]."""

_FEWEST_GOOD = 5
"""Minimum number of poses that must agree before another is tested against them."""

_PART, _MOST = 4, 12
"""A wrong row is sought in at most one of `_PART` poses, and in at most `_MOST` poses [1]."""


@dataclass(frozen=True, eq=False)
class _TableStand(Locked):
    """Readings of measured targets and their positions by the table.

    Attributes:
        seen: Readings in the tracker's frame [m], shape (n, 3).
        pose: Index of the pose of each in `poses`, shape (n,).
        target: Index of its target, shape (n,).
        state: Number of its group, shape (n,).
        zero: Whether it is unloaded, shape (n,).
        poses: Numbers of the poses, shape (p,).
        table: Position of each by the table in F_b [m], shape (n, 3).
        axes: Axes of the flange in F_b at each, shape (n, 3, 3).
    """

    seen: Array
    pose: Ints
    target: Ints
    state: Ints
    zero: Bools
    poses: Ints
    table: Array
    axes: Array


@dataclass(frozen=True, eq=False)
class _Laid(Locked):
    """The table fitted to the readings of some poses.

    Attributes:
        R: Rotation from F_b into the tracker's frame, shape (3, 3).
        t: Origin of F_b in the tracker's frame [m], shape (3,).
        off: Deviation of the effector's points from the stated ones [m], shape (targets, 3).
        away: Readings minus predictions, of all poses [m], shape (n, 3).
        stands: Deviation of each pose from the prediction by the others, rms coordinate, less the
            part that these leave undetermined [m], shape (p,).
        usual: Rms residual of the others [m], shape (p,).
    """

    R: Array
    t: Array
    off: Array
    away: Array
    stands: Array
    usual: Array

    @property
    def apart(self) -> Bools:
        """Poses that stand out, shape (p,)."""
        limit = np.maximum(_STANDS_OUT * self.usual, _LEAST_M / np.sqrt(3))
        return np.asarray(self.stands > limit, dtype=bool)


def wrong_rows(case: Case) -> list[Mistake]:
    """Poses whose reflectors are not where their row of the joint log predicts them."""
    read = _read(case)
    if len(read.poses) <= _FEWEST_GOOD or len(case.settings.measured) < 2:
        return []
    laid = _laid(read, [])
    if np.linalg.norm(laid.away[read.zero], axis=1).max() < _LEAST_M:
        return []
    out: list[int] = []
    for _ in range(min((len(read.poses) - 1) // _PART, len(read.poses) - _FEWEST_GOOD, _MOST)):
        kept = np.setdiff1d(np.arange(len(read.poses)), out)
        out.append(int(kept[np.argmax(laid.stands[kept])]))
        laid = _laid(read, out)
        if np.array_equal(np.flatnonzero(laid.apart), sorted(out)):
            wrong = [k for k in sorted(out) if _whole(read, laid, k)]
            wrong = [] if _knocked(case, read, wrong) else wrong
            return [_finding(case, read, laid, k) for k in wrong]
    return []


def contradicted(case: Case) -> bool:
    """Whether readings contradict every row of the joint log that exceeds the robot's limits.

    Where they agree with it, the limits of the robot file are wrong.
    """
    out = {f"{one.file}:{one.line}" for one in beyond(case) if one.out}
    return bool(out) and out <= {at for one in wrong_rows(case) for at in one.at}


def _read(case: Case) -> _TableStand:
    rows = case.readings
    known = rows["target"].isin(case.settings.measured) & rows["pose"].isin(case.joints["pose"])
    rows = rows[known & rows["pose"].isin(unloaded(case)["pose"])]
    poses, at = np.unique(rows["pose"].to_numpy(int), return_inverse=True)
    target = np.array([case.settings.measured.index(name) for name in rows["target"]], int)
    frames = configure(case.robot, case.q(poses))
    return _TableStand(
        seen=rows[XYZ].to_numpy(float),
        pose=at,
        target=target,
        state=np.unique(rows["group"].to_numpy(str), return_inverse=True)[1],
        zero=(rows["state"] == "unloaded").to_numpy(bool),
        poses=poses,
        table=frames.points(case.tool.points)[at, target],
        axes=frames.flange_axes[at],
    )


def _laid(read: _TableStand, out: Sequence[int]) -> _Laid:
    """The table fitted to the unloaded readings of all poses except `out` (Gauss-Newton)."""
    used = read.zero & ~np.isin(read.pose, out)
    targets = int(read.target.max()) + 1
    R, t = rigid(read.table[used], read.seen[used])
    off = np.zeros((targets, 3))
    for _ in range(6):
        at, X, away = _linear(read, R, t, off)
        step = linear.least_squares(X[used].reshape(-1, X.shape[2]), away[used].ravel())
        turn, centre = Rotation.from_rotvec(step[:3]).as_matrix(), at[read.zero].mean(axis=0)
        R, t = turn @ R, turn @ (t - centre) + centre + step[3:6]
        off = off + step[6:].reshape(-1, 3)
        if np.abs(step).max() < 1e-9:
            break
    _, X, away = _linear(read, R, t, off)
    stands, usual = np.zeros(len(read.poses)), np.zeros(len(read.poses))
    others = _base(X, away, used)
    for k in range(len(read.poses)):
        here = used | (read.zero & (read.pose == k))
        base = _base(X, away, here) if k in out else others
        mine = np.repeat(read.pose[here] == k, 3)
        free = base.free(mine)
        stands[k] = np.sqrt(free.drop / max(mine.sum(), 1))
        usual[k] = np.sqrt(others.rest / max(others.dof, 1) if k in out else free.variance())
    return _Laid(R, t, off, away, stands, usual)


def _base(X: Array, away: Array, here: Bools) -> Base:
    return Base.of(X[here].reshape(-1, X.shape[2]), away[here].ravel())


def _linear(read: _TableStand, R: Array, t: Array, off: Array) -> tuple[Array, Array, Array]:
    """Predicted readings, their derivatives (n, 3, 6 + 3 targets), readings minus predictions."""
    at = (read.table + np.einsum("nij,nj->ni", read.axes, off[read.target])) @ R.T + t
    X = np.zeros((len(at), 3, 6 + off.size))
    X[:, :, :3] = linear.turning(at - at[read.zero].mean(axis=0))
    X[:, :, 3:6] = np.eye(3)
    turned = R @ read.axes
    for k in range(len(off)):
        X[read.target == k, :, 6 + 3 * k : 9 + 3 * k] = turned[read.target == k]
    return at, X, read.seen - at


def _knocked(case: Case, read: _TableStand, wrong: Sequence[int]) -> bool:
    """Whether the tracker may have been knocked before these poses, by the base reflectors' misfit.

    Only if they are the last ones that were read.
    """
    if not case.settings.base_frame or not wrong:
        return False
    placed = register(case.settings, case.readings)
    if placed.chi2 is None or chi2_beyond(placed.chi2, placed.dof) > alarms.READING:
        return False
    begun = np.array([np.flatnonzero(read.pose == k)[0] for k in range(len(read.poses))])
    return set(np.argsort(begun)[-len(wrong) :].tolist()) == set(wrong)


def _whole(read: _TableStand, laid: _Laid, k: int) -> bool:
    """Whether the effector as a whole is elsewhere, in every state of the pose.

    Neither one outlying reading nor two exchanged names make a wrong row.
    """
    far = np.linalg.norm(laid.away, axis=1)
    zero = read.zero & (read.pose == k)
    size = rms(far[zero])
    loaded = ~read.zero & (read.pose == k)
    if loaded.any() and np.median(far[loaded]) < size / 3:
        return False
    return all(
        _moved(read.seen[here], read.seen[here] - laid.away[here], size, float(laid.usual[k]))
        for here in (zero & (read.state == state) for state in np.unique(read.state[zero]))
    )


def _moved(seen: Array, due: Array, size: float, usual: float) -> bool:
    """Whether points, under their own names, are displaced rigidly."""
    far = np.sort(np.linalg.norm(seen - due, axis=1))
    if len(far) < 2 or far[-2] < far[-1] / 3 or far[-1] < size / 2:
        return False
    left = float(np.sqrt(np.mean(np.sum((seen - linear.moved_onto(due, seen)) ** 2, axis=1))))
    away = np.linalg.norm(seen[:, None] - due[None], axis=2)
    row, column = optimize.linear_sum_assignment(away**2)
    return left < max(size / _PART, _STANDS_OUT * usual) and rms(away[row, column]) > size / 2


def _finding(case: Case, read: _TableStand, laid: _Laid, k: int) -> Mistake:
    row = case.joints[case.joints["pose"] == read.poses[k]].iloc[0]
    far = np.sum(laid.away**2, axis=1)[read.zero]
    of = read.pose[read.zero]
    size = float(np.sqrt(far[of == k].mean()))
    others = float(np.sqrt(far[~laid.apart[of]].mean()))
    where = f"{row['file']} pose{read.poses[k]:02d}"
    return outlying(
        where,
        f"the row of pose {read.poses[k]} in the joint log ({row['file']}:{row['line']}) "
        f"does not match its readings{_same(case, row)}: the unloaded reflectors are "
        f"{_mm(size)} from where it places them, those of the other poses "
        f"{_mm(others)}",
        f"recomputed without pose {read.poses[k]}",
        before=1e3 * size,
        after=1e3 * others,
        unit="mm",
        size=size,
        correct=partial(without_poses, poses=[int(read.poses[k])]),
        at=(f"{row['file']}:{row['line']}",),
    )


def _mm(size: float) -> str:
    return f"{1e3 * size:.0f} mm" if size >= 0.1 else f"{plain(1e3 * size, 2)} mm"


def _same(case: Case, row: pd.Series) -> str:
    """Another pose of the joint log with the same numbers, in words."""
    others = case.joints[case.joints["pose"] != row["pose"]]
    equal = (others[case.joint_columns] == row[case.joint_columns]).all(axis=1)
    return f" but repeats that of pose {others['pose'][equal].iloc[0]}" if equal.any() else ""


def without_poses(case: Case, poses: Sequence[int]) -> Case:
    """The campaign without some poses."""
    rows, loads, joints = case.readings, case.loads, case.joints
    return replace(
        case,
        readings=rows[~rows["pose"].isin(poses)],
        loads=loads[~loads["pose"].isin(poses)],
        joints=joints[~joints["pose"].isin(poses)],
    )


FAULT = Fault("outlier", lambda asked: wrong_rows(asked.case), in_files=True)
