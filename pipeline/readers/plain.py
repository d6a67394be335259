"""Our own CSV: `group,target,x_mm,y_mm,z_mm`, optionally `time`; also in m or inches.

Every row is a reading and every time is ISO 8601. A file with other titles, or with a row that is
not a reading, is passed to the dialects, which say what is wrong with it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pipeline.base import doors
from pipeline.readers._layout import Field, Layout
from pipeline.readers._plain_rows import is_plain, plain_rows
from pipeline.readers._reader import (
    Export,
    Meaning,
    OutgoingReadings,
    Reader,
    export,
    in_a_hall,
    of_targets,
    written,
)
from pipeline.readers._text import Text
from pipeline.readers._units import metres
from pipeline.readers.export_settings import ExportSettings

_TITLES = re.compile(r"group,target,x_(mm|m|in),y_\1,z_\1(,time)?\s*")
_OF_OURS = {"names", "sheet"}
"""Keys of campaign.toml that have no effect on our own CSV."""
_TITLED = "pipeline.dialects.titled:read"
"""Reference to the reader of tables whose titles are similar to ours."""


def recognise(lines: Sequence[str]) -> bool:
    """Whether the first line has our titles and no others."""
    return bool(lines and _TITLES.fullmatch(lines[0]))


def read(text: Text, hints: ExportSettings) -> Export:
    """Readings of a plain CSV.

    Raises:
        UsageError: It has other titles, or campaign.toml describes them, and the dialects are not
            installed.
        InputError: It cannot be trusted as a whole.
    """
    selected = [key for key in ExportSettings.model_fields if getattr(hints, key) is not None]
    titles = None if {*selected} - _OF_OURS else _TITLES.fullmatch(text.line(1))
    readings = _own(text, *titles.groups()) if titles else None
    if readings is None or (readings.rejected and doors.is_there(_TITLED)):
        found: Export = doors.opened(_TITLED)(text, hints)
        return found
    return readings


def _own(text: Text, unit: str, timed: str | None) -> Export | None:
    """Readings of a file with our titles; None if a row is none."""
    names, axes = ("group", "target"), (f"x_{unit}", f"y_{unit}", f"z_{unit}")
    fields = [*(Field(name, "name") for name in names), *(Field(axis, "number") for axis in axes)]
    time = [Field("time", "time", needed=False)] if timed else []
    found = plain_rows(text, Layout((*fields, *time), ",", 2)) if is_plain(text) else None
    if found is None:
        return None
    numbers = [np.asarray(found.columns[axis]) for axis in axes]
    position = np.empty((len(found.line), 3), order="F")  # later used column by column
    for k, column in enumerate(numbers):
        position[:, k] = metres(column, unit)
    return in_a_hall(of_targets(export(text, READER.name, found, Meaning(unit), position), numbers))


def write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write a plain CSV with times to the second."""
    rows = [
        f"{group},{target},{','.join(xyz)},{time:%Y-%m-%dT%H:%M:%S}\n"
        for group, target, xyz, time in written(readings, unit, digits)
    ]
    return "".join([f"group,target,x_{unit},y_{unit},z_{unit},time\n", *rows]).encode()


READER = Reader("plain CSV", recognise, read, write)
