"""Joint log from a recording of the axes, with a row every few milliseconds.

A KUKA trace saved as text, RTDE's csv of a UR (`actual_q_0` in radians), or any table with a time
and a column for each axis. Poses are the standstills in their order; a place that is visited again
is the home position and not a pose. Axis values and torques are medians.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools

_STOOD_S = 5.0
"""Minimum duration of a standstill that counts as a pose [s]; reading reflectors takes longer."""
_AWAY = np.deg2rad(0.02)
"""Maximum motion of an axis at standstill [rad]; encoder noise is smaller, the smallest motion
larger."""
_AWAY_MM = 0.2
"""Maximum motion of a rail at standstill [mm]."""
_FEWEST = 50
"""Minimum number of rows of a recording [1]; a log has only one for each pose or pull."""
_LARGEST = 2_000_000
"""Maximum number of cells that are read [1]."""
_BEGIN, _FIRST_LINES = 20_000, 60
"""Number of bytes and lines that are searched for titles [1]."""
_TITLE = re.compile(r"(?P<stem>.*?)[ _.\[(]*(?P<number>[0-9])[\])]?(?P<rest>[^0-9]*)")
_TIME = re.compile(r"(?:time|timestamp|zeit|t)(?:[ _]*[\[(]?(?P<unit>ms|s|sec)[\])]?)?")
_TORQUE = re.compile(r"torque|moment")
_NOT_WHERE = re.compile(
    r"target|soll|cmd|command|qd|vel|speed|geschw|current|strom|temp|accel|beschl|error|fehler|"
    r"voltage|mode|tcp"
)
_E1 = re.compile(r".*\be1\b[^0-9]*")
_NUMBERED = {"pose", "stellung", "messpose"}
"""Titles that occur in logs with a row for each pose, but not in recordings."""
_ARM = 5
"""Minimum number of axes of an arm [1]."""
_WHERE = re.compile(r"(?:^|[^a-z])(?:q|a|j|axis|axes|joint)|achs|gelenk|axispos|jpos")


@dataclass(frozen=True)
class _Columns:
    """Roles of columns, by index.

    Attributes:
        time: Time column, and its factor to seconds.
        axes: Index and title of each axis.
        torques: Index of each joint's torque; empty if there are none.
    """

    time: tuple[int, float]
    axes: tuple[tuple[int, str], ...]
    torques: tuple[int, ...]


@functools.lru_cache(maxsize=2)  # it is asked once for each candidate robot
def table(data: bytes) -> bytes | None:
    """Table of the poses at which a recorded robot stood; None if the file is not a recording."""
    begin = data[:_BEGIN].decode("utf-8-sig", "replace").splitlines()
    for number, line in enumerate(begin[:_FIRST_LINES]):
        for delimiter in (";", "\t", ",", " "):
            titles = [one.strip().strip('"') for one in line.split(delimiter)]
            columns = _columns(titles) if len(titles) > 4 else None
            if columns is not None:
                lines = data.decode("utf-8-sig", "replace").splitlines()
                rows = _numbers(lines[number + 1 :], delimiter, len(titles))
                return _standing(columns, rows) if len(rows) >= _FEWEST else None
    return None


def _columns(titles: Sequence[str]) -> _Columns | None:
    """The columns of a recording; None if time or axes are missing, or if poses are numbered."""
    low = [title.lower() for title in titles]
    families = [*_families(low)]
    time, axes = _time(low), _axes(families)
    if time is None or not axes or not _NUMBERED.isdisjoint(low):
        return None
    axes += _rail(low)
    torques = next((family.places for family in families if family.of_torques), ())
    return _Columns(time, tuple(axes), torques if len(torques) == len(axes) else ())


@dataclass(frozen=True)
class _Family:
    """Columns whose titles differ only in a number, counted from 0 or 1.

    Attributes:
        stem: Text before the number, in lower case.
        rest: Text after it.
        places: Column indices.
    """

    stem: str
    rest: str
    places: tuple[int, ...]

    @property
    def of_torques(self) -> bool:
        """Whether they are measured torques."""
        name = self.stem + self.rest
        return bool(_TORQUE.search(name)) and "target" not in name

    @property
    def of_axes(self) -> bool:
        """Whether they are measured axis positions."""
        name = self.stem + self.rest
        return bool(_WHERE.search(name)) and not (_TORQUE.search(name) or _NOT_WHERE.search(name))


def _families(low: Sequence[str]) -> Iterator[_Family]:
    """Families with at least as many columns as an arm has axes, in order."""
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for k, title in enumerate(low):
        if one := _TITLE.fullmatch(title):
            found.setdefault((one["stem"], one["rest"]), []).append((int(one["number"]), k))
    for (stem, rest), columns in found.items():
        numbers, places = zip(*columns, strict=True)
        first, count = numbers[0], len(numbers)
        if first <= 1 and count >= _ARM and [*numbers] == [*range(first, first + count)]:
            yield _Family(stem, rest, places)


def _time(low: Sequence[str]) -> tuple[int, float] | None:
    """Index of the time column and its factor to seconds; None if there is none."""
    found = ((k, _TIME.fullmatch(title)) for k, title in enumerate(low))
    return next(((k, 1e-3 if one["unit"] == "ms" else 1.0) for k, one in found if one), None)


def _axes(families: Sequence[_Family]) -> list[tuple[int, str]]:
    """Index and title of each axis of the arm."""
    for one in families:
        if one.of_axes:
            unit = _unit(one.stem, one.rest)
            return [(k, f"A{n}{unit}") for n, k in enumerate(one.places, 1)]
    return []


def _rail(low: Sequence[str]) -> list[tuple[int, str]]:
    """Index and title of the rail, if there is one."""
    k = next((k for k, one in enumerate(low) if _E1.fullmatch(one)), None)
    if k is None or _NOT_WHERE.search(low[k]):
        return []
    return [(k, f"E1 [{'m' if '[m]' in low[k] else 'mm'}]")]


def _unit(stem: str, rest: str) -> str:
    """Unit of angles in brackets, empty if not stated; RTDE has radians."""
    if "rad" in rest or stem == "actual_q":
        return " [rad]"
    return " [deg]" if re.search(r"deg|°|grad", rest) else ""


def _numbers(lines: Sequence[str], delimiter: str, width: int) -> Array:
    """Rows of numbers, shape (n, width); other lines are skipped, an empty cell is NaN."""
    out = []
    for line in lines[: _LARGEST // width]:
        cells = line.split(delimiter) if delimiter != " " else line.split()
        if len(cells) != width:
            continue
        marked = [one if delimiter == "," else one.replace(",", ".") for one in cells]
        try:
            out.append([float(one) if one.strip() else np.nan for one in marked])
        except ValueError:
            continue
    return np.array(out, dtype=np.float64).reshape(-1, width)


def _standing(columns: _Columns, rows: Array) -> bytes | None:
    place, factor = columns.time
    time = factor * rows[:, place]
    at = rows[:, [k for k, _ in columns.axes]]
    titles = [title for _, title in columns.axes]
    away = np.array([_tolerance(title, at[:, k]) for k, title in enumerate(titles)])
    stops = [one for one in _stands(at, away) if time[one][-1] - time[one][0] >= _STOOD_S]
    means = _medians(at, stops)
    own = ~_came_back(means, away)
    driven = [f"tau{k}_nm" for k in range(1, len(columns.torques) + 1)]
    values = np.hstack([means, _medians(rows[:, list(columns.torques)], stops)])[own]
    lines = ["\t".join([str(k), *map(repr, each)]) for k, each in enumerate(values.tolist(), 1)]
    head = "\t".join(["pose", *titles, *driven])
    return "\n".join([head, *lines, ""]).encode() if lines else None


def _medians(values: Array, stops: Sequence[slice]) -> Array:
    """Median of each column at each stop, shape (m, k)."""
    found = [np.median(values[one], axis=0) for one in stops]
    return np.array(found).reshape(len(stops), values.shape[1])


def _tolerance(title: str, values: Array) -> float:
    """Maximum motion of an axis at standstill, in its unit."""
    if title.startswith("E"):
        return _AWAY_MM * (1e-3 if "[m]" in title else 1.0)
    in_rad = "[rad]" in title or ("[deg]" not in title and np.nanmax(np.abs(values)) < 2 * np.pi)
    return float(_AWAY if in_rad else np.rad2deg(_AWAY))


def _stands(at: Array, away: Array) -> list[slice]:
    """Runs of rows in which no axis moves by more than `away` (k,) from their first row."""
    out, first = [], 0
    for k in range(1, len(at) + 1):
        if k == len(at) or not (np.abs(at[k] - at[first]) <= away).all():
            out.append(slice(first, k))
            first = k
    return out


def _came_back(means: Array, away: Array) -> Bools:
    """Places that were visited again after another one, shape (m,)."""
    near = (np.abs(means[:, None] - means[None]) <= 2 * away).all(axis=2)
    apart = np.abs(np.arange(len(means))[:, None] - np.arange(len(means))[None]) > 1
    return np.asarray((near & apart).any(axis=1))
