"""Rows of a joint log that number more stops than the poses that were measured.

A row at home, a second one at the same pose or a trial shifts the numbers of all rows behind it.
Rows and poses keep their order, and the unloaded reflectors show which belong together: with R, t
the rigid motion of the readings onto the robot's table, the alignment of both sequences (Needleman
and Wunsch, Journal of Molecular Biology 48, 1970) of most pairs, and of these that of least

    sum of |R x + t - table(q)|^2.

Motions are sought from each row in which the first, the middle and the last pose may have been.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain
from pipeline.machine.robot import Robot, configure
from pipeline.readers.logs import Log, joint_values
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M

_FEWEST, _MOST = 4, 200
"""Number of poses that an order can be seen from, and of rows that a person writes [1]."""
_TARGETS = 3
"""Number of reflectors that determine a motion [1]."""
_CLEARLY = 10.0
"""Minimum distance of a row from a pose over that of the row taken, to exclude it [1]."""
_FITTED = 3
"""Number of fits of the readings to the table."""


@dataclass(frozen=True, eq=False)
class RowsOfPoses(Locked):
    """Which row of a joint log belongs to each pose.

    Attributes:
        number: Pose of each row by its own number; rows that belong to none are not in it.
        said: How the rows were taken, to follow `was read with`.
    """

    number: dict[int, int]
    said: str

    def of(self, log: Log) -> Log:
        """A log with its rows under their poses, without those that belong to none."""
        own = log.number["pose"]
        log = log.kept(np.isin(own, [*self.number]))
        poses = np.array([self.number[int(one)] for one in log.number["pose"]], dtype=float)
        return replace(log, number=log.number | {"pose": poses})


@dataclass(frozen=True, eq=False)
class _Sequences(Locked):
    """Rows and poses, each in their order.

    Attributes:
        table: Reflectors by the table at each row in F_b [m], shape (n, t, 3).
        seen: Unloaded readings of each pose in the tracker's frame [m], shape (p, t, 3).
    """

    table: Array
    seen: Array

    def off(self, R: Array, t: Array) -> Array:
        """Mean squared distance of each row from each pose [m^2], shape (n, p)."""
        away = np.sum((self.table[:, None] - (self.seen @ R.T + t)[None]) ** 2, axis=3)
        return np.asarray(np.nanmean(away, axis=2))

    def moved(self, row: Ints, pose: Ints) -> tuple[Array, Array]:
        """R, t of the readings of poses onto their rows."""
        at, due = self.seen[pose].reshape(-1, 3), self.table[row].reshape(-1, 3)
        read = np.isfinite(at).all(axis=1)
        return linear.rigid(at[read], due[read])


def rows_of_poses(
    robot: Robot, tool: Array, shots: Any, joints: Log, out: frozenset[int]
) -> RowsOfPoses | None:
    """The rows of a joint log by their poses, None if their own numbers are right or undecidable.

    Args:
        robot: The robot.
        tool: Its reflectors in the flange frame [m], shape (t, 3).
        shots: All readings, `RawReadings`; their first t roles are the reflectors.
        joints: A row for each pose that the robot can take.
        out: Numbers of the other rows.

    Raises:
        InputError: Two rows may be those of one pose.
    """
    (poses, seen), own = _unloaded(shots, len(tool)), joints.number["pose"].astype(int)
    few, many = sorted([len(poses), len(own)])
    if len(tool) < _TARGETS or few < _FEWEST or many > _MOST or not _counted(own, poses, out):
        return None
    both = _Sequences(configure(robot, joint_values(joints, robot)).points(tool), seen)
    _, at, of = np.intersect1d(own, poses, return_indices=True)
    if len(at) and both.off(*both.moved(at, of))[at, of].max() < GROSS_DISTANCE_M**2:
        return None
    pairs, off = max((_aligned(both, *start) for start in _starts(both)), key=_fit, default=_NONE)
    if len(pairs) < _FEWEST or not _better(pairs, off.shape, np.sqrt(off[at, of])):
        return None
    _certain(both, joints, pairs, off, poses)
    return _taken(joints, poses, pairs, np.sqrt(off[tuple(pairs.T)]), np.sqrt(off[at, of]))


def _unloaded(shots: Any, targets: int) -> tuple[Ints, Array]:
    """Poses (p,), and the first unloaded reading of each target [m], (p, targets, 3)."""
    rows = np.flatnonzero((shots.slot >= 0) & (shots.role >= 0) & (shots.role < targets))
    rows = rows[~shots.loaded[shots.slot[rows]]][::-1]
    poses, of = np.unique(shots.pose[shots.slot[rows]], return_inverse=True)
    seen = np.full((len(poses), targets, 3), np.nan)
    seen[of, shots.role[rows]] = shots.position[rows]
    return poses, seen


def _counted(own: Ints, poses: Ints, out: frozenset[int]) -> bool:
    """Whether the rows are numbered from 1 on, and are more than the poses."""
    numbers = np.sort([*own, *out])
    plain = np.array_equal(numbers, np.arange(1, len(numbers) + 1)) and bool(
        (np.diff(own) > 0).all()
    )
    return plain and len(numbers) > len(poses)


_NONE = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 0))


def _better(pairs: Ints, shape: tuple[int, ...], by_number: Array) -> bool:
    """Whether an alignment puts right what the rows' own numbers do not.

    It pairs all rows or all poses, or three in four where most rows are far from their number.
    """
    right, most = int(np.sum(by_number < GROSS_DISTANCE_M)), min(shape)
    shifted = 2 * right < len(by_number) and 4 * len(pairs) >= 3 * most
    return len(pairs) > right and (shifted or len(pairs) == most)


def _fit(one: tuple[Ints, Array]) -> tuple[int, float]:
    """Number of pairs, and the negative sum of their squared distances [m^2]."""
    pairs, off = one
    return len(pairs), -float(off[tuple(pairs.T)].sum())


def _starts(both: _Sequences) -> Iterator[tuple[Array, Array]]:
    """Motions to begin with, each of one pose onto one row."""
    whole = np.flatnonzero(np.isfinite(both.seen).all(axis=(1, 2)))
    for pose in whole[[0, len(whole) // 2, -1]] if len(whole) else ():
        for row in range(len(both.table)):
            yield both.moved(np.array([row]), np.array([pose]))


def _aligned(both: _Sequences, R: Array, t: Array) -> tuple[Ints, Array]:
    """Pairs of row and pose, shape (m, 2), and squared distances with the motion of these."""
    off = both.off(R, t)
    far = _FITTED * GROSS_DISTANCE_M  # a motion by one pose is good to centimetres
    for _ in range(_FITTED):
        pairs = _pairs(off / far**2)
        if len(pairs) < _FEWEST:
            return pairs[:0], off
        off, far = both.off(*both.moved(*pairs.T)), GROSS_DISTANCE_M
    return _pairs(off / GROSS_DISTANCE_M**2), off


def _pairs(cost: Array) -> Ints:
    """The alignment of most pairs that cost less than 1, of least sum, shape (m, 2)."""
    n, p = cost.shape
    gain = np.where(cost < 1, n + p - cost, -np.inf)
    best = np.zeros((n + 1, p + 1))
    for i in range(n):
        both = np.maximum(best[i, :-1] + gain[i], best[i, 1:])
        best[i + 1, 1:] = np.maximum.accumulate(both)
    pairs, i, k = [], n, p
    while i and k:
        if best[i, k] == best[i - 1, k]:
            i -= 1
        elif best[i, k] == best[i, k - 1]:
            k -= 1
        else:
            i, k = i - 1, k - 1
            pairs.append((i, k))
    return np.array(pairs[::-1], dtype=np.int64).reshape(-1, 2)


def _certain(both: _Sequences, joints: Log, pairs: Ints, off: Array, poses: Ints) -> None:
    """Check that no row that is left out may be that of a pose as well.

    Raises:
        InputError: One may.
    """
    for row in np.setdiff1d(np.arange(len(joints.line)), pairs[:, 0]).tolist():
        for taken, pose in pairs.tolist():
            near = off[row, pose] < _CLEARLY**2 * off[taken, pose]
            if near and not _same(both, row, taken):
                raise InputError(
                    f"lines {joints.line[row]} and {joints.line[taken]} may both be the row of "
                    f"pose {poses[pose]}: the log has {len(joints.line)} rows, and the readings "
                    f"{len(poses)} poses",
                    "remove the one at which nothing was read, and number the others as the "
                    "readings do",
                    file=joints.file,
                    line=int(joints.line[row]),
                )


def _same(both: _Sequences, one: int, other: int) -> bool:
    """Whether the robot stood in the same place at two rows."""
    away = np.linalg.norm(both.table[one] - both.table[other], axis=1).max()
    return bool(away < GROSS_DISTANCE_M / _CLEARLY**2)


def _taken(joints: Log, poses: Ints, pairs: Ints, away: Array, before: Array) -> RowsOfPoses:
    own = joints.number["pose"].astype(int)
    number = {int(own[row]): int(poses[pose]) for row, pose in pairs}
    spare = [str(joints.line[k]) for k in range(len(own)) if int(own[k]) not in number]
    left = f"line{'s' * (len(spare) > 1)} {listed(spare)} as of no measured pose, and "
    first, last = ((joints.line[row], poses[pose]) for row, pose in pairs[[0, -1]])
    return RowsOfPoses(
        number,
        f"{left if spare else ''}its rows in their order from line {first[0]} as pose {first[1]} "
        f"to line {last[0]} as pose {last[1]}: so the unloaded reflectors are up to "
        f"{plain(1e3 * away.max(), 2)} mm from where the robot file places them, and up to "
        f"{plain(before.max(), 2)} m by the order of all rows",
    )
