"""Check that distances between reflectors have the size that campaign.toml states."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.base.quantities import plain
from pipeline.reduction._raw_readings import BASE, RawReadings
from pipeline.reduction.settings import Settings

_CERTAIN_FACTORS = {
    1000.0: "millimetres were taken for metres",
    1 / 1000: "metres were taken for millimetres",
    25.4: "millimetres were taken for inches",
    1 / 25.4: "inches were taken for millimetres",
    1000 / 25.4: "inches were taken for metres",
    25.4 / 1000: "metres were taken for inches",
}
"""Unit mistake that makes distances too large by each factor [1]."""
_TABLE_IN_INCHES = 25.4 / 1000
"""The same factor for a table of campaign.toml in inches, where exports state their own unit; in
millimetres its points would be out of reach."""
_SMALLEST_M = 1e-3
"""Minimum nominal spread of points that reveals a unit [m]."""
_NEAR = 0.2
"""Maximum deviation, in natural logarithms, of a ratio from a factor [1]; reflectors are placed
better than 20 %."""


def check_units(shots: RawReadings, settings: Settings) -> None:
    """Check that distances between reflectors have the size that campaign.toml states.

    Raises:
        InputError: They are off by a factor that only a wrong unit explains.
    """
    unit = settings.tracker.unit if settings.tracker else None
    tool = np.array([settings.tool[name] for name in settings.measured])
    unloaded = np.append(~shots.loaded, False)[shots.slot]  # -1, a base reading, takes the last
    rows = np.flatnonzero(unloaded & (shots.role >= 0) & (shots.role < len(tool)))
    _check_size(shots, rows, shots.slot[rows], tool[shots.role[rows]], "[tool]", unit)
    if not settings.base_frame:
        return
    names = shots.target.dictionary.to_pylist()
    nominal = np.array([settings.base_frame.get(name, (np.nan,) * 3) for name in names])
    rows = np.flatnonzero(shots.role == BASE)
    group, target = (np.asarray(names.indices)[rows] for names in (shots.group, shots.target))
    _check_size(shots, rows, group.astype(np.int64), nominal[target], "[base_frame]", unit)


def _check_size(
    shots: RawReadings, rows: Ints, together: Ints, nominal: Array, words: str, unit: str | None
) -> None:
    """Compare the spread of points read together with the spread of their nominal positions.

    A unit holds for a whole file: only a factor shared by most sets of a file counts.

    Args:
        shots: All readings.
        rows: Those of some points.
        together: Number of the set that each was read in.
        nominal: Their places in campaign.toml [m], shape (rows, 3).
        words: The table with these places.
        unit: Unit of the exports as stated in [tracker]; None if they state it themselves.

    Raises:
        InputError: One of `_CERTAIN_FACTORS` fits.
    """
    if not len(rows):
        return
    label = together + (int(together.max()) + 1) * shots.file[rows]
    member = pa.array(label).dictionary_encode().indices.to_numpy().astype(np.int64)
    seen, expected = (_spread(points, member) for points in (shots.position[rows], nominal))
    enough = (expected > _SMALLEST_M) & (seen > 0)
    ratio = np.where(enough, seen, 1.0) / np.where(enough, expected, 1.0)
    of = np.zeros(len(seen), dtype=np.int64)
    of[member] = shots.file[rows]
    for factor, meaning in _CERTAIN_FACTORS.items():
        off = enough & (np.abs(np.log(ratio / factor)) < _NEAR)
        most = 2 * np.bincount(of, off) > np.bincount(of, enough)
        hit = np.flatnonzero(off & most[of])
        if not len(hit):
            continue
        every = len({*of[hit]}) == len({*of}) and (len({*of}) > 1 or len(shots.files) == 1)
        if factor == _TABLE_IN_INCHES and not unit and every:
            raise InputError(
                f"{words} is in inches: distances between reflectors are "
                f"{_off(1 / factor)} there for those in {shots.files[shots.file[rows[0]]]}, which "
                "states its unit",
                "write it in metres",
                file="campaign.toml",
                key=[words.strip("[]")],
            )
        first = rows[member == hit[0]][0]
        raise InputError(
            f"distances between reflectors are {_off(factor)}, as if {meaning} "
            f"({plain(ratio[hit[0]], 4)} of those in {words})",
            "correct the unit of the export, in its column names or in [tracker]",
            file=shots.files[shots.file[first]],
            line=int(shots.line[first]),
        )


def _off(factor: float) -> str:
    """A factor in words."""
    times = f"{max(factor, 1 / factor):.1f}".removesuffix(".0")
    return f"{times} times too {'large' if factor > 1 else 'small'}"


def _spread(points: Array, member: Ints) -> Array:
    """Root of the summed squared distances from the mean of each set [m], shape (sets,)."""
    count = np.bincount(member)
    total = np.zeros(len(count))
    for axis in range(3):
        mean = np.bincount(member, points[:, axis]) / count
        total += np.bincount(member, (points[:, axis] - mean[member]) ** 2)
    return np.sqrt(total)
