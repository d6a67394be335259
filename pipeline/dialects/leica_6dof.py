"""Leica 6-DoF (T-Mac) CSV: position, orientation and U(95) per axis of each reading.

The encoding is cp1252; times begin with an apostrophe, the last column is empty, and one column
marks readings as deleted. U(95) is an expanded uncertainty, k = 2. Orientations are not used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.dialects import _named, _tables, titled
from pipeline.dialects._coordinates import raw
from pipeline.dialects._export import EXPANDED, USUAL_FACTORS
from pipeline.dialects.tracker_pilot import expanded
from pipeline.readers._reader import Export, Meaning, OutgoingReadings, Reader, text_of, written
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings


def _recognise(lines: Sequence[str]) -> bool:
    """Whether a header names X, Y, Z and U(95)."""
    header = _named.find(lines)
    return header is not None and expanded(header) and not titled.recognise(lines)


def _read(text: Text, hints: ExportSettings) -> Export:
    """Read a T-Mac export; readings marked as deleted are rejected."""
    return _tables.below_header(text, hints, READER.name)


def _write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write a T-Mac export; orientations are zero, U(95) is twice the standard uncertainty."""
    six = np.zeros((len(readings.group), 6)) if readings.covariance is None else readings.covariance
    U95 = text_of(raw(USUAL_FACTORS[EXPANDED] * np.sqrt(six[:, [0, 3, 5]]), Meaning(unit)), None)
    axes = [f"{axis} [{unit}]" for axis in "XYZ"]
    titles = ["Point Group", "Point Name", "Time", *axes, "Rx [deg]", "Ry [deg]", "Rz [deg]"]
    lines = [";".join([*titles, *(f"U(95) {axis}" for axis in axes), "Delete", ""])]
    lines += [
        f"{group};{target};'{time:%d.%m.%Y %H:%M:%S};{';'.join(xyz)};0;0;0;{';'.join(u)};0;"
        for (group, target, xyz, time), u in zip(written(readings, unit, digits), U95, strict=True)
    ]
    return "\r\n".join([*lines, ""]).encode("cp1252")


READER = Reader("Leica 6DoF CSV", _recognise, _read, _write, general=True)
