"""Put times of day without a date on days, so that they can be compared.

Within a file a fall by more than half a day is a midnight. A file begins on the day that brings it
nearest to the last reading of the one before: files are sorted by name, so that the round after all
poses may come first. The first of these days is the date of campaign.toml, else that of exports
with dates; where there is none, all stay in `NO_YEAR`, and only their differences count.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Ints
from pipeline.dialects.time_of_file import believed
from pipeline.readers._iso import NO_YEAR
from pipeline.readers._reader import Export

_DAY = 86_400_000_000
"""A day [us]."""
_FIRST, _SECOND = (
    int(np.datetime64(f"{NO_YEAR}-01-0{day}", "us").astype(np.int64)) for day in (1, 2)
)
"""Bounds of the day that times of day are read as [us]."""


def on_days(exports: Mapping[str, Export], date: datetime.date | None) -> dict[str, Export]:
    """The exports, those with times of day on consecutive days.

    Args:
        exports: By name, in the order in which they were measured as far as that is known.
        date: Day of the first reading, None if it is not known.
    """
    exports = believed(exports)
    placed: dict[str, Ints] = {}
    last, dated = None, list[int]()
    for name, export in exports.items():
        ticks = export.time.drop_null().cast(pa.int64()).to_numpy()
        if not len(ticks) or ticks.max() >= _SECOND:
            dated += [int(ticks.min())] if len(ticks) else []
            continue
        falls = np.diff(ticks, prepend=ticks[0]) < -_DAY // 2
        ticks = ticks + _DAY * np.cumsum(falls)
        if last is not None:
            ticks = ticks + _DAY * round((last - int(ticks[0])) / _DAY)
        placed[name], last = ticks, int(ticks[-1])
    if not placed:
        return exports
    day = min(dated, default=_FIRST)
    if date is not None:
        day = int(np.datetime64(date, "us").astype(np.int64))
    earliest = min(int(ticks.min()) for ticks in placed.values())
    shift = _DAY * (day // _DAY - earliest // _DAY)
    moved = {name: _at(exports[name], ticks + shift) for name, ticks in placed.items()}
    return {**exports, **moved}


def _at(export: Export, ticks: Ints) -> Export:
    """An export with these times [us], which leave out the readings without one."""
    there = np.asarray(export.time.is_valid())
    every = np.zeros(len(there), dtype=np.int64)
    every[there] = ticks
    return replace(export, time=pa.array(every, mask=~there).cast(export.time.type))
