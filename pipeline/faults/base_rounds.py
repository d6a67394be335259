"""Rounds of base reflectors that do not show from which station the poses were read.

Two rounds have each other's readings, or the tracker was carried poses before the round that shows
it, or a drift runs the other way. Each round fits [base_frame] by itself, so that no reflector
contradicts another one; but poses are then transformed from the wrong place, which the robot's
table reveals.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
from pipeline.base.linear import moved_onto
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import FEWEST_POSES, anchored, pairs, unloaded
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, length, lines_of
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.case import Case
from pipeline.reduction.register import seconds
from pipeline.reduction.stations import Round, moved_by, rounds_of, with_rounds_exchanged
from pipeline.system import alarms, odds

_MOST = 30
"""Maximum number of rounds of which all pairs are tried; nobody moves a tracker so often."""


def base_rounds(case: Case) -> list[Mistake]:
    """The two rounds whose exchange brings the effector to its position by the robot's table.

    A tracker that was carried at another pose leaves it farther away.
    """
    if not case.stations or (before := _away(case)) is None:
        return []
    away = {
        pair: np.inf if (at := _away(_exchanged(case, pair))) is None else at
        for pair in combinations(_rounds(case)[:_MOST], 2)
    }
    best, *others = sorted(away, key=lambda pair: away[pair])
    rival = min((away[pair] for pair in others), default=np.inf)
    moved = [_away(one.correct(case)) or 0.0 for one in carried(case)]
    if CLEARLY_NEARER * away[best] > min(before, rival) or (
        CLEARLY_NEARER * min(moved, default=np.inf) < away[best]
    ):
        return []
    return [_finding(case, best, before, away[best])]


def drifted(case: Case) -> list[Mistake]:
    """The two rounds of one station whose exchange turns a drift the way the effector shows it.

    A tracker that drifts sees the unloaded effector creep as the rounds of base reflectors do. With
    S the sum of squared deviations of the poses from the table, each pose seen from where the
    tracker stood by the rounds before and after it, the likelihood ratio of an exchange is
    (S / S')^(n/2), n = 3 poses - 6; chance exceeds 1 / a in less than a of all cases. Rivals are
    the exchange of two others, and that one of the two rounds is bad in any place.
    """
    rounds = [] if case.stations else rounds_of(case.settings, case.readings)[:_MOST]
    since = pd.Series(seconds(case.readings), case.readings.index)
    rows = unloaded(case).assign(since=since).dropna(subset="since")
    poses = rows["pose"].nunique()
    if len(rounds) < 2 or poses < FEWEST_POSES:
        return []
    left = {
        (a, b): _square(case, rows, _in_place(rounds, a, b))
        for a, b in combinations(range(len(rounds)), 2)
    }
    before, best = _square(case, rows, rounds), min(left, key=lambda pair: left[pair])
    rivals = [square for pair, square in left.items() if pair != best]
    rivals += [_square(case, rows, [*rounds[:k], *rounds[k + 1 :]]) for k in best]
    gains = (3 * poses - 6) * np.log(np.array([before, min(rivals)]) / left[best])
    if (gains < (-2 * np.log(alarms.MOVED), odds.DECIDES)).any():
        return []
    a, b = (rounds[k].group for k in best)
    away = (float(np.sqrt(square / poses)) for square in (before, left[best]))
    return [_finding(case, (a, b), *away)]


def _in_place(rounds: list[Round], a: int, b: int) -> list[Round]:
    """The rounds with the points of two of them exchanged."""
    out = list(rounds)
    for here, there in ((a, b), (b, a)):
        points, nominal = rounds[there].points, rounds[there].nominal
        out[here] = rounds[here]._replace(points=points, nominal=nominal)
    return out


def _square(case: Case, rows: pd.DataFrame, rounds: list[Round]) -> float:
    """Sum over poses of the squared mean deviation of the targets from the table [m^2].

    Each reading is transformed into F_b by the rounds before and after it, in proportion to time.
    """
    seen, expected, _ = pairs(case, rows)
    begun = [one.begun for one in rounds]
    placed = np.zeros_like(seen)
    for mine, one in zip(np.eye(len(rounds)), rounds, strict=True):
        R, t = one.pose()
        placed += np.interp(rows["since"].to_numpy(), begun, mine)[:, None] * (seen @ R.T + t)
    off = pd.DataFrame(moved_onto(placed, expected) - expected)
    return float(np.sum(off.groupby(rows["pose"].to_numpy(int)).mean().to_numpy() ** 2))


def carried(case: Case) -> list[Mistake]:
    """Stations that hold from an earlier pose on than the round of base reflectors that shows them.

    Between two rounds all poses before are nearer to their places by the table as read from the
    station before, and all later ones as read from the next one, `CLEARLY_NEARER` times each.
    """
    where = anchored(case) if case.stations and case.settings.base_frame else None
    found = (_since(case, k, *where) for k in range(len(case.stations))) if where else ()
    return [one for one in found if one is not None]


def _since(case: Case, k: int, R: Array, t: Array) -> Mistake | None:
    """The mistake that station `k` holds from some pose before its round on."""
    rows, since = unloaded(case), pd.Series(seconds(case.readings), case.readings.index)
    begun = case.stations[k - 1].begun if k else -np.inf
    rows = rows[(since[rows.index] >= begun) & (since[rows.index] < case.stations[k].begun)]
    if not len(rows):
        return None
    seen, expected, _ = pairs(case, rows)
    places = pd.DataFrame(
        {
            "given": np.linalg.norm(seen @ R.T + t - expected, axis=1),
            "later": np.linalg.norm(_as_from(case, k, seen) @ R.T + t - expected, axis=1),
            "since": since[rows.index].to_numpy(),
        }
    )
    of_pose = places.groupby(rows["pose"].to_numpy(int))
    away = of_pose.agg({"given": "median", "later": "median", "since": "min"}).sort_values("since")
    moved = (CLEARLY_NEARER * away["later"] < away["given"]).to_numpy()
    first = int(np.argmax(moved))
    if (
        not moved[first:].all()
        or (CLEARLY_NEARER * away["given"] >= away["later"]).iloc[:first].any()
    ):
        return None
    late = case.readings["pose"].isin(away.index[first:])
    return _of_station(case, k, away, first, float(since[late[late].index].min()))


def _as_from(case: Case, k: int, points: Array) -> Array:
    """Readings before the round of station `k` as if they were read from it, shape (m, 3) [m]."""
    if k:
        before = case.stations[k - 1].back
        points = points @ before.turn.T + before.shift
    return np.asarray(points @ case.stations[k].turn.T + case.stations[k].shift)


def _of_station(case: Case, k: int, away: pd.DataFrame, first: int, start: float) -> Mistake:
    station, pose = case.stations[k], int(away.index[first])
    before, after = (float(away[name].iloc[first:].median()) for name in ("given", "later"))
    where = f"before pose {pose}" if first == 0 else f"after pose {int(away.index[first - 1])}"
    rows = case.readings
    base = rows[rows["group"].astype(str) == station.group]
    at = lines_of(base[base["pose"].isna()])
    return Mistake(
        name="tracker_moved",
        where=where,
        evidence=f"the tracker was carried {length(station.moved_m)} {where}, and its base was "
        f"read from there only in {station.group} ({lines(at)}): as from the station before, the "
        f"effector is {length(before)} from where the robot's table has it since pose {pose}, and "
        f"{length(after)} as from the one of {station.group}",
        correction=f"recomputed with the readings since pose {pose} as from the later station",
        before=1e3 * before,
        after=1e3 * after,
        size=station.moved_m,
        size_unit="m",
        correct=partial(_with_begin, k=k, start=start),
        at=at,
    )


def _with_begin(case: Case, k: int, start: float) -> Case:
    """The campaign with station `k` begun at another time."""
    stations = tuple(
        one._replace(begun=start) if i == k else one for i, one in enumerate(case.stations)
    )
    shot = moved_by(case.readings, [one.back for one in case.stations])
    return replace(case, readings=moved_by(shot, stations), stations=stations)


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
        correct=partial(_exchanged, pair=pair),
        at=at,
    )


FAULT = Fault(
    "exchanged", lambda asked: base_rounds(asked.case) or drifted(asked.case), in_files=True
)

CARRIED = Fault("tracker_moved", lambda asked: carried(asked.case), True)
