"""A pose in which tracker or robot moved between its states, as a whole and not by the load.

All pulls from some one on then have a common displacement, unlike that of a load: a rigid motion of
the effector, six columns in addition to the model, is common to them (see `system.score_tests`). It
is a mistake in the data if everything else fits once one pose has it. What happens in every pose
belongs to the machine (lost motion, backlash), and is left to the diagnosis.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Ints
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, apart, left_out, length, lines_of, of_group, outlying
from pipeline.faults.reading import Shifted, confirmed, shifted_readings
from pipeline.reduction.case import Case
from pipeline.system import alarms, odds
from pipeline.system.assemble import by_force
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.simultaneous import cost

_ALONE = 0.01
"""P-value of a motion of another pose below which both belong to the machine [1]."""

_READ_UNDER_LOAD = ", or a zero there, of the reflectors or of the scale, was read under load"

_FEWEST = 2
"""Minimum number of displaced pulls; a single one may as well have another force."""


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
    D, from_pull, columns = _columns(shifted)
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
    place, first = divmod(best, from_pull)
    pose = int(np.unique(shifted.stack.pose)[place])
    variance, base = max(rest, 1.0), shifted.springs(system)
    worth, zero = _worth(found, variance)[best], _by_zero(asked, shifted, base, pose, variance)
    rivals = _by_one(asked, shifted, base, pose, variance), zero
    if max(rivals[: 2 - last]) >= worth:
        return []
    beside = _flat(shifted.springs(system, columns[first] * _of(shifted, pose)).beside(D))
    others = np.arange(len(found.drop)) // from_pull != place
    if len(found.drop) * float(beside.p(max(rest, 1.0), dof)[others].min(initial=1.0)) < _ALONE:
        return []
    pulls = asked.reduced.data.pulls
    repeats = np.sort(pulls.repeat[pulls.pose == pose])
    zeroed = zero < worth
    return [_finding(asked.case, pose, repeats, first, size, float(found.drop[best]), p, zeroed)]


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


def _by_one(asked: Screening, shifted: Shifted, base: Base, pose: int, variance: float) -> float:
    """Gain by the best single reading of a pose, which may look like a rotation of the effector."""
    if asked.cell.tool.six:
        return -np.inf
    found = _worth(shifted.beside(base), variance)
    return float(found[shifted.readings.pose == pose].max(initial=-np.inf))


def _of(shifted: Shifted, pose: int) -> Array:
    """Mask of the rows of a pose, shape (R, 1)."""
    return (shifted.stack.pose == pose)[:, None].astype(float)


def _columns(shifted: Shifted) -> tuple[Array, int, list[Array]]:
    """Six motions common to all pulls of a pose from its n-th on.

    They are zero where fewer than `_FEWEST` pulls follow, and for n > 0 where the zero was read
    again.

    Returns:
        Whitened by pose, (p, s, n, 6); n; and not whitened, one (R, 6) for each n.
    """
    stack, white = shifted.stack, shifted.white
    loaded = stack.pull >= 0
    order = _order(stack.pose, stack.pull)
    last = np.zeros(int(stack.pose.max()) + 1, dtype=np.int64)
    np.maximum.at(last, stack.pose[loaded], order[loaded])
    again = np.zeros(len(last), dtype=bool)
    again[stack.pose[~loaded]] = True
    most = max(int(last.max()) + 2 - _FEWEST, 1)
    each, plain = [], []
    for first in range(most):
        asked = (last[stack.pose] + 1 - first >= _FEWEST) & ((first == 0) | ~again[stack.pose])
        one = stack.modes * (loaded & (order >= first) & asked)[:, None]
        plain.append(one)
        each.append(white.blocks.padded(white.by_pose(one)))
    return np.stack(each, axis=2), most, plain


def _order(pose: Ints, pull: Ints) -> Ints:
    """Index of each row's pull among those of its pose, from 0; -1 for zeros."""
    out = np.full(len(pose), -1, dtype=np.int64)
    for one in np.unique(pose):
        mine = (pose == one) & (pull >= 0)
        out[mine] = np.unique(pull[mine], return_inverse=True)[1]
    return out


def _flat(found: ScoreTests) -> ScoreTests:
    """The suspects of all poses in one row."""
    return replace(
        found,
        N=found.N.reshape(-1, *found.N.shape[2:]),
        g=found.g.reshape(-1, found.g.shape[-1]),
        whole=found.whole.reshape(-1, found.whole.shape[-1]),
    )


def _finding(
    case: Case,
    pose: int,
    repeats: Ints,
    first: int,
    size: Array,
    drop: float,
    p: float,
    zeroed: bool,
) -> Mistake:
    """The mistake; `repeats` are those of the pulls in use, from index `first` on displaced.

    Unless the scale was surely `zeroed`, its zero is given as another possibility.
    """
    rows = case.readings[case.readings["pose"] == pose]
    loaded = rows[rows["state"] == "loaded"]
    zeros = rows[rows["state"] == "unloaded"]
    out = zeros if first == 0 else loaded[loaded["repeat"].isin(repeats[first:])]
    group = str(out["group"].iloc[0])
    between = (
        "its unloaded state and the first pull"
        if first == 0
        else f"pulls {repeats[first - 1]} and {repeats[first]}"
    )
    sigmas = float(np.sqrt(drop))
    at = of_group(case, group, set(rows["target"]))
    return outlying(
        group,
        f"in pose {pose} the effector moved by {length(float(np.linalg.norm(size[:3])))} between "
        f"{between}, alike in all pulls that follow and whatever their force, {apart(sigmas)}: "
        f"the tracker was knocked there, or the robot moved{'' if zeroed else _READ_UNDER_LOAD}",
        f"recomputed without {'pose ' + str(pose) if first == 0 else 'the pulls that follow'}",
        before=sigmas,
        size=float(np.linalg.norm(size[:3])),
        p_value=p,
        together=True,
        correct=partial(left_out, at=lines_of(out)),
        at=at,
    )


FAULT = Fault("outlier", moved)
LAST = Fault("outlier", partial(moved, last=True))
