"""A unit, or the sign of a joint, that changes in mid-file: from some row on numbers are otherwise.

For forces the pulls show it: with factors c_i of the readings and relative weights w_i = 1 / |y_i|,
the residual sum of squares of the joint springs is quadratic in the factors, so that every row and
every unit can be tried. For the joint log the robot's table shows it, and for the tracker the
distances between the targets of a group, which the robot does not change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import LOGGED, UNITS, anchored, pairs, scaled, symbol, unloaded
from pipeline.faults.exchanged import misplaced
from pipeline.faults.exchanged_pulls import (
    USUAL_MISFIT,
    OrderFit,
    PullMoves,
    ordered,
    rows_of,
)
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, lines_of, without_pulls
from pipeline.machine.effect import PULLED
from pipeline.readers.logs import FORCE, SCALE
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.measured import STILL_M
from pipeline.reduction.register import XYZ

_FORCE = FORCE | {"dan": SCALE["dan"]}
"""Units that may have been read for each other [N]."""

_ALIKE = 0.03
"""Relative difference below which two units are both stated [1]: a scale's calibration, and a cause
that is not in the model yet, are as large."""

_ROWS = 2
"""Minimum number of rows in each unit; a single one is a wrong reading."""


def unit_since(asked: Screening) -> list[Mistake]:
    """The row from which on tracker, joint log or scale are in another unit."""
    case = asked.case
    if case.settings.displacements is not None:
        return []
    return [*_coordinates(case)] or [*_joints(case)] or _forces(asked)


# --- the tracker ----------------------------------------------------------------------------------


def _coordinates(case: Case) -> Iterator[Mistake]:
    """Groups of readings whose targets are apart by another unit, others being right.

    The spread of a group is the rms distance of its targets from their centre, of the effector's by
    [tool], of the base reflectors by [base_frame].
    """
    rows = case.readings
    times = rows["group"].map(
        {name: _too_small(case, one) for name, one in rows.groupby("group", sort=False)}
    )
    right = _near(times, 1.0)
    for factor, (unit, says) in UNITS.items():
        wrong = _near(times, factor)
        if min(rows["group"][one].nunique() for one in (wrong, right)) < _ROWS:
            continue
        of = rows["pose"].notna()
        order = rows[of].sort_values(["file", "line"]).index
        later = _from(wrong[order].to_numpy(bool), ~wrong[order].to_numpy(bool)) is not None
        wrong = _in_mid_group(rows, wrong, order, factor) if later else wrong
        at = lines_of(rows[wrong])
        since = f"from {at[0]} on in the tracker export {says}"
        found = _finding(
            where=unit,
            says=since if later else f"in {len(at)} rows of the tracker export {says}",
            why=f"the targets of these groups are {factor:.4g} times as far from each other if so, "
            "as those of the others are",
            at=at,
            factor=factor,
            correct=partial(_regauged, at=frozenset(at), factor=factor),
        )
        yield found if later else replace(found, since=None)


def _in_mid_group(
    rows: pd.DataFrame, wrong: pd.Series[bool], order: pd.Index, factor: float
) -> pd.Series[bool]:
    """`wrong` with the rows before it in a group within which the unit changes.

    Such a row is nearer to the centre of the rows before it in its group with the factor.
    """
    wrong = wrong.copy()
    before = order[: int(np.argmax(wrong[order]))]
    group = rows.loc[before][rows["group"][before] == rows["group"][before[-1]]]
    points = group[XYZ].to_numpy(float)
    for k in range(len(group) - 1, 0, -1):
        centre = points[:k].mean(axis=0)
        as_read, scaled_ = (np.linalg.norm(c * points[k] - centre) for c in (1.0, factor))
        if as_read <= scaled_:
            break
        wrong[group.index[k]] = True
    return wrong


def _near(times: pd.Series[float], factor: float) -> pd.Series[bool]:
    """Rows whose group is too small by this factor, to a tenth."""
    return times.div(factor).between(0.9, 1.1)


def _too_small(case: Case, group: pd.DataFrame) -> float:
    """Spread of a group's targets as stated over that as read; NaN where it is unknown."""
    base = bool(group["pose"].isna().all())
    places = case.settings.base_frame if base else case.tool.named
    here = group[group["target"].isin(list(places))].drop_duplicates("target")
    if len(here) < 2:
        return np.nan
    stated, read = (
        float(np.std(points, axis=0) @ np.std(points, axis=0))
        for points in (np.array([places[t] for t in here["target"]]), here[XYZ].to_numpy(float))
    )
    return float(np.sqrt(stated / max(read, STILL_M**2)))


def _regauged(case: Case, at: frozenset[str], factor: float) -> Case:
    mine = np.isin(lines_of(case.readings), list(at))
    other = scaled(factor)(replace(case, readings=case.readings[mine])).readings
    return replace(case, readings=pd.concat([case.readings[~mine], other]).sort_index())


# --- the scale ------------------------------------------------------------------------------------


def _forces(asked: Screening) -> list[Mistake]:
    moved, data = PullMoves.of(asked), asked.reduced.data
    if moved is None or not (data.pulls.by[moved.pull] == PULLED).all():
        return []
    row = rows_of(asked.case, data, moved.pull)
    at = np.argsort(asked.case.loads["line"].to_numpy()[row])
    found = _split(moved, at) or _within(moved, at, data.pulls.pose[moved.pull])
    if found is None:
        return []
    return [_of_forces(asked.case, asked.case.loads.iloc[row[at[found.wrong]]], found)]


@dataclass(frozen=True)
class _Change:
    """Where the scale's unit changes.

    Attributes:
        wrong: The pulls with the wrong numbers, in the order of the file.
        unit: The other unit.
        sign: 1 where the wrong numbers are in it and were read as N, else -1.
    """

    wrong: slice
    unit: str
    sign: int

    @property
    def instead(self) -> tuple[str, ...]:
        """Other units that may be meant, as they hardly differ from it."""
        near = (abs(np.log(size / _FORCE[self.unit])) for size in _FORCE.values())
        return tuple(one for one, off in zip(_FORCE, near, strict=True) if 0 < off < _ALIKE)

    @property
    def factor(self) -> float:
        """Factor on the wrong numbers."""
        return float(_FORCE[self.unit] ** self.sign)


def _split(moved: PullMoves, at: Ints) -> _Change | None:
    """The change of unit that fits, and in which of the two parts."""
    N, b, square = _normal(moved, at)
    whole = np.sqrt(_left(N.sum(axis=0), b.sum(axis=0), square))
    tried = {}
    for unit, factor in _FORCE.items():
        for sign in (1, -1) if factor != 1 else ():
            c = float(factor**sign)
            for first in range(_ROWS, len(at) - _ROWS + 1):
                head, tail = slice(None, first), slice(first, None)
                both = N[head].sum(axis=0) + c**2 * N[tail].sum(axis=0)
                left = _left(both, b[head].sum(axis=0) + c * b[tail].sum(axis=0), square)
                tried[first, unit, sign] = np.sqrt(left)
    best = min(tried, key=lambda one: tried[one])
    found = _likelier(moved, at, *best)
    return None if tried[best] * CLEARLY_NEARER > whole else found


def _normal(moved: PullMoves, at: Ints) -> tuple[Array, Array, float]:
    """Relative normal equations of each pull in the order of the file, and the sum of squares."""
    w = 1 / np.maximum(np.linalg.norm(moved.y, axis=1), STILL_M)
    A, y = (w * moved.force)[:, None, None] * moved.G, w[:, None] * moved.y
    N, b = np.einsum("mci,mcj->mij", A, A), np.einsum("mci,mc->mi", A, y)
    return N[at], b[at], float(len(at))


def _left(N: Array, b: Array, square: float) -> float:
    """Mean residual square of the pulls, relative to their displacements."""
    size = np.sqrt(np.maximum(np.diag(N), 1e-300))
    x = linear.inverse(N / size / size[:, None]) @ (b / size)
    return max(1 - float(x @ (b / size)) / square, 0.0)


def _likelier(moved: PullMoves, at: Ints, first: int, unit: str, sign: int) -> _Change | None:
    """Whether the later forces are too small by a factor, or the earlier ones too large by it.

    Both fit alike; the compliances, in typical ones, are nearer to one with one of them. None where
    the pulls do not agree either way.
    """
    later = _Change(slice(first, None), unit, sign)
    fit = _corrected(moved, at, later)
    if fit.model > USUAL_MISFIT:
        return None
    usual = float(np.median(fit.x[fit.x > 0])) if (fit.x > 0).any() else 1.0
    if abs(np.log(usual)) <= abs(np.log(usual * later.factor)):
        return later
    return replace(later, sign=-sign, wrong=slice(None, first))


def _corrected(moved: PullMoves, at: Ints, change: _Change) -> OrderFit:
    """The fit with the wrong numbers in their unit."""
    factor = np.ones(len(at))
    factor[at[change.wrong]] = change.factor
    return ordered(replace(moved, force=moved.force * factor), np.arange(len(at)))


def _within(moved: PullMoves, at: Ints, pose: Ints) -> _Change | None:
    """Rows in succession that fit in another unit only, among rows that fit as they are.

    With the compliances on which most pulls agree, r_i = (force by the displacements) / (force as
    logged) is 1 in these and the factor of the unit in those. If none do, those of one pose are
    left out, which few others would not outweigh.
    """
    runs = list[tuple[int, float, _Change]]()
    for one in (None, *np.unique(pose)):
        others = pose != one
        if runs or not others.any():
            continue
        known = moved.only(others)
        due = moved.due(known.solved(known.force))[0]
        off = np.log(np.maximum(due / moved.force, STILL_M))[at]
        if np.median(np.abs(off)) <= USUAL_MISFIT:
            runs += _runs(off)
    return max(runs, key=lambda one: one[:2])[2] if runs else None


def _runs(off: Array) -> Iterator[tuple[int, float, _Change]]:
    """Rows in succession whose r_i is the factor of a unit: how many, how nearly, and that unit.

    Args:
        off: ln r_i in the order of the file, shape (m,).
    """
    for (unit, size), sign in product(_FORCE.items(), (1, -1)):
        away = np.abs(off - sign * np.log(size))
        ends = np.flatnonzero(np.diff(away < USUAL_MISFIT)) + 1
        for run in np.split(np.arange(len(off)), ends) if size != 1 else ():
            if len(run) >= _ROWS and away[run].max() < USUAL_MISFIT:
                stop = None if run[-1] == len(off) - 1 else int(run[-1]) + 1
                yield (
                    len(run),
                    -float(np.median(away[run])),
                    _Change(slice(int(run[0]), stop), unit, sign),
                )


def _of_forces(case: Case, rows: pd.DataFrame, change: _Change) -> Mistake:
    unit, factor, at = change.unit, change.factor, lines_of(rows)
    keys = frozenset(zip(rows["pose"].tolist(), rows["repeat"].tolist(), strict=True))
    either = " or ".join(map(symbol, (unit, *change.instead)))
    text = f"are {either} and were read as N"
    if change.sign != 1:
        text = f"are N and were read as {either}"
    said = f"from {at[0]} on"
    if change.wrong.stop is not None:
        said = f"from {at[0]} to {at[-1]}" if change.wrong.start else f"up to {at[-1]}"
    found = _finding(
        where=unit if change.sign == 1 else "n",
        says=f"{said} the numbers of the scale {text}",
        why=f"these pulls moved the robot {factor:.4g} times as far per newton as the others",
        at=at,
        factor=factor,
        correct=partial(_times, keys=keys, factor=factor),
    )
    since = found.since if change.wrong.stop is None else None
    instead = change.instead if change.sign == 1 else ()
    if instead and change.wrong.start and since is None:  # few, and not known to 3 %
        correct = partial(without_pulls, pulls=keys)
        found = replace(found, correct=correct, correction="recomputed without these pulls")
    return replace(found, since=since, instead=instead)


def _times(case: Case, keys: frozenset[tuple[int, int]], factor: float) -> Case:
    loads = case.loads
    mine = [key in keys for key in zip(loads["pose"], loads["repeat"], strict=True)]
    times = np.where(mine, factor, 1.0)
    new = {name: loads[name] * times for name in ("force_n", "unit_n")}
    return replace(case, loads=loads.assign(**new))


# --- the joint log --------------------------------------------------------------------------------


def _from(wrong: Bools, right: Bools) -> int | None:
    """Index from which on all are wrong, if all before are right and both parts are long enough."""
    if not wrong.any():
        return None
    first = int(np.argmax(wrong))
    whole = bool(wrong[first:].all() and right[:first].all())
    return first if whole and first >= _ROWS and len(wrong) - first >= _ROWS else None


def _joints(case: Case) -> Iterator[Mistake]:
    """Rows of the joint log from which on another unit or sign explains the robot's position."""
    before = _away(case)
    log = case.joints.sort_values(["file", "line"])
    first = int(np.argmax(log["pose"].isin(before)))
    if not before or not _ROWS <= first <= len(log) - _ROWS:
        return
    poses, at = frozenset(log["pose"].iloc[first:].tolist()), lines_of(log.iloc[first:])
    for where, factor, says, columns in _otherwise(case):
        correct = partial(_relogged, columns=columns, poses=poses, factor=factor)
        if columns and misplaced(correct(case)) == frozenset():
            found = _finding(
                where=where,
                says=f"from {at[0]} on in the joint log {says}",
                why="with that corrected the reflectors are where the robot file places them",
                at=at,
                factor=factor,
                correct=correct,
            )
            yield replace(found, name="sign_or_convention") if factor < 0 else found
            return


def _away(case: Case) -> frozenset[int]:
    """Poses elsewhere than the table predicts; by the base reflectors alone if most of them are."""
    known, frame = misplaced(case), anchored(case)
    if known is not None or frame is None:
        return known or frozenset()
    zeros, (R, t) = unloaded(case), frame
    seen, expected, _ = pairs(case, zeros)
    far = np.linalg.norm(seen @ R.T + t - expected, axis=1) > GROSS_DISTANCE_M
    return frozenset(zeros["pose"][far].tolist())


def _otherwise(case: Case) -> Iterator[tuple[str, float, str, Sequence[str]]]:
    """What may change in the joint log: its name, factor, sentence and columns."""
    for ending, unit, factor, says in LOGGED:
        yield unit, factor, says, [name for name in case.joint_columns if name.endswith(ending)]
    for column, joint in zip(case.joint_columns, case.robot.joints, strict=True):
        yield f"{joint.name}_reversed", -1.0, f"{joint.name} has the opposite sign", [column]


def _relogged(case: Case, columns: Sequence[str], poses: frozenset[int], factor: float) -> Case:
    scale = np.where(case.joints["pose"].isin(poses), factor, 1.0)
    new = {name: case.joints[name] * scale for name in columns}
    return replace(case, joints=case.joints.assign(**new))


def _finding(
    *, where: str, says: str, why: str, at: tuple[str, ...], factor: float, correct: partial[Case]
) -> Mistake:
    return Mistake(
        name="unit_mixup",
        where=where,
        evidence=f"{says} ({lines(at)}): {why}",
        correction=f"recomputed with these rows times {factor:.4g}",
        before=float(max(factor, 1 / factor)),
        after=1.0,
        unit="1",
        correct=correct,
        at=at,
        since=at[0],
    )


FAULT = Fault("unit_mixup", unit_since, in_files=True)
