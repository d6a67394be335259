"""A unit, or the sign of a joint, that changes in mid-file: from some row on numbers are otherwise.

For the joint log the robot's table shows it, and for the tracker the distances between the targets
of a group, which the robot does not change; for the scale see `scale_rows`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pipeline.base.arrays import Array, Bools, Strings
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import LOGGED, UNITS, anchored, mapped, pairs, unloaded
from pipeline.faults.exchanged import misplaced
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.measured import STILL_M
from pipeline.reduction.register import XYZ

_ROWS = 2
"""Minimum number of rows in each unit; a single one is a wrong reading."""


def unit_since(asked: Screening) -> list[Mistake]:
    """The row from which on tracker or joint log are in another unit."""
    case = asked.case
    if case.settings.displacements is not None:
        return []
    return [*_coordinates(case)] or [*_joints(case)]


# --- the tracker ----------------------------------------------------------------------------------


def _coordinates(case: Case) -> Iterator[Mistake]:
    """Groups of readings whose targets are apart by another unit, others being right.

    The spread of a group is the rms distance of its targets from their centre, of the effector's by
    [tool], of the base reflectors by [base_frame].
    """
    rows = case.readings
    times = _times(case)
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
        found = of_unit(
            where=unit,
            says=since if later else f"in {len(at)} rows of the tracker export {says}",
            why=f"as read, the targets of these groups are {1 / factor:.4g} times as far from each "
            "other as in all other groups",
            at=at,
            factor=factor,
            correct=partial(_regauged, at=frozenset(at), factor=factor),
        )
        yield found if later else replace(found, since=None)


def _in_mid_group(
    rows: pd.DataFrame, wrong: pd.Series[bool], order: pd.Index, factor: float
) -> pd.Series[bool]:
    """`wrong` with the rows before it in a group within which the unit changes.

    The first such row is nearer to the centre of those before it in its group with the factor.
    """
    wrong = wrong.copy()
    before = order[: int(np.argmax(wrong[order]))]
    group = rows.loc[before][rows["group"][before] == rows["group"][before[-1]]]
    points = group[XYZ].to_numpy(float)
    for k in range(1, len(group)):
        centre = points[:k].mean(axis=0)
        as_read, scaled_ = (np.linalg.norm(c * points[k] - centre) for c in (1.0, factor))
        if scaled_ < as_read:
            wrong[group.index[k:]] = True
            break
    return wrong


def _near(times: pd.Series[float], factor: float) -> pd.Series[bool]:
    """Rows whose group is too small by this factor, to a tenth."""
    return times.div(factor).between(0.9, 1.1)


def _times(case: Case) -> pd.Series[float]:
    """Spread of each reading's group as stated over that as read; NaN where it is unknown."""
    rows = case.readings
    alone, target = rows["pose"].isna().to_numpy(), rows["target"].to_numpy(object)
    at, times = rows[XYZ].to_numpy(float), np.full(len(rows), np.nan)
    base, effector = case.settings.base_frame, case.tool.named
    for mine in rows.groupby("group", sort=False).indices.values():
        places = base if alone[mine].all() else effector
        times[mine] = _too_small(places, target[mine], at[mine])
    return pd.Series(times, rows.index)


def _too_small(places: Mapping[str, ArrayLike], target: Strings, at: Array) -> float:
    """As `_times`, of the readings (r, 3) of one group; of a target the first one."""
    first: dict[str, int] = {}
    for k, name in enumerate(target):
        if name in places:
            first.setdefault(name, k)
    if len(first) < 2:
        return np.nan
    stated, read = (
        float(np.std(points, axis=0) @ np.std(points, axis=0))
        for points in (np.array([places[name] for name in first]), at[list(first.values())])
    )
    return float(np.sqrt(stated / max(read, STILL_M**2)))


def _regauged(case: Case, at: frozenset[str], factor: float) -> Case:
    mine = np.isin(lines_of(case.readings), list(at))
    other = mapped(factor * np.eye(3), replace(case, readings=case.readings[mine])).readings
    return replace(case, readings=pd.concat([case.readings[~mine], other]).sort_index())


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
            found = of_unit(
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


def of_unit(
    *, where: str, says: str, why: str, at: tuple[str, ...], factor: float, correct: partial[Case]
) -> Mistake:
    """The mistake of rows in another unit since the first of them."""
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
