"""Leica Tracker Pilot CSV: a header with units in brackets, one reading per row.

Columns are found by their titles, wherever they stand; lines above the header are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.readers import _named, _tables, plain
from pipeline.readers._named import Header
from pipeline.readers._reader import Export, Hints, Reader, Readings, written
from pipeline.readers._text import Text

_TURNED = {"rx", "ry", "rz", "q0", "q1", "q2", "q3", "qw", "qx", "qy", "qz", "roll", "pitch", "yaw"}


def six_dof(header: Header) -> bool:
    """Whether there are orientations or expanded uncertainties, as a T-Mac gives them."""
    turned = {
        column.title.lower().split(" ")[0].split("[")[0] for column in header.columns
    } & _TURNED
    return bool(turned) or any(column.role.startswith("u95") for column in header.columns)


def recognise(lines: Sequence[str]) -> bool:
    """A header names a point and X, Y, Z, and nothing of a six-degrees-of-freedom target."""
    header = _named.find(lines)
    if header is None or plain.recognise(lines):
        return False
    return header.has("target") and not six_dof(header)


def read(text: Text, hints: Hints) -> Export:
    """Readings of a Tracker Pilot export."""
    return _tables.below_header(text, hints, READER.name)


def write(readings: Readings, unit: str, digits: int | None) -> bytes:
    """A Tracker Pilot export with group and point names, times to the second."""
    lines = [f"Point Group;Point Name;X [{unit}];Y [{unit}];Z [{unit}];Timestamp"]
    lines += [
        f"{group};{target};{';'.join(xyz)};{time:%d.%m.%Y %H:%M:%S}"
        for group, target, xyz, time in written(readings, unit, digits)
    ]
    return "\r\n".join([*lines, ""]).encode("cp1252")


READER = Reader("Leica Tracker Pilot CSV", recognise, read, write, general=True)
