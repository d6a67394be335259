"""Rows of the scale that state something else than the force: another unit, or the row before.

The displacements of a pull tell what the scale should have read (see `exchanged_pulls`). With r_i
that force over the logged one, a row is in another unit where r_i is nearer to the unit's factor
than to one, given the compliances of all pulls with their numbers in the units so found (Dempster,
Laird and Rubin, J. Roy. Stat. Soc. B 39, 1977, with each row in the likelier of its two states).
Rows that contradict the others and have the number of the row before them were copied.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import symbol
from pipeline.faults.exchanged_pulls import (
    FEWEST,
    LEAST_SHIFTED,
    USUAL_MISFIT,
    OrderFit,
    PullMoves,
    ordered,
    rows_of,
)
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, lines_of, pulls_of, without_pulls
from pipeline.faults.unit_since import of_unit
from pipeline.machine.effect import PULLED
from pipeline.readers.logs import FORCE, SCALE
from pipeline.reduction.case import Case
from pipeline.reduction.measured import STILL_M

_FORCE = FORCE | {"dan": SCALE["dan"]}
"""Units that may have been read for each other [N]."""

_ALIKE = 0.03
"""Relative difference below which two units are both stated [1]: a scale's calibration, and a cause
that is not in the model yet, are as large."""

_ROWS = 2
"""Minimum number of rows that are otherwise; a single one is a wrong reading."""

_ROUNDS = 12
"""Maximum number of assignments of rows to units."""


def scale_rows(asked: Screening) -> list[Mistake]:
    """The rows of the scale that were copied from the row before, else those in another unit."""
    moved, data = PullMoves.of(asked), asked.reduced.data
    if moved is None or not (data.pulls.by[moved.pull] == PULLED).all():
        return []
    row = rows_of(asked.case, data, moved.pull)
    at = np.argsort(asked.case.loads["line"].to_numpy()[row])
    rows, moved = asked.case.loads.iloc[row[at]], moved.only(at)
    copied = _copied(moved)
    if copied.sum() >= _ROWS:
        return [_of_copies(rows[copied])]
    found = _in_unit(moved, data.pulls.pose[moved.pull])
    return [] if found is None else [_of_unit(rows[found.wrong], found)]


# --- another unit ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Change:
    """Rows of the scale in another unit.

    Attributes:
        wrong: Pulls with the wrong numbers, in the order of the file, shape (m,).
        unit: The other unit.
        sign: 1 where the wrong numbers are in it and were read as N, else -1.
    """

    wrong: Bools
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

    @property
    def ends(self) -> tuple[bool, bool, bool]:
        """Whether the rows are in succession, and so from the first row on, and up to the last."""
        turns = int(np.abs(np.diff(self.wrong.astype(int))).sum())
        first, last = bool(self.wrong[0]), bool(self.wrong[-1])
        return turns + first + last == 2, first, last

    def right(self, moved: PullMoves) -> PullMoves:
        """The pulls with the wrong numbers in their unit."""
        return replace(moved, force=moved.force * np.where(self.wrong, self.factor, 1.0))

    def fit(self, moved: PullMoves) -> OrderFit:
        """Their fit."""
        return ordered(self.right(moved), np.arange(len(moved.force)))


def _in_unit(moved: PullMoves, pose: Ints) -> _Change | None:
    """The rows that agree with all others in another unit only.

    Sought from the compliances on which most pulls agree, else from typical ones; if there are
    none, from those of all poses but one, which few others would not outweigh. None where all pulls
    agree as logged: two poses that determine nothing together agree in any units.
    """
    logged = ordered(moved, np.arange(len(moved.force)))
    if logged.model <= USUAL_MISFIT and _agree(moved, logged, moved.force).all():
        return None
    found = [*_changes(moved, logged.x)] or [*_changes(moved, np.ones(moved.G.shape[2]))]
    for one in np.unique(pose) if not found else ():
        others = moved.only(pose != one)
        found += _changes(moved, others.solved(others.force))
    best = min(found, key=lambda one: one[:2], default=None)
    return None if best is None else _likelier(moved, best[2])


def _changes(moved: PullMoves, start: Array) -> Iterator[tuple[int, float, _Change]]:
    """Rows in each unit by the compliances from a start on, fewer and farther last."""
    for (unit, size), sign in product(_FORCE.items(), (1, -1)):
        x, change = start, _Change(np.zeros(len(moved.force), dtype=bool), unit, sign)
        for _ in range(_ROUNDS if size != 1 else 0):
            off = np.log(np.maximum(moved.due(x)[0] / moved.force, STILL_M))
            wrong = np.abs(off - np.log(change.factor)) < np.abs(off)
            if (wrong == change.wrong).all() or wrong.sum() < _ROWS:
                break
            change = replace(change, wrong=wrong)
            x = moved.solved(change.right(moved).force)
        kept = _decided(moved, change) if change.wrong.any() else None
        if kept is not None:
            yield -int(kept.wrong.sum()), _away(moved, kept, start), kept


def _away(moved: PullMoves, change: _Change, start: Array) -> float:
    """How far a change is from what the pulls show, to choose between units that are alike.

    Up to an end of the file the residual sum of squares, as all displacements are equally noisy; of
    few rows between others the median of |ln(r_i / factor)|, by compliances on which these agree.
    """
    if not any(change.ends[1:]):
        off = np.log(np.maximum(moved.due(start)[0] / moved.force, STILL_M))[change.wrong]
        return float(np.median(np.abs(off - np.log(change.factor))))
    A = (change.right(moved).force[:, None, None] * moved.G).reshape(-1, moved.G.shape[2])
    y = moved.y.ravel()
    return float(np.sum((y - A @ linear.least_squares(A, y)) ** 2))


def _decided(moved: PullMoves, change: _Change) -> _Change | None:
    """The change in those rows that contradict the others as logged and agree in the unit.

    None where they are not several, as many others still contradict, most pulls do not agree, or no
    others are N for certain: weak pulls agree in either unit.
    Single numbers that are too large have lost their decimal point instead.
    """
    fit, force = change.fit(moved), moved.force
    near = np.abs(moved.due(fit.x)[0] / (change.factor * force) - 1) < USUAL_MISFIT
    wrong = ~_agree(moved, fit, force) & (near | _agree(moved, fit, change.factor * force))
    change = replace(change, wrong=wrong)
    fit, right = change.fit(moved), change.right(moved)
    most = _ROWS <= wrong.sum() > (~_agree(moved, fit, right.force)).sum()
    agree, in_unit = (_agree(moved, fit, f * force) for f in (1.0, change.factor))
    several = most and (agree & ~in_unit).sum() >= _ROWS
    happens = change.sign == 1 or change.ends[0]
    return change if several and happens and fit.model <= USUAL_MISFIT else None


def _agree(moved: PullMoves, fit: OrderFit, force: Array) -> Bools:
    """Whether forces (m,) agree with the displacements of the pulls by the fit to some of them."""
    due, own = moved.due(fit.x)
    variance = own**2 + moved.std**2 + (fit.model * due) ** 2
    return np.asarray((force - due) ** 2 <= moved.least * variance)


def _likelier(moved: PullMoves, change: _Change) -> _Change:
    """The change, or that of all other rows by the inverse factor, where it lasts to an end.

    Both fit alike; the compliances, in typical ones, are nearer to one with one of them.
    """
    whole, first, last = change.ends
    x = change.fit(moved).x
    usual = float(np.median(x[x > 0])) if (x > 0).any() else 1.0
    if not whole or not (first or last) or abs(np.log(usual)) <= abs(np.log(usual * change.factor)):
        return change
    return replace(change, sign=-change.sign, wrong=~change.wrong)


def _of_unit(rows: pd.DataFrame, change: _Change) -> Mistake:
    """The mistake of rows in another unit."""
    unit, factor, at = change.unit, change.factor, lines_of(rows)
    whole, first, last = change.ends
    either = " or ".join(map(symbol, (unit, *change.instead)))
    stated, read = (either, "N")[:: change.sign]
    found = of_unit(
        where=unit if change.sign == 1 else "n",
        says=f"{_said(at, *change.ends)} the numbers of the scale are {stated} and were read as "
        f"{read}",
        why=f"these pulls moved the robot {factor:.4g} times as far per newton as the others",
        at=at,
        factor=factor,
        correct=partial(_times, keys=pulls_of(rows), factor=factor),
    )
    since = found.since if whole and last else None
    found = replace(found, since=since, instead=change.instead if change.sign == 1 else ())
    if not found.instead or (whole and (first or last)):
        return found
    correct = partial(without_pulls, pulls=pulls_of(rows))  # few, and not known to 3 %
    return replace(found, correct=correct, correction="recomputed without these pulls")


def _said(at: tuple[str, ...], whole: bool, first: bool, last: bool) -> str:
    """Which rows, in words; arguments as of `_Change.ends`."""
    if not whole:
        return f"in {len(at)} rows"
    if last:
        return f"from {at[0]} on"
    return f"up to {at[-1]}" if first else f"from {at[0]} to {at[-1]}"


def _times(case: Case, keys: set[tuple[int, int]], factor: float) -> Case:
    loads = case.loads
    mine = [key in keys for key in zip(loads["pose"], loads["repeat"], strict=True)]
    new = {name: loads[name] * np.where(mine, factor, 1.0) for name in ("force_n", "unit_n")}
    return replace(case, loads=loads.assign(**new))


# --- the number of the row before -----------------------------------------------------------------


def _copied(moved: PullMoves) -> Bools:
    """The rows that contradict their pull and agree with the one before, whose number they repeat.

    After such a row, also those with what the row before should have read. If all of them are the
    last rows of the file, they are off by one instead. None where other rows contradict as often.

    Returns:
        Mask of shape (m,).
    """
    again = np.append(False, np.abs(np.diff(moved.force)) <= STILL_M * moved.force[1:])
    none = copied = np.zeros(len(again), dtype=bool)
    for _ in range(_ROUNDS):
        known = moved.only(~(again | copied))
        if again.sum() < _ROWS or len(known.force) < FEWEST:
            return none
        fit, held, copied = ordered(known, np.arange(len(known.force))), copied, none.copy()
        wrong = ~_agree(moved, fit, moved.force)
        before = np.roll(_agree(moved, fit, np.roll(moved.force, -1)), 1)
        for k in np.flatnonzero(wrong & before):
            copied[k] = again[k] or again[k - 1] or copied[k - 1]
        if (copied == held).all():
            break
    shifted = int(np.argmin(copied[::-1])) == copied.sum() >= LEAST_SHIFTED
    return none if shifted or 2 * copied.sum() <= wrong.sum() else copied


def _of_copies(rows: pd.DataFrame) -> Mistake:
    """The mistake of rows with the number of the row before."""
    file, at = str(rows["file"].iloc[0]), lines_of(rows)
    return Mistake(
        name="copied_column",
        where=f"{file} force",
        evidence=f"{len(at)} pulls have the force of the row before ({lines(at)}), which they "
        "contradict and the pull before does not: the number was copied",
        correction="recomputed without these pulls",
        before=float(len(at)),
        after=0.0,
        unit="1",
        correct=partial(without_pulls, pulls=pulls_of(rows)),
        at=at,
    )


FAULT = Fault("unit_mixup", scale_rows, in_files=True)
