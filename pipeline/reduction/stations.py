"""A tracker that was carried to another place in mid-campaign: all readings as from the first one.

A round of base reflectors that fits them by itself, but from elsewhere than the round before,
begins a station. What is read from then on is read from there:

    p' = R_1' (R_k p + t_k - t_1),    C' = R_1' R_k C R_k' R_1,

R_k and t_k the pose in F_b of station k by its own rounds. From then on there is one station.
"""

from __future__ import annotations

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

    Attributes:
        group: The round's.
        moved_m: How far the tracker was carried from the station before [m].
    """

    group: str
    moved_m: float


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
    since, out, told = seconds(readings), readings.copy(), []
    (R1, t1), *others = [_joined(rounds).pose() for rounds in stations]
    before = t1
    for (R, t), rounds, after in zip(others, stations[1:], [*stations[2:], None], strict=True):
        end = after[0].begun if after else np.inf
        rows = (since >= rounds[0].begun) & (since < end)
        turn = R1.T @ R
        out.loc[rows, XYZ] = readings.loc[rows, XYZ].to_numpy(float) @ turn.T + R1.T @ (t - t1)
        columns = covariance.columns()
        six = [readings.loc[rows, column].to_numpy(float) for column in columns]
        out.loc[rows, columns] = np.column_stack(covariance.turned(six, turn))
        told.append(Station(rounds[0].group, float(np.linalg.norm(t - before))))
        before = t
    return out, tuple(told)


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
