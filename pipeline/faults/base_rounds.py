"""Rounds of base reflectors read from two stations, with exchanged readings.

Each round fits [base_frame] by itself, so that no reflector contradicts another one; but readings
after it are then transformed from the wrong station, which the robot's table reveals.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from pipeline.faults.assignment import lines
from pipeline.faults.conventions import anchored, pairs, unloaded
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, length, lines_of
from pipeline.readers.known import BETTER
from pipeline.reduction.case import Case
from pipeline.reduction.stations import with_rounds_exchanged

_MOST = 30
"""Maximum number of rounds of which all pairs are tried; nobody moves a tracker so often."""


def base_rounds(case: Case) -> list[Mistake]:
    """The two rounds whose exchange brings the effector to its position by the robot's table."""
    if not case.stations or (before := _away(case)) is None:
        return []
    away = {
        pair: np.inf if (at := _away(_exchanged(case, pair))) is None else at
        for pair in combinations(_rounds(case)[:_MOST], 2)
    }
    best, *others = sorted(away, key=lambda pair: away[pair])
    rival = min((away[pair] for pair in others), default=np.inf)
    if BETTER * away[best] > min(before, rival):
        return []
    return [_finding(case, best, before, away[best])]


def _rounds(case: Case) -> list[str]:
    """Groups in which base reflectors were read."""
    rows = case.readings[case.readings["pose"].isna()]
    rows = rows[rows["target"].isin(list(case.settings.base_frame))]
    return [str(group) for group in rows["group"].unique()]


def _exchanged(case: Case, pair: tuple[str, str]) -> Case:
    """The campaign with the readings of two of its rounds exchanged."""
    rows, stations = with_rounds_exchanged(case.settings, case.readings, case.stations, pair)
    return replace(case, readings=rows, stations=stations)


def _away(case: Case) -> float | None:
    """Mean distance of the effector from its position by the table [m]; None if unknown."""
    where = anchored(case) if case.settings.base_frame else None
    if where is None:
        return None
    seen, expected, _ = pairs(case, unloaded(case))
    away = np.linalg.norm(seen @ where[0].T + where[1] - expected, axis=1)
    return float(np.mean(away)) if len(away) else None


def _finding(case: Case, pair: tuple[str, str], before: float, after: float) -> Mistake:
    rows = case.readings
    at = lines_of(rows[rows["group"].isin(pair) & rows["pose"].isna()])
    return Mistake(
        name="exchanged",
        where=f"{pair[0]}/{pair[1]}",
        evidence=f"the rounds {pair[0]} and {pair[1]} of the base reflectors have each other's "
        f"readings ({lines(at)}): as they stand the effector is {length(before)} from where the "
        f"robot's table has it, and {length(after)} with the two exchanged",
        correction=f"recomputed with the readings of {pair[0]} and {pair[1]} exchanged",
        before=1e3 * before,
        after=1e3 * after,
        unit="mm",
        correct=partial(_exchanged, pair=pair),
        at=at,
    )


FAULT = Fault("exchanged", lambda asked: base_rounds(asked.case), True)
