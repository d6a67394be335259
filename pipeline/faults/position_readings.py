"""Outliers among readings of positions, and exchanged rows that the identified robot reveals."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from pipeline.base.quantities import plain
from pipeline.faults.mistake import Mistake, length, outlying
from pipeline.faults.position_rows import PositionSheet, PositionTable, in_order, laid, since
from pipeline.geometry.gross_errors import TableMistake
from pipeline.geometry.study import BadReading, Study

_USUAL_LOSS = 1e-3
"""Fraction of readings that an unattended instrument loses [1]; up to it, outliers are left out and
listed without costing the campaign its verdict. In a published stationary series of an absolute
tracker, 13 of 1000 rows are failed locks; it is the second smallest fraction in
`system.family.MISTAKES`."""


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
    """Every reading that was left out, with its row of the table."""
    of = [_row(one, rows) for one in found.bad]
    lines = rows["line"].to_numpy(int)
    return [_outlier(one, row, int(lines[row])) for one, row in zip(found.bad, of, strict=True)]


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


def _without(rows: pd.DataFrame, row: int) -> pd.DataFrame:
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
