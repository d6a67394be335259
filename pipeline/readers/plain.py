"""Our own CSV: `group,target,x_mm,y_mm,z_mm`, and `time` where it is known; m or inches, too.

Every row is a reading and every time is ISO 8601. A file of other titles, or with a row that is no
reading, is for the dialects to read, which say what is wrong with it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pipeline.base import doors
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._reader import (
    Export,
    Meaning,
    Reader,
    Readings,
    export,
    in_a_hall,
    of_targets,
    written,
)
from pipeline.readers._text import Text
from pipeline.readers._units import metres
from pipeline.readers.said import Hints

_TITLES = re.compile(r"group,target,x_(mm|m|in),y_\1,z_\1(,time)?\s*")
_OF_OURS = {"names", "sheet"}
"""What campaign.toml may say of our own CSV that changes nothing in it."""
_TITLED = "pipeline.dialects.titled:read"
"""Any table whose titles are much like ours."""


def recognise(lines: Sequence[str]) -> bool:
    """The first line has our titles and no others."""
    return bool(lines and _TITLES.fullmatch(lines[0]))


def read(text: Text, hints: Hints) -> Export:
    """Readings of a plain CSV.

    Raises:
        UsageError: It has other titles, or campaign.toml describes them, without the dialects.
        InputError: It cannot be trusted as a whole.
    """
    said = [key for key in Hints.model_fields if getattr(hints, key) is not None]
    titles = None if {*said} - _OF_OURS else _TITLES.fullmatch(text.line(1))
    readings = _own(text, *titles.groups()) if titles else None
    if readings is None or (readings.rejected and doors.is_there(_TITLED)):
        found: Export = doors.opened(_TITLED)(text, hints)
        return found
    return readings


def _own(text: Text, unit: str, timed: str | None) -> Export:
    """Readings of a file with our titles."""
    names, axes = ("group", "target"), (f"x_{unit}", f"y_{unit}", f"z_{unit}")
    fields = [*(Field(name, "name") for name in names), *(Field(axis, "number") for axis in axes)]
    time = [Field("time", "time", needed=False)] if timed else []
    found = rows(text, Layout((*fields, *time), ",", 2))
    numbers = [np.asarray(found.columns[axis]) for axis in axes]
    position = np.empty((len(found.line), 3), order="F")  # whole columns are what is wanted later
    for k, column in enumerate(numbers):
        position[:, k] = metres(column, unit)
    return in_a_hall(of_targets(export(text, READER.name, found, Meaning(unit), position), numbers))


def write(readings: Readings, unit: str, digits: int | None) -> bytes:
    """A plain CSV with times to the second."""
    rows = [
        f"{group},{target},{','.join(xyz)},{time:%Y-%m-%dT%H:%M:%S}\n"
        for group, target, xyz, time in written(readings, unit, digits)
    ]
    return "".join([f"group,target,x_{unit},y_{unit},z_{unit},time\n", *rows]).encode()


READER = Reader("plain CSV", recognise, read, write)
