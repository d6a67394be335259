"""Times of files that name none for their rows: the moment above them, one file for each group.

A program that writes a file as soon as a group is measured says when in its heading. Files that
were all written at once say nothing of the clock: readings take time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

import pyarrow as pa

from pipeline.dialects import _time
from pipeline.readers._iso import NO_YEAR
from pipeline.readers._reader import Export
from pipeline.readers._text import Text

_MOMENT = re.compile(
    r"(?<![\w./:-])([0-9]{1,4}[./-][0-9]{1,2}[./-][0-9]{1,4})(?:T|[,;\t ]\W*)"
    r"([0-9]{1,2}:[0-9]{2}(?::[0-9]{2}(?:[.,][0-9]+)?)?(?: [AP]M)?)(?![\w:])"
)
"""A date and a time of day in a line of text."""
_FASTEST_US = 1_000_000
"""Shortest time that a reading takes [us]: trackers turn to a target and average for about 1 s."""
_SEVERAL = 2
"""Number of files whose times can be compared."""
_AT_ONCE = "no times: the files were all written at once, later than they were measured"


def above(text: Text, first: int) -> tuple[str, datetime] | None:
    """The only moment in the lines above the first row, as written and as a time; else None.

    Of a day that may be a month only the time of day is taken.
    """
    lines = (line for _, line in text.lines(1, first - 1))
    written = {f"{day} {clock}" for line in lines for day, clock in _MOMENT.findall(line)}
    form = _time.form_of_all([*written], 1.0) if len(written) == 1 else None
    if form is None:
        return None
    (one,) = written
    ways = {form, form.replace("%m/%d", "%d/%m")}
    days = {_time.moments(pa.array([one]), way)[0][0].as_py() for way in ways} - {None}
    day = days.pop()
    return one, day.replace(year=NO_YEAR, month=1, day=1) if days else day


def dated(export: Export, text: Text) -> Export:
    """The export with the moment above its rows, if its rows have no time."""
    if export.time.null_count < len(export.time) or not len(export.line):
        return export
    found = above(text, int(export.line.min()))
    if found is None:
        return export
    why = f"the moment above its rows as their time ({found[0]})"
    time = pa.array([found[1]] * len(export.line), export.time.type)
    return replace(export, time=time, settled=(*export.settled, why))


def believed(exports: Mapping[str, Export]) -> dict[str, Export]:
    """The exports, without a time of each file if all together leave none to measure."""
    moments = [one.time.unique() for one in exports.values()]
    if len(exports) < _SEVERAL or any(len(own) != 1 or own.null_count for own in moments):
        return dict(exports)
    ticks = [own[0].value for own in moments]
    if max(ticks) - min(ticks) >= _FASTEST_US * sum(len(one.time) for one in exports.values()):
        return dict(exports)
    return {
        name: replace(one, time=pa.nulls(len(one.time), one.time.type), settled=(_AT_ONCE,))
        for name, one in exports.items()
    }
