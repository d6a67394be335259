"""Axes recorded while the robot drove, a row every few milliseconds: a joint log of where it stood.

A KUKA trace saved as text, RTDE's csv of a UR (`actual_q_0` in radians), or any table with a time
and a column for each axis. Poses are the places at which it stood, in their order; a place to which
it came back is the home position and none of them. Axes and torques are medians.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools

_STOOD_S = 5.0
"""A stop that is no pose is shorter [s]; one at which reflectors are read lasts longer."""
_AWAY = np.deg2rad(0.02)
"""What a standing axis moves at most [rad]; encoders show less, the smallest motion more."""
_AWAY_MM = 0.2
"""The same of a rail [mm]."""
_FEWEST = 50
"""Rows of a recording; a log has one for each pose or pull."""
_LARGEST = 2_000_000
"""Cells that are looked at."""
_BEGIN, _FIRST_LINES = 20_000, 60
"""Bytes and lines in which titles are looked for."""
_TITLE = re.compile(r"(?P<stem>.*?)[ _.\[(]*(?P<number>[0-9])[\])]?(?P<rest>[^0-9]*)")
_TIME = re.compile(r"(?:time|timestamp|zeit|t)(?:[ _]*[\[(]?(?P<unit>ms|s|sec)[\])]?)?")
_TORQUE = re.compile(r"torque|moment")
_NOT_WHERE = re.compile(
    r"target|soll|cmd|command|qd|vel|speed|geschw|current|strom|temp|accel|beschl|error|fehler|"
    r"voltage|mode|tcp"
)
_E1 = re.compile(r".*\be1\b[^0-9]*")
_NUMBERED = {"pose", "stellung", "messpose"}
"""Titles of a log with a row for each pose, which is no recording."""
_ARM = 5
"""Axes of the smallest arm."""
_WHERE = re.compile(r"(?:^|[^a-z])(?:q|a|j|axis|axes|joint)|achs|gelenk|axispos|jpos")


@dataclass(frozen=True)
class _Columns:
    """Which columns are what, by their places.

    Attributes:
        time: The time, and what makes seconds of it.
        axes: Place and title of each axis.
        torques: Place of each joint's torque; empty where there are none.
    """

    time: tuple[int, float]
    axes: tuple[tuple[int, str], ...]
    torques: tuple[int, ...]


@functools.lru_cache(maxsize=2)  # each robot that may have made it asks once more
def table(data: bytes) -> bytes | None:
    """The places at which a recorded robot stood as a table; None where it is no recording."""
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
    """The columns of a recording; None where a time or the axes are missing, or poses numbered."""
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
    """Columns whose titles differ by a number alone, counted from 0 or 1.

    Attributes:
        stem: What stands before the number, in small letters.
        rest: What stands behind it.
        places: Of the columns.
    """

    stem: str
    rest: str
    places: tuple[int, ...]

    @property
    def of_torques(self) -> bool:
        """Torques that were measured."""
        name = self.stem + self.rest
        return bool(_TORQUE.search(name)) and "target" not in name

    @property
    def of_axes(self) -> bool:
        """Where the axes are."""
        name = self.stem + self.rest
        return bool(_WHERE.search(name)) and not (_TORQUE.search(name) or _NOT_WHERE.search(name))


def _families(low: Sequence[str]) -> Iterator[_Family]:
    """The families of titles that are as many as an arm has axes, in their turn."""
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
    """Place of the time, and what makes seconds of it."""
    found = ((k, _TIME.fullmatch(title)) for k, title in enumerate(low))
    return next(((k, 1e-3 if one["unit"] == "ms" else 1.0) for k, one in found if one), None)


def _axes(families: Sequence[_Family]) -> list[tuple[int, str]]:
    """Place and title of each axis of the arm."""
    for one in families:
        if one.of_axes:
            unit = _unit(one.stem, one.rest)
            return [(k, f"A{n}{unit}") for n, k in enumerate(one.places, 1)]
    return []


def _rail(low: Sequence[str]) -> list[tuple[int, str]]:
    """Place and title of the rail, where there is one."""
    k = next((k for k, one in enumerate(low) if _E1.fullmatch(one)), None)
    if k is None or _NOT_WHERE.search(low[k]):
        return []
    return [(k, f"E1 [{'m' if '[m]' in low[k] else 'mm'}]")]


def _unit(stem: str, rest: str) -> str:
    """Unit of angles with its brackets, empty where nobody says it; RTDE has radians."""
    if "rad" in rest or stem == "actual_q":
        return " [rad]"
    return " [deg]" if re.search(r"deg|°|grad", rest) else ""


def _numbers(lines: Sequence[str], delimiter: str, width: int) -> Array:
    """Rows of numbers, shape (n, width); a line that is none is skipped, an empty cell is NaN."""
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
    """Of each column at each stop, shape (m, k)."""
    found = [np.median(values[one], axis=0) for one in stops]
    return np.array(found).reshape(len(stops), values.shape[1])


def _tolerance(title: str, values: Array) -> float:
    """What an axis moves at most while it stands, in its unit."""
    if title.startswith("E"):
        return _AWAY_MM * (1e-3 if "[m]" in title else 1.0)
    in_rad = "[rad]" in title or ("[deg]" not in title and np.nanmax(np.abs(values)) < 2 * np.pi)
    return float(_AWAY if in_rad else np.rad2deg(_AWAY))


def _stands(at: Array, away: Array) -> list[slice]:
    """Runs of rows in which no axis moves farther than `away` (k,) from the first of them."""
    out, first = [], 0
    for k in range(1, len(at) + 1):
        if k == len(at) or not (np.abs(at[k] - at[first]) <= away).all():
            out.append(slice(first, k))
            first = k
    return out


def _came_back(means: Array, away: Array) -> Bools:
    """Places that are one, with another place between, shape (m,)."""
    near = (np.abs(means[:, None] - means[None]) <= 2 * away).all(axis=2)
    apart = np.abs(np.arange(len(means))[:, None] - np.arange(len(means))[None]) > 1
    return np.asarray((near & apart).any(axis=1))
