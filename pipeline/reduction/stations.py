"""A tracker moved to another station in mid-campaign: transform all readings to the first one.

A round of base reflectors that fits them by itself, but from another place than the round before,
begins a station. Later readings p are transformed by

    p' = R_1' (R_k p + t_k - t_1),    C' = R_1' R_k C R_k' R_1,

R_k and t_k the pose in F_b of station k by its own rounds. All later stages see one station.
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
"""Minimum distance of two stations [m]: a tracker that is knocked or drifts moves less, one that is
carried moves by metres."""

_FITS_M = 0.03
"""Maximum residual of a reflector in a round that fixes a station [m]."""


class Station(NamedTuple):
    """A tracker station, valid from some round of base reflectors on.

    A reading p from here is `turn` p + `shift` [m] as read from the first station.

    Attributes:
        group: Group of the round.
        moved_m: Distance from the previous station [m].
        begun: Start of its first round, seconds after the first reading [s].
        turn: Rotation into the tracker's frame of the first station, shape (3, 3).
        shift: Its position in that frame [m], shape (3,).
    """

    group: str
    moved_m: float
    begun: float
    turn: Array
    shift: Array

    @property
    def back(self) -> Station:
        """The inverse transformation."""
        return self._replace(turn=self.turn.T, shift=-self.turn.T @ self.shift)


class Round(NamedTuple):
    """Base reflectors read in one group: start, points in the tracker's frame and nominal ones."""

    group: str
    begun: float
    points: Array
    nominal: Array

    def pose(self) -> tuple[Array, Array]:
        """R and t of the tracker in F_b."""
        return linear.rigid(self.points, self.nominal)

    def off_m(self, R: Array, t: Array) -> float:
        """Largest residual of a reflector for this pose of the tracker [m]."""
        return float(np.linalg.norm(self.nominal - self.points @ R.T - t, axis=1).max())


def one_station(
    settings: Settings, readings: pd.DataFrame
) -> tuple[pd.DataFrame, tuple[Station, ...]]:
    """Table READINGS transformed to the tracker's first station, and its later stations."""
    stations = _stations(rounds_of(settings, readings))
    if len(stations) < 2:
        return readings, ()
    (R1, t1), *others = [_joined(rounds).pose() for rounds in stations]
    before, told = t1, []
    for (R, t), rounds in zip(others, stations[1:], strict=True):
        moved_m, begun = float(np.linalg.norm(t - before)), rounds[0].begun
        told.append(Station(rounds[0].group, moved_m, begun, R1.T @ R, R1.T @ (t - t1)))
        before = t
    return moved_by(readings, told), tuple(told)


def with_rounds_exchanged(
    settings: Settings, readings: pd.DataFrame, stations: Sequence[Station], pair: tuple[str, str]
) -> tuple[pd.DataFrame, tuple[Station, ...]]:
    """As `one_station`, after exchanging the readings of two rounds of base reflectors.

    Args:
        settings: The campaign.
        readings: Table READINGS as from one station.
        stations: Later stations of the tracker.
        pair: Groups of the two rounds.
    """
    back = [one.back for one in stations]
    shot = moved_by(readings, back) if back else readings.copy()
    one, other = (shot.index[shot["group"] == group] for group in pair)
    of = shot["target"].astype(str)
    source = dict(zip(of[other], other, strict=True)) if of[other].is_unique else {}
    both = [(k, source[of[k]]) for k in one if of[k] in source]
    if not both:
        return readings, tuple(stations)
    here, there = (list(rows) for rows in zip(*both, strict=True))
    columns = [*XYZ, *covariance.columns()]
    shot.loc[there + here, columns] = shot.loc[here + there, columns].to_numpy()
    return one_station(settings, shot)


def moved_by(readings: pd.DataFrame, stations: Sequence[Station]) -> pd.DataFrame:
    """Table READINGS with the readings of each station transformed as it says."""
    since, out, columns = seconds(readings), readings.copy(), covariance.columns()
    ends = [one.begun for one in stations[1:]]
    for one, end in zip(stations, [*ends, np.inf], strict=False):  # there may be none
        rows = (since >= one.begun) & (since < end)
        out.loc[rows, XYZ] = readings.loc[rows, XYZ].to_numpy(float) @ one.turn.T + one.shift
        six = [readings.loc[rows, column].to_numpy(float) for column in columns]
        out.loc[rows, columns] = np.column_stack(covariance.turned(six, one.turn))
    return out


def rounds_of(settings: Settings, readings: pd.DataFrame) -> list[Round]:
    """Rounds that determine a station by themselves, in order of time."""
    base = readings.assign(since=seconds(readings))[readings["pose"].isna()]
    base = base[base["target"].isin(list(settings.base_frame)) & base["since"].notna()]
    out = []
    for group, rows in base.groupby("group", observed=True):
        nominal = np.array([settings.base_frame[name] for name in rows["target"]])
        one = Round(str(group), float(rows["since"].min()), rows[XYZ].to_numpy(float), nominal)
        few = rows["target"].nunique() < BASE_REFLECTORS
        if not few and apart(nominal) and one.off_m(*one.pose()) < _FITS_M:
            out.append(one)
    return sorted(out, key=lambda one: one.begun)


def _stations(rounds: list[Round]) -> list[list[Round]]:
    """Consecutive rounds grouped by station."""
    out = [rounds[:1]]
    for before, one in pairwise(rounds):
        if one.off_m(*before.pose()) > _CARRIED_M:
            out.append([])
        out[-1].append(one)
    return out


def _joined(rounds: list[Round]) -> Round:
    """All rounds of a station as one."""
    points = np.concatenate([one.points for one in rounds])
    nominal = np.concatenate([one.nominal for one in rounds])
    return Round(rounds[0].group, rounds[0].begun, points, nominal)
