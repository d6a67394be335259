"""Survey of a campaign's contents before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.base.linear import rms
from pipeline.faults.conventions import unloaded
from pipeline.machine.cell import predict
from pipeline.readers import logs
from pipeline.readers._iso import NO_YEAR
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.register import XYZ, dated
from pipeline.reduction.settings import Point

_ZONE = pd.Timedelta(minutes=15)
"""Step of time zones (IANA tz database); clocks that are set differ by less."""


@dataclass(frozen=True)
class Distance:
    """Distance between two reflectors, as read and as stated in campaign.toml.

    Attributes:
        table: `tool` or `base_frame`.
        first: One of them.
        second: The other.
        read_m: Median over the unloaded states of all poses, or over all readings [m].
        stated_m: By their coordinates in campaign.toml [m].
        count: Number of states or rounds.
    """

    table: str
    first: str
    second: str
    read_m: float
    stated_m: float
    count: int

    @property
    def off_m(self) -> float:
        """Absolute difference of read and stated distance [m]."""
        return abs(self.read_m - self.stated_m)


def distances(case: Case) -> list[Distance]:
    """Distances between all measured targets read unloaded, and between all base reflectors."""
    base = case.readings[case.readings["pose"].isna()]
    tool = {name: case.settings.tool[name] for name in case.settings.measured}
    known = [("tool", tool, unloaded(case)), ("base_frame", case.settings.base_frame, base)]
    return [one for table, places, rows in known for one in _between(table, places, rows)]


@dataclass(frozen=True, eq=False)
class SurveyedPose:
    """One pose and its loads.

    Attributes:
        pose: Its number.
        q: Joint values [m] or [rad], shape (n,).
        pulls: Number of loads.
        least_n: Smallest force [N].
        most_n: Largest force [N].
    """

    pose: int
    q: Array
    pulls: int
    least_n: float
    most_n: float


def stands(data: Measured) -> list[SurveyedPose]:
    """Every pose that is used, with its forces."""
    if not len(data.pulls):
        return []
    order = np.argsort(data.pulls.pose, kind="stable")
    pose, first, count = np.unique(data.pulls.pose[order], return_index=True, return_counts=True)
    force = np.linalg.norm(data.pulls.force[order], axis=1)
    least, most = (over.reduceat(force, first) for over in (np.minimum, np.maximum))
    q = data.pulls.q[order][first]
    return [
        SurveyedPose(int(pose[k]), q[k], int(count[k]), float(least[k]), float(most[k]))
        for k in range(len(pose))
    ]


def over_nominal(case: Case, data: Measured) -> float | None:
    """Ratio of measured displacements to those of the nominal stiffnesses, rms [1].

    None if the robot file lacks a stiffness, or there are no displacements.
    """
    if any(joint.stiffness is None for joint in case.robot.joints) or not len(data.delta):
        return None
    moved = predict(case.cell, data.pulls, case.robot.nominal_compliance).displacement
    expected = rms(moved[data.pull, data.target])
    return rms(data.delta) / expected if expected else None


@dataclass(frozen=True)
class CampaignTimes:
    """Times of a campaign.

    Attributes:
        first: Time of the first reading.
        last: Time of the last reading.
        pause: Longest time between two readings.
        before: Group of the reading after it.
        backwards: Number of readings earlier than the previous one of their file.
        away: Offset of the times of a log from those of the readings, by its file name; none if
            these have no date.
    """

    first: pd.Timestamp
    last: pd.Timestamp
    pause: pd.Timedelta
    before: str
    backwards: int
    away: dict[str, pd.Timedelta]

    @property
    def ends(self) -> tuple[str, str]:
        """First and last time in ISO 8601, without the date if nobody states it."""
        whole = self.first.year > NO_YEAR
        first, last = (
            (one if whole else one.time()).isoformat() for one in (self.first, self.last)
        )
        return first, last


def clock(case: Case, files: Mapping[str, bytes]) -> CampaignTimes | None:
    """Times of a campaign; None if no reading has one.

    Args:
        case: The campaign.
        files: Content of its logs by name; those with a column `time` are compared.
    """
    rows = case.readings.dropna(subset=["time"])
    if not len(rows):
        return None
    ordered = rows.sort_values("time", kind="stable")
    step = ordered["time"].diff()
    at = int(np.argmax(step.fillna(pd.Timedelta(0)).to_numpy()))
    back = rows.groupby("file", observed=True)["time"].diff() < pd.Timedelta(0)
    compared = files if dated(rows["time"]) else {}
    away = {name: _away(rows, name, data) for name, data in compared.items()}
    return CampaignTimes(
        first=ordered["time"].iloc[0],
        last=ordered["time"].iloc[-1],
        pause=pd.Timedelta(0) if len(rows) < 2 else step.iloc[at],
        before=str(ordered["group"].iloc[at]),
        backwards=int(back.sum()),
        away={name: by for name, by in away.items() if by is not None and abs(by) >= _ZONE},
    )


def _away(rows: pd.DataFrame, name: str, data: bytes) -> pd.Timedelta | None:
    """Median offset of a log's times from the readings of their poses; None without times."""
    time = logs.Quantity("time", {}, "name", needed=False)
    try:
        log = logs.table(name, data, [logs.POSE, time])
    except InputError:
        return None
    if "time" not in log.word:
        return None
    at = pd.to_datetime(pd.Series(log.word["time"]), errors="coerce", format="ISO8601")
    pose = rows.groupby("pose")["time"].mean().reindex(log.number["pose"])
    off = (at.to_numpy() - pose.to_numpy()).astype("timedelta64[s]")
    known = off[~np.isnat(off)]
    return pd.Timedelta(np.median(known.astype(float)), unit="s") if len(known) else None


def _between(table: str, places: Mapping[str, Point], rows: pd.DataFrame) -> Iterator[Distance]:
    at = {name: _by_group(rows, name) for name in places if (rows["target"] == name).any()}
    names = list(at)
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            both = pd.concat([at[first], at[second]], axis=1, join="inner").to_numpy(float)
            if len(both):
                seen = float(np.median(np.linalg.norm(both[:, :3] - both[:, 3:], axis=1)))
                stated = float(np.linalg.norm(_array(places[first]) - _array(places[second])))
                yield Distance(table, first, second, seen, stated, len(both))


def misshapen(case: Case, most_m: float) -> list[str]:
    """Unloaded states, if less than half, whose reflectors are not as far apart as [tool] states.

    Args:
        case: The campaign.
        most_m: Deviation of a distance from which on it is wrong [m].
    """
    rows, out = unloaded(case), set[str]()
    at = {name: _by_group(rows, name) for name in case.settings.measured}
    for first, second in combinations(at, 2):
        both = pd.concat([at[first], at[second]], axis=1, join="inner")
        seen = np.linalg.norm(both.to_numpy(float) @ np.vstack([np.eye(3), -np.eye(3)]), axis=1)
        stated = np.linalg.norm(
            _array(case.settings.tool[first]) - _array(case.settings.tool[second])
        )
        out |= set(both.index[np.abs(seen - stated) > most_m])
    return sorted(out) if 2 * len(out) < rows["group"].nunique() else []


def _by_group(rows: pd.DataFrame, name: str) -> pd.DataFrame:
    return rows[rows["target"] == name].groupby("group", observed=True)[XYZ].median()


def _array(place: Point) -> Array:
    return np.array(place)
