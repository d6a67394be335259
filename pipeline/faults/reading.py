"""Single readings that contradict all others: Baarda's w-test, reading by reading.

A reading is shifted by an unknown vector v [m] in F_b; how much the sum of squares drops is the
test (Baarda, A Testing Procedure for Use in Geodetic Networks, 1968, for three coordinates):

    N = D' P D,    g = D' P y,    v = N^+ g,    T = g' N^+ g,    cov(v) = s^2 N^+,

D the three whitened columns of a reading, y the whitened rows and P the projection orthogonal to
the model's. T / 3 s^2 has 3 degrees of freedom, its p-value is multiplied by the number of
readings (Bonferroni). Where the model fits, s^2 = (y' P y - T) / (dof - 3), no less than 1 if a
noise is stated. The model is that of the joint springs; where these do not fit either way, a free
stiffness of every pose, so that whatever the robot does in proportion to the pull does not pass for
a bad reading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.machine import instrument
from pipeline.reduction.bring import Reduced
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.contrasts import Stack, Zeros, stacked
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener

_SMALLEST_M = 8e-5
"""A reading off by less than this is not reported."""

_FITS = 1e-3
"""A model whose misfit is this probable fits."""

_DOMINANT = 2.0
"""If the model does not fit, an outlier must stand out this much more."""

_TOO_FEW = 16.0
"""A sum of squares below this confirms nothing and refutes nothing."""

_CONFIRMS = 0.25
"""Part of the expected sum of squares that must be found; chance leaves less in 1 of 100."""

_PAPER_TAIL = 4.9
"""Eq. (18) scatters along one direction: a shift counts in radii, whatever its direction."""


@dataclass(frozen=True, eq=False)
class Shifts(Locked):
    """The best shift of every reading.

    Attributes:
        pose: Pose of each reading, shape (n,).
        target: Index of its target, shape (n,).
        pull: Index of its pull; -1 for zeros, shape (n,).
        nth: Number of the zero in its pose, by time; 0 for loaded readings, shape (n,).
        drop: Drop of the sum of squares, shape (n,).
        shift: The shift [m], F_b, shape (n, 3).
        normal: Normal matrix of the shift [1/m^2], shape (n, 3, 3).
        rest: Sum of squares without a shift.
        dof: Degrees of freedom without a shift.
        residual: Whitened residuals without a shift, shape (R,).
        Q: The columns beside which the shifts stand, whitened and orthonormal, shape (R, k).
    """

    pose: Ints
    target: Ints
    pull: Ints
    nth: Ints
    drop: Array
    shift: Array
    normal: Array
    rest: float
    dof: int
    residual: Array
    Q: Array


def outlier(
    case: Case,
    reduced: Reduced,
    zeros: Zeros,
    system: System,
    estimate: Estimate,
    spread: tuple[float, int],
) -> list[Mistake]:
    """The reading that contradicts the others most, if chance does not explain it.

    Where a model fits, its own residuals say how much readings scatter, never less than stated:
    they are several times more than the contrasts and leave less to chance.

    Args:
        case: The campaign.
        reduced: Its measurements.
        zeros: Its repeated zeros.
        system: Its linear system.
        estimate: Its joint springs.
        spread: As `noise_scale` gives it.
    """
    data = reduced.data
    stack, white, counts = _prepared(case, reduced, zeros, system, estimate)
    scale, contrasts = spread
    floor = smallest(reduced.placed, scale)
    springs = _shifts(stack, white, counts, _springs(system, stack, white), local=False)
    poses, pulls = (
        _shifts(stack, white, counts, _local(stack, white, columns), local=True)
        for columns in (_poses_free(stack, data), _pulls_free(stack))
    )
    for shifts, must_fit in ((springs, True), (poses, True), (poses, False)):
        best = int(np.argmax(shifts.drop))
        rest, dof = shifts.rest - shifts.drop[best], max(shifts.dof - 3, 1)
        variance, known_from = rest / dof, dof
        if system.noise_stated:
            variance = max(variance, 1.0)  # a certificate may be modest, chance no outlier
            if stats.f.sf(rest / dof / scale**2, dof, contrasts) < _FITS:
                if must_fit:
                    continue
                variance, known_from = _DOMINANT * rest / dof, contrasts
        p = len(shifts.drop) * float(stats.f.sf(shifts.drop[best] / 3 / variance, 3, known_from))
        size = float(np.linalg.norm(shifts.shift[best]))
        shift = shifts.shift[best]
        confirmed = _confirmed(poses, best, shift, scale**2)
        confirmed &= _confirmed(pulls, best, shift, scale**2, seen=not must_fit)
        whole = _of_whole_pull(stack, white, shifts, best)
        confirmed &= whole < shifts.drop[best] + _TOO_FEW * variance
        if p < alarms.READING and size > floor and confirmed:
            row = _row(case, reduced, shifts, best)
            sigmas = float(np.sqrt(shifts.drop[best] / variance))
            return [bad_reading(row, "all other readings", size, sigmas, p, beside_model=True)]
        return []
    return []


def beside_springs(
    case: Case, reduced: Reduced, zeros: Zeros, system: System, estimate: Estimate
) -> Shifts:
    """The best shift of every reading beside the joint springs; arguments as for `outlier`."""
    stack, white, counts = _prepared(case, reduced, zeros, system, estimate)
    return _shifts(stack, white, counts, _springs(system, stack, white), local=False)


def _prepared(
    case: Case, reduced: Reduced, zeros: Zeros, system: System, estimate: Estimate
) -> tuple[Stack, Whitener, dict[tuple[int, int], int]]:
    stack = stacked(system, estimate.residual, reduced.data, zeros, case.cell)
    white = whitener(stack.errors, stack.pose)
    return stack, white, _zero_counts(reduced.placed, case.settings.measured)


def _of_whole_pull(stack: Stack, white: Whitener, shifts: Shifts, k: int) -> float:
    """Drop of the sum of squares when the effector as a whole moves in the pull of a reading.

    g' N^+ g with D the six whitened rigid motions of the pull, N = D' P D and g = D' P y. A bad
    reading leaves at most its own drop to such a motion, a fault of the model more.
    """
    here = stack.pull == shifts.pull[k]
    if shifts.pull[k] < 0:
        return 0.0
    D = white.by_pose(stack.modes * here[:, None])
    rows = np.flatnonzero(stack.pose == shifts.pose[k])  # other poses feel nothing
    D, Q = D[rows], shifts.Q[rows]
    N = D.T @ D - (Q.T @ D).T @ (Q.T @ D)
    g = D.T @ shifts.residual[rows]
    return float(linear.drop(N, g)[0])


def _confirmed(freer: Shifts, k: int, shift: Array, variance: float, seen: bool = False) -> bool:
    """Whether a freer model leaves of the shift what it would leave of a true one.

    A weak fault of the model can look like a bad reading; beside free poses or pulls it vanishes.
    A true shift v drops T = v' N v there, N of the freer model; `_CONFIRMS` of it must be found.

    Args:
        freer: Every reading's shift beside the freer model.
        k: Which reading.
        shift: Its shift [m].
        variance: Variance of the readings over the stated one.
        seen: The freer model has to see it; where it cannot, nothing is confirmed.
    """
    expected = float(shift @ freer.normal[k] @ shift) / variance
    if expected < _TOO_FEW:
        return not seen
    return float(freer.drop[k]) / variance > _CONFIRMS * expected


def smallest(readings: pd.DataFrame, scale: float) -> float:
    """The smallest shift that is worth being named [m]."""
    paper = (readings["covariance_from"] == "paper").any()
    return _PAPER_TAIL * instrument.PAPER_SIGMA_M * scale if paper else _SMALLEST_M


def _zero_counts(placed: pd.DataFrame, measured: list[str]) -> dict[tuple[int, int], int]:
    rows = placed[(placed["state"] == "unloaded") & placed["target"].isin(measured)]
    at = pd.Index(measured).get_indexer(pd.Index(rows["target"]))
    keys, number = np.unique(
        np.column_stack([rows["pose"].to_numpy(int), at]), axis=0, return_counts=True
    )
    return {(int(pose), int(t)): int(n) for (pose, t), n in zip(keys, number, strict=True)}


def _springs(system: System, stack: Stack, white: Whitener) -> Array:
    """Orthonormal columns of joint springs and common errors, whitened, shape (R, k)."""
    B = np.zeros((len(stack.c), system.B.shape[1]))
    B[: len(system.B)] = system.B * [p.typical for p in system.parameters]
    return linear.orthonormal(np.hstack([white.by_pose(B), white.common]))


def _poses_free(stack: Stack, data: Measured) -> Array:
    """Six columns to a pose: rigid motions in proportion to the pull, shape (R, 6)."""
    size = np.linalg.norm(data.pulls.force, axis=1)
    share = np.where(stack.pull < 0, 0.0, size[stack.pull] / size.max())
    return stack.modes * share[:, None]


def _pulls_free(stack: Stack) -> Array:
    """Six columns to each pull of a pose: any rigid motion of the effector, shape (R, 6 n)."""
    order = np.zeros(len(stack.pull), dtype=np.int64)
    for pose in np.unique(stack.pose):
        rows = stack.pose == pose
        order[rows] = np.unique(stack.pull[rows], return_inverse=True)[1]
    one = np.eye(order.max() + 1)[order] * (stack.pull >= 0)[:, None]
    return (one[:, :, None] * stack.modes[:, None, :]).reshape(len(order), -1)


def _local(stack: Stack, white: Whitener, columns: Array) -> Array:
    """Orthonormal columns within each pose, whitened, shape of `columns`."""
    modes = white.by_pose(columns)
    out = np.zeros_like(modes)
    for pose in np.unique(stack.pose):
        rows = np.flatnonzero(stack.pose == pose)
        Q = linear.orthonormal(modes[rows])
        out[np.ix_(rows, np.arange(Q.shape[1]))] = Q
    return out


def _shifts(
    stack: Stack, white: Whitener, counts: dict[tuple[int, int], int], Q: Array, local: bool
) -> Shifts:
    """Shift every reading beside the columns Q, which are global or belong to one pose each."""
    y = white.by_pose(stack.c)
    found: list[tuple[Any, ...]] = []
    index = {pose: np.flatnonzero(stack.pose == pose) for pose in np.unique(stack.pose).tolist()}
    if local:
        along = np.concatenate([Q[r] @ (Q[r].T @ y[r]) for r in index.values()])
        residual = np.empty_like(y)
        residual[np.concatenate(list(index.values()))] = along
        residual = y - residual
        rank = sum(int((np.abs(Q[r]).max(axis=0) > 0).sum()) for r in index.values())
    else:
        residual, rank = y - Q @ (Q.T @ y), Q.shape[1]
    for number, (pose, rows) in enumerate(index.items()):
        target, pull, nth, D = _columns(stack, rows, counts, pose)
        order = white.place[rows]
        W = white.inverse[number][np.ix_(order, order)]
        D = np.einsum("ab,bni->ani", W, D)
        QD = np.einsum("ak,ani->kni", Q[rows], D)
        N = np.einsum("ani,anj->nij", D, D) - np.einsum("kni,knj->nij", QD, QD)
        g = np.einsum("ani,a->ni", D, residual[rows])
        shift = np.einsum("nij,nj->ni", linear.shortest(N), g)  # [m]: the shortest that fits
        drop = np.sum(shift * g, axis=1)
        found.append((np.full(len(target), pose), target, pull, nth, drop, shift, N))
    names = ("pose", "target", "pull", "nth", "drop", "shift", "normal")
    parts = (np.concatenate(part) for part in zip(*found, strict=True))
    known: dict[str, Any] = dict(zip(names, parts, strict=True))
    rest = float(residual @ residual)
    return Shifts(**known, rest=rest, dof=len(y) - rank, residual=residual, Q=Q)


def _columns(
    stack: Stack, rows: Ints, counts: dict[tuple[int, int], int], pose: int
) -> tuple[Ints, Ints, Ints, Array]:
    """What a unit shift of each reading of a pose does to its rows: (n,) three times, (R, n, 3)."""
    target, pull, which, axis = (
        stack.target[rows],
        stack.pull[rows],
        stack.which[rows],
        stack.axis[rows],
    )
    loaded = sorted({(int(t), int(i)) for t, i in zip(target, pull, strict=True) if i >= 0})
    zeros = [(t, n) for t in sorted(set(target.tolist())) for n in range(counts.get((pose, t), 0))]
    D = np.zeros((len(rows), len(loaded) + len(zeros), 3))
    every = np.arange(len(rows))
    for k, (t, i) in enumerate(loaded):
        here = (target == t) & (pull == i)
        D[every[here], k, axis[here]] = 1.0
    for k, (t, n) in enumerate(zeros, len(loaded)):
        mine = target == t
        effect = np.where(pull >= 0, -1.0 / counts[pose, t], 0.0)
        again = pull < 0
        effect = np.where(again & (which == n), 1.0, effect)
        effect = np.where(again & (which > n), -1.0 / np.maximum(which, 1), effect)
        D[every[mine], k, axis[mine]] = effect[mine]
    of = np.array([t for t, _ in [*loaded, *zeros]], dtype=np.int64)
    at = np.array([i for _, i in loaded] + [-1] * len(zeros), dtype=np.int64)
    nth = np.array([0] * len(loaded) + [n for _, n in zeros], dtype=np.int64)
    return of, at, nth, D


def bad_reading(
    row: pd.Series, others: str, size: float, sigmas: float, p: float, beside_model: bool = False
) -> Mistake:
    """The finding of a single reading that contradicts others.

    Args:
        row: The reading.
        others: What it contradicts, for the sentence.
        size: How far it is off [m].
        sigmas: The same in standard deviations.
        p: That chance puts any reading so far off; a sum, which may exceed 1.
        beside_model: As in `Mistake`.
    """
    where = f"{row['group']}/{row['target']}"
    return Mistake(
        name="outlier",
        where=where,
        evidence=f"the reading {where} ({row['file']}:{row['line']}) is {1e3 * size:.2f} mm off "
        f"from where {others} put it, {sigmas:.1f} standard deviations",
        correction=f"computed again without {where}",
        before=sigmas,
        after=0.0,
        unit="sigma",
        size=size,
        size_unit="m",
        p_value=min(p, 1.0),
        beside_model=beside_model,
        correct=partial(without, file=str(row["file"]), line=int(row["line"])),
    )


def _row(case: Case, reduced: Reduced, shifts: Shifts, best: int) -> pd.Series:
    """The reading in table PLACED."""
    placed, data = reduced.placed, reduced.data
    name = case.settings.measured[shifts.target[best]]
    rows = placed[(placed["pose"] == shifts.pose[best]) & (placed["target"] == name)]
    if shifts.pull[best] >= 0:
        repeat = data.pulls.repeat[shifts.pull[best]]
        return rows[(rows["state"] == "loaded") & (rows["repeat"] == repeat)].iloc[0]
    return (
        rows[rows["state"] == "unloaded"].sort_values("time", kind="stable").iloc[shifts.nth[best]]
    )


def without(case: Case, file: str, line: int) -> Case:
    """The campaign without one reading."""
    rows = case.readings
    return replace(case, readings=rows[(rows["file"] != file) | (rows["line"] != line)])


FAULT = Fault(
    "outlier",
    "outlying reading",
    lambda asked: outlier(
        asked.case, asked.reduced, asked.zeros, asked.system, asked.estimate, asked.spread
    ),
    beside_model=True,
)
