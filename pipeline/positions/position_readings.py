"""Outliers among readings of positions, and exchanged rows that the identified robot reveals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.faults.assignment import lines
from pipeline.faults.mistake import Mistake, length, outlying
from pipeline.positions.gross_errors import TableMistake
from pipeline.positions.position_rows import PositionSheet, PositionTable, in_order, laid, since
from pipeline.positions.study import BadReading, Study

_USUAL_LOSS = 1e-3
"""Fraction of readings that an unattended instrument loses [1]; up to it, outliers are left out and
listed without costing the campaign its verdict. In a published stationary series of an absolute
tracker, 13 of 1000 rows are failed locks; it is the second smallest fraction in
`system.family.MISTAKES`."""

_GRID, _FINE = 73, 1e-6
"""Values of a joint that are tried over a turn, or over the rail, and the error of the best, of
their distance [1]."""


def exchanged_beside(sheet: PositionSheet, found: Study) -> tuple[list[Mistake], PositionSheet]:
    """Exchanged rows whose poses are too close to each other for a table as delivered.

    Args:
        sheet: The table of positions of the study.
        found: Result of the study.

    Returns:
        The mistakes, and the table without them.
    """
    every = found.every
    if every is None or not found.bad or len(every.readings) != len(sheet.readings):
        return [], sheet
    seen = laid(every.readings, found.final.mechanism, every.weights)
    mistakes = list(in_order(sheet, seen))
    return mistakes, sheet.without(mistakes)


def dated_beside(
    sheet: PositionSheet, wrong: list[Mistake], found: Study
) -> tuple[list[Mistake], PositionSheet] | None:
    """The first row in another unit by the identified robot; None where it is as was found before.

    Args:
        sheet: The table of positions as given.
        wrong: Its mistakes beside the robot as delivered.
        found: Result of the study without them.

    Returns:
        The mistakes, and the table without them.
    """
    others = [one for one in wrong if one.since is None]
    if len(others) == len(wrong) or not found.bad:
        return None
    again = list(since(sheet.without(others), found.final.mechanism))
    known = {(one.where, one.at) for one in wrong if one.since}
    if not again or {(one.where, one.at) for one in again} == known:
        return None
    new = [*others, *again]
    return new, sheet.without(new)


def outliers(found: Study, rows: PositionTable) -> list[Mistake]:
    """What was left out: single readings, or the joint value that displaces a whole pose."""
    poses: dict[tuple[str, int, int], list[BadReading]] = {}
    for one in found.bad:
        poses.setdefault((one.file, one.line, one.pose), []).append(one)
    return [mistake for mine in poses.values() for mistake in _of_pose(found, mine, rows)]


def _of_pose(found: Study, bad: list[BadReading], rows: PositionTable) -> Iterator[Mistake]:
    """The wrong joint value of a pose all of whose targets were left out, else its readings."""
    of, line = [_row(one, rows) for one in bad], rows["line"].to_numpy(int)
    meant = _wrong_joint(found, bad) if len(bad) > 1 else None
    if meant is not None:
        yield _mistyped(found, bad, meant, of, [f"{bad[0].file}:{line[row]}" for row in of])
        return
    for one, row in zip(bad, of, strict=True):
        yield _outlier(one, row, int(line[row]))


class _JointValue(NamedTuple):
    """Another value of one joint of a pose, with which its targets are where they were read."""

    pose: int
    joint: int
    value: float
    off_m: float


def _wrong_joint(found: Study, bad: list[BadReading]) -> _JointValue | None:
    """The one joint that explains all readings of a pose; None if none does, or several do."""
    assert found.every is not None
    every, mechanism, one = found.every.readings, found.final.mechanism, bad[0]
    at = (every.file == one.file) & (every.line == one.line) & (every.pose == one.pose)
    k = int(np.argmax(at))
    if int(np.isfinite(every.at[k, :, 0]).sum()) > len(bad):
        return None
    limit = laid(every, mechanism, found.every.weights).limit
    robot, own = mechanism.robot, found.every.weights

    def off(joint: int, values: Array) -> Array:
        """Mean squared distance of the targets with other values of a joint [m^2]."""
        which = np.full(len(values), k)
        poses = every.part(which)
        q = poses.q.copy()
        q[:, joint] = values
        return laid(replace(poses, q=q), mechanism, own.part(which)).own

    good: list[_JointValue] = []
    for j in range(robot.n):
        ends = every.q[:, j] if robot.prismatic[j] else every.q[k, j] + np.array([-np.pi, np.pi])
        grid, step = np.linspace(ends.min(), ends.max(), _GRID, retstep=True)
        near = grid[int(np.argmin(off(j, grid)))]
        best = optimize.minimize_scalar(
            lambda value, j=j: float(off(j, np.array([value]))[0]),
            bounds=(near - step, near + step),
            method="bounded",
            options={"xatol": _FINE * float(step)},
        )
        if best.fun <= limit:
            good.append(_JointValue(k, j, float(best.x), float(np.sqrt(best.fun))))
    return good[0] if len(good) == 1 else None


def _mistyped(
    found: Study, bad: list[BadReading], meant: _JointValue, rows: list[int], at: list[str]
) -> Mistake:
    """The joint value of a pose as a mistake; the pose is left out."""
    assert found.every is not None
    one, robot = bad[0], found.final.mechanism.robot
    slides = bool(robot.prismatic[meant.joint])
    given = float(found.every.readings.q[meant.pose, meant.joint])
    unit, size = ("mm", 1e-3) if slides else ("°", np.pi / 180)
    gap = " " if slides else ""
    place = f"{one.file} pose{one.pose:02d}"
    off_m = max(each.off_m for each in bad)
    return outlying(
        where=f"{one.series}/{place}" if one.series else place,
        evidence=f"pose {one.pose} ({lines(at)}) has {robot.joints[meant.joint].name} at "
        f"{plain(given / size, 6)}{gap}{unit}, and its targets stand {length(off_m)} from where "
        f"that puts them; with {plain(meant.value / size, 6)}{gap}{unit} {length(meant.off_m)}",
        correction=f"recomputed without pose {one.pose}",
        before=1e3 * off_m,
        after=1e3 * meant.off_m,
        unit="mm",
        size=abs(meant.value - given),
        size_unit="m" if slides else "rad",
        p_value=min(each.p for each in bad),
        at=tuple(at),
        together=True,
        correct=partial(_without, row=rows),
    )


def implausible_outliers(off: list[Mistake], found: Study) -> list[Mistake]:
    """Outliers that count as mistakes: all, if they exceed the fraction `_USUAL_LOSS`."""
    count = 0 if found.every is None else int(np.isfinite(found.every.readings.at[..., 0]).sum())
    return off if len(off) > _USUAL_LOSS * count else []


def _row(one: BadReading, rows: PositionTable) -> int:
    """Index of a reading's row in the table: its pose's first row, or a later one."""
    mine = rows["file"] == one.file
    first = rows.loc[mine & (rows["line"] == one.line), "series"]
    mine &= (rows["pose"] == one.pose) & (rows["target"] == one.target)
    mine &= rows["series"].isin(first)  # by its name in the file
    return int(np.argmax((mine & (rows["line"] >= one.line)).to_numpy()))


def _outlier(one: BadReading, row: int, line: int) -> Mistake:
    at = f"{one.file}:{line}"
    place = f"pose{one.pose:02d}/{one.target}"
    return outlying(
        where=f"{one.series}/{place}" if one.series else place,
        evidence=f"{one.target} of pose {one.pose} ({at}) stands {plain(1e3 * one.off_m, 3)} mm "
        "from where all other readings put it",
        correction=f"recomputed without {place}",
        before=1e3 * one.off_m,
        unit="mm",
        size=one.off_m,
        p_value=one.p,
        at=(at,),
        correct=partial(_without, row=row),
    )


def _without(rows: pd.DataFrame, row: int | list[int]) -> pd.DataFrame:
    return rows.drop(index=rows.index[row])


def wrong_entries(found: Study) -> list[Mistake]:
    """Gross errors of the robot file."""
    return [_entry(one) for one in found.mistakes]


def _entry(one: TableMistake) -> Mistake:
    row = "" if one.joint is None else f" of joint {one.joint}"
    if one.entry and one.said is not None and one.value is not None:
        what = f"the robot file has {one.entry} = {plain(one.said, 4)}{row}, and "
        what += f"{plain(one.value, 4)} is right"
    else:
        what = f"the robot file is wrong in {one.entry or one.where}{row}"
    return Mistake(
        name=one.name,
        where=str(one.where),
        evidence=f"{what}: the targets are {length(one.before)} from where it places them, and "
        f"{length(one.after)} with it corrected",
        correction="recomputed with the entry of the robot file corrected",
        before=1e3 * one.before,
        after=1e3 * one.after,
        correct=_as_it_is,
    )


def _as_it_is(rows: PositionTable) -> PositionTable:
    """The table of positions unchanged; the mistake is in the robot file."""
    return rows
