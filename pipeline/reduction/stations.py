"""A tracker that was carried to another place in mid-campaign: all readings as from the first one.

A round of base reflectors that fits them by itself, but from elsewhere than the round before,
begins a station. What is read from then on is read from there:

    p' = R_1' (R_k p + t_k - t_1),    C' = R_1' R_k C R_k' R_1,

R_k and t_k the pose in F_b of station k by its own rounds. From then on there is one station.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array
from pipeline.reduction.register import XYZ, apart, seconds
from pipeline.reduction.settings import BASE_REFLECTORS, Settings

_CARRIED_M = 0.1
"""A tracker that is knocked or drifts moves by less [m], one that is carried by metres."""

_FITS_M = 0.03
"""A round of base reflectors is one of a station where none of them is farther off [m]."""


class Station(NamedTuple):
    """Where a tracker stood from some round of base reflectors on.

    What it reads as p the first station reads as `turn` p + `shift` [m].

    Attributes:
        group: The round's.
        moved_m: How far the tracker was carried from the station before [m].
        begun: When its first round began, seconds after the first reading [s].
        turn: Rotation into the tracker's frame of the first station, shape (3, 3).
        shift: Where it stands in that frame [m], shape (3,).
    """

    group: str
    moved_m: float
    begun: float
    turn: Array
    shift: Array

    @property
    def back(self) -> Station:
        """What undoes it."""
        return self._replace(turn=self.turn.T, shift=-self.turn.T @ self.shift)


class _Round(NamedTuple):
    """Base reflectors read in one group: when, points in the tracker's frame and nominal ones."""

    group: str
    begun: float
    points: Array
    nominal: Array

    def pose(self) -> tuple[Array, Array]:
        """R and t of the tracker in F_b."""
        return linear.rigid(self.points, self.nominal)

    def off_m(self, R: Array, t: Array) -> float:
        """How far the farthest reflector is off, read from such a pose."""
        return float(np.linalg.norm(self.nominal - self.points @ R.T - t, axis=1).max())


def one_station(
    settings: Settings, readings: pd.DataFrame
) -> tuple[pd.DataFrame, tuple[Station, ...]]:
    """Table READINGS as if the tracker had stood where it first did, and where else it stood."""
    stations = _stations(_rounds(settings, readings))
    if len(stations) < 2:
        return readings, ()
    (R1, t1), *others = [_joined(rounds).pose() for rounds in stations]
    before, told = t1, []
    for (R, t), rounds in zip(others, stations[1:], strict=True):
        moved_m, begun = float(np.linalg.norm(t - before)), rounds[0].begun
        told.append(Station(rounds[0].group, moved_m, begun, R1.T @ R, R1.T @ (t - t1)))
        before = t
    return _moved(readings, told), tuple(told)


def with_rounds_exchanged(
    settings: Settings, readings: pd.DataFrame, stations: Sequence[Station], pair: tuple[str, str]
) -> tuple[pd.DataFrame, tuple[Station, ...]]:
    """As of `one_station` if two rounds of base reflectors have each other's readings.

    Args:
        settings: The campaign.
        readings: Table READINGS as from one station.
        stations: Where else the tracker stood.
        pair: Groups of the two rounds.
    """
    shot = _moved(readings, [one.back for one in stations])
    one, other = (shot.index[shot["group"] == group] for group in pair)
    of = shot["target"].astype(str)
    source = dict(zip(of[other], other, strict=True)) if of[other].is_unique else {}
    both = [(k, source[of[k]]) for k in one if of[k] in source]
    if not both:
        return readings, tuple(stations)
    here, there = (list(rows) for rows in zip(*both, strict=True))
    columns = [*XYZ, *covariance.columns()]
    kept = shot.loc[here + there, columns].to_numpy()
    shot.loc[there + here, columns] = kept
    return one_station(settings, shot)


def _moved(readings: pd.DataFrame, stations: Sequence[Station]) -> pd.DataFrame:
    """Table READINGS with what was read from each station turned and shifted as it says."""
    since, out, columns = seconds(readings), readings.copy(), covariance.columns()
    ends = [one.begun for one in stations[1:]]
    for one, end in zip(stations, [*ends, np.inf], strict=True):
        rows = (since >= one.begun) & (since < end)
        out.loc[rows, XYZ] = readings.loc[rows, XYZ].to_numpy(float) @ one.turn.T + one.shift
        six = [readings.loc[rows, column].to_numpy(float) for column in columns]
        out.loc[rows, columns] = np.column_stack(covariance.turned(six, one.turn))
    return out


def _rounds(settings: Settings, readings: pd.DataFrame) -> list[_Round]:
    """Rounds that fix a station by themselves, in the order of time."""
    base = readings.assign(since=seconds(readings))[readings["pose"].isna()]
    base = base[base["target"].isin(list(settings.base_frame)) & base["since"].notna()]
    out = []
    for group, rows in base.groupby("group", observed=True):
        nominal = np.array([settings.base_frame[name] for name in rows["target"]])
        one = _Round(str(group), float(rows["since"].min()), rows[XYZ].to_numpy(float), nominal)
        few = rows["target"].nunique() < BASE_REFLECTORS
        if not few and apart(nominal) and one.off_m(*one.pose()) < _FITS_M:
            out.append(one)
    return sorted(out, key=lambda one: one.begun)


def _stations(rounds: list[_Round]) -> list[list[_Round]]:
    """Rounds in a row that were read from one place."""
    out = [rounds[:1]]
    for before, one in pairwise(rounds):
        if one.off_m(*before.pose()) > _CARRIED_M:
            out.append([])
        out[-1].append(one)
    return out


def _joined(rounds: list[_Round]) -> _Round:
    """All rounds of a station as one."""
    points = np.concatenate([one.points for one in rounds])
    nominal = np.concatenate([one.nominal for one in rounds])
    return _Round(rounds[0].group, rounds[0].begun, points, nominal)
