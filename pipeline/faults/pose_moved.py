"""A pose in which tracker or robot moved between its states, as a whole and not by the load.

All states of the pose from some one on, pulls and repeated zeros, then have a common displacement,
unlike that of a load: a rigid motion of the effector, six columns in addition to the model, is
common to them (see `system.score_tests`). It is a mistake in the data if everything else fits once
one pose has it. What happens in every pose belongs to the machine (lost motion, backlash), and is
left to the diagnosis.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Ints
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, apart, left_out, length, lines_of, of_group, outlying
from pipeline.faults.reading import Shifted, confirmed, shifted_readings, shown
from pipeline.reduction.measured import Measured
from pipeline.system import alarms, odds
from pipeline.system.assemble import by_force
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.simultaneous import cost

_ALONE = 0.01
"""P-value of a motion of another pose, likelier there than one bad reading, below which both belong
to the machine [1]."""

_READ_UNDER_LOAD = ", or a zero there, of the reflectors or of the scale, was read under load"

_FEWEST = 2
"""Minimum number of displaced states, one of them a pull; a single one may as well have another
force."""

_States = list[tuple[int, int]]
"""States of a pose in the order of time: index of the pull, or -1, and number of the zero."""


def moved(asked: Screening, last: bool = False) -> list[Mistake]:
    """The pose that moved between two of its states, if nothing else is wrong.

    Where a scale that was not zeroed there explains as much, that is asked first; this is `last`,
    since something is wrong in the pose even where no such zero can be named.

    p = P[F > (T / 6) / s^2], with s^2 = max(1, residual variance), times the number of suspects,
    compared with `alarms.READING`; a free stiffness of the pose must confirm the motion.
    """
    system, estimate = asked.system, asked.estimate
    scale, contrasts = asked.spread
    whole = estimate.chi2 / max(estimate.dof, 1) / scale**2
    misfit = special.fdtrc(estimate.dof, contrasts, whole)  # NaN where the noise is unknown
    if estimate.p_value is None or not misfit <= odds.FITS:
        return []
    shifted = shifted_readings(asked.case, asked.reduced, asked.zeros, system, estimate)
    D, from_state, columns = _columns(shifted, asked.reduced.data)
    found = _flat(shifted.springs(system).beside(D))
    if not found.rank.any():
        return []
    best = int(np.argmax(found.drop))
    rest = float(found.variance()[best])
    dof = max(found.dof - int(found.rank[best]), 1)
    if not special.fdtrc(dof, contrasts, rest / scale**2) >= odds.FITS:
        return []
    p = int((found.rank > 0).sum()) * float(found.p(max(rest, 1.0), dof)[best])
    size = found.size[best]
    freer = _flat(shifted.poses_free(asked.reduced.data).beside(D))
    if p >= alarms.READING or not confirmed(freer, best, size, scale**2, seen=True):
        return []
    place, first = divmod(best, from_state)
    pose = int(np.unique(shifted.stack.pose)[place])
    variance, base = max(rest, 1.0), shifted.springs(system)
    worth, zero = _worth(found, variance)[best], _by_zero(asked, shifted, base, pose, variance)
    rivals = float(_by_one(asked, shifted, base, variance)[place]), zero
    if max(rivals[: 2 - last]) >= worth:
        return []
    base = shifted.springs(system, columns[first] * (shifted.stack.pose == pose)[:, None])
    beside, others = _flat(base.beside(D)), np.arange(len(found.drop)) // from_state
    single = _by_one(asked, shifted, base, variance)
    others = (others != place) & (_worth(beside, variance) > single[others])
    if len(found.drop) * float(beside.p(variance, dof)[others].min(initial=1.0)) < _ALONE:
        return []
    known = _states(asked.reduced.data, pose), first + 1
    return [_finding(asked, pose, *known, size, float(found.drop[best]), p, zero < worth)]


def _worth(found: ScoreTests, variance: float) -> Array:
    """Twice the log likelihood gained by each suspect, minus the cost of its prior."""
    return np.asarray(found.drop / variance - cost(found.drop / variance, found.rank))


def _by_zero(asked: Screening, shifted: Shifted, base: Base, pose: int, variance: float) -> float:
    """Gain by a scale that was not zeroed in a pose: a displacement alike in all its pulls."""
    rows = np.zeros((len(shifted.stack.c), 1))
    by_zero = by_force(asked.cell, asked.reduced.data, asked.estimate.value)
    rows[: len(by_zero), 0] = by_zero
    zero = _flat(base.beside(shifted.white.blocks.padded(shifted.white.by_pose(rows))[:, :, None]))
    return float(_worth(zero, variance)[np.unique(shifted.stack.pose) == pose].max())


def _by_one(asked: Screening, shifted: Shifted, base: Base, variance: float) -> Array:
    """Gain by the best single reading of each pose, which may look like a rotation, shape (p,)."""
    poses, place = np.unique(shifted.readings.pose, return_inverse=True)
    best = np.full(len(poses), -np.inf)
    if not asked.cell.tool.six:
        np.maximum.at(best, place, _worth(shifted.beside(base), variance))
    return best


def _columns(shifted: Shifted, data: Measured) -> tuple[Array, int, list[Array]]:
    """Six motions common to all states of a pose from its n-th on, n > 0.

    Returns:
        Whitened by pose, (p, s, n, 6); the number of n; and not whitened, one (R, 6) for each n.
    """
    stack, white = shifted.stack, shifted.white
    poses = {int(pose): _states(data, pose) for pose in np.unique(stack.pose)}
    most = max(map(len, poses.values())) - 1
    each, plain = [], []
    for first in range(1, most + 1):
        share = np.zeros(len(stack.pose))
        for pose, states in poses.items():
            mine = stack.pose == pose
            share[mine] = _shown(states, first, stack.pull[mine], stack.which[mine])
        plain.append(stack.modes * share[:, None])
        each.append(white.blocks.padded(white.by_pose(plain[-1])))
    return np.stack(each, axis=2), most, plain


def _states(data: Measured, pose: int) -> _States:
    """The states of a pose; a zero without a time comes before its pulls."""
    pulls = np.flatnonzero(data.pulls.pose == pose)
    zeros = np.sort(data.zero_times[pulls[0]])
    zeros = zeros[: max(int(np.isfinite(zeros).sum()), 1)]
    time = np.nan_to_num(np.append(zeros, data.pulls.time[pulls]), nan=-np.inf)
    every = [*((-1, nth) for nth in range(len(zeros))), *((int(pull), 0) for pull in pulls)]
    return [every[k] for k in np.argsort(time, kind="stable")]


def _shown(states: _States, first: int, pull: Ints, which: Ints) -> Array:
    """Part of a motion since a state that each row of a pose shows; zero where none is asked.

    A pull since it shows the motion, and every pull minus the mean of the zeros; a repeated zero
    minus the mean of those before it.

    Args:
        states: Of the pose.
        first: Index of the first state after the motion.
        pull: Pull of each row, -1 for a repeated zero.
        which: Number of the difference of zeros.
    """
    later, zeros = np.array(states[first:]), sum(one < 0 for one, _ in states)
    if len(later) < _FEWEST or later[:, 0].max() < 0:
        return np.zeros(len(pull))
    nth = np.minimum(which, zeros - 1)  # one group may hold several readings
    return np.sum([shown(pull, nth, one, n, zeros) for one, n in later], axis=0)


def _flat(found: ScoreTests) -> ScoreTests:
    """The suspects of all poses in one row."""
    return found.arranged(lambda one: one.reshape(-1, *one.shape[2:]))


def _finding(
    asked: Screening,
    pose: int,
    states: _States,
    first: int,
    size: Array,
    drop: float,
    p: float,
    zeroed: bool,
) -> Mistake:
    """The mistake. Unless the scale was surely `zeroed`, its zero is given as another possibility.

    The states from index `first` on are displaced, or those before it.
    """
    rows, repeat = asked.case.readings, asked.reduced.data.pulls.repeat
    rows = rows[rows["pose"] == pose].sort_values("time", kind="stable")
    (lost, kept), unloaded = _parts(states, first), rows["state"] == "unloaded"
    zeros = rows["group"].astype(str)[unloaded].unique()
    again = np.isin(rows["repeat"], [int(repeat[one]) for one, _ in lost if one >= 0])
    out = rows[
        np.where(unloaded, np.isin(rows["group"], [zeros[n] for k, n in lost if k < 0]), again)
    ]
    group, sigmas = str(out["group"].iloc[0]), float(np.sqrt(drop))
    named = [f"pull {repeat[k]}" if k >= 0 else "its unloaded state" for k, _ in states]
    between = " and ".join(named[first - 1 : first + 1])
    at = of_group(asked.case, group, set(rows["target"]))
    return outlying(
        group,
        f"in pose {pose} the effector moved by {length(float(np.linalg.norm(size[:3])))} between "
        f"{between}, alike in all pulls that follow and whatever their force, {apart(sigmas)}: "
        f"the tracker was knocked there, or the robot moved{'' if zeroed else _READ_UNDER_LOAD}",
        f"recomputed without {kept or f'pose {pose}'}",
        before=sigmas,
        size=float(np.linalg.norm(size[:3])),
        p_value=p,
        together=True,
        correct=partial(left_out, at=lines_of(out)),
        at=at,
    )


def _parts(states: _States, first: int) -> tuple[_States, str]:
    """Which part of a pose is left out, and in words if the other one is kept.

    That is the part with a zero and more pulls; without a zero and a pull none is.
    """
    parts = states[:first], states[first:]
    before, after = (
        sum(one >= 0 for one, _ in part) * any(one < 0 for one, _ in part) for part in parts
    )
    if after > before:
        return parts[0], "its states before"
    return (parts[1], "those that follow") if before else (parts[0], "")


FAULT = Fault("outlier", moved)
LAST = Fault("outlier", partial(moved, last=True))
