"""Leica Tracker Pilot CSV: a header with units in brackets, one reading per row.

Columns are found by their titles, in any order; lines above the header are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from pipeline.dialects import _named, table, titled
from pipeline.dialects._named import Header
from pipeline.readers._reader import Export, OutgoingReadings, Reader, written
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings

_TURNED = {"rx", "ry", "rz", "q0", "q1", "q2", "q3", "qw", "qx", "qy", "qz", "roll", "pitch", "yaw"}


def expanded(header: Header) -> bool:
    """Whether there are expanded uncertainties, U(95), as Leica states them for a T-Mac."""
    return any(re.search(r"\bu[xyz]?\s*\(?95", c.title.lower()) for c in header.columns)


def _turned(header: Header) -> bool:
    """Whether there are orientations, so that a row is a 6D pose rather than a point."""
    return bool({c.title.lower().split(" ")[0].split("[")[0] for c in header.columns} & _TURNED)


def _recognise(lines: Sequence[str]) -> bool:
    """Whether a header names a point and X, Y, Z, but no columns of a 6D target."""
    header = _named.find(lines)
    if header is None or titled.recognise(lines):
        return False
    return header.has("target") and not expanded(header) and not _turned(header)


def _read(text: Text, hints: ExportSettings) -> Export:
    """Read a Tracker Pilot export."""
    return table.read(text, hints, READER.name)


def _write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write a Tracker Pilot export with group and point names, times to the second."""
    lines = [f"Point Group;Point Name;X [{unit}];Y [{unit}];Z [{unit}];Timestamp"]
    lines += [
        f"{group};{target};{';'.join(xyz)};{time:%d.%m.%Y %H:%M:%S}"
        for group, target, xyz, time in written(readings, unit, digits)
    ]
    return "\r\n".join([*lines, ""]).encode("cp1252")


READER = Reader("Leica Tracker Pilot CSV", _recognise, _read, _write, general=True)
