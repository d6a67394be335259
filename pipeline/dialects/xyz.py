"""Semicolon-separated .xyz: rows without a header, with up to two names and three numbers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.dialects import _named, table
from pipeline.dialects._cells import cells_or_none, is_number
from pipeline.readers._layout import JOINT
from pipeline.readers._reader import Export, OutgoingReadings, Reader, written
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings

_WIDTHS = (3, 4, 5)
"""Possible numbers of cells in a row [1]: three numbers after up to two names."""


def _recognise(lines: Sequence[str]) -> bool:
    """Whether most rows have up to two names and three numbers, separated by semicolons."""
    rows = [_cells(line) for line in lines if line.strip()]
    fitting = [len(row) in _WIDTHS and all(map(is_number, row[-3:])) for row in rows]
    most = 2 * sum(fitting) > len(rows) and len(rows[0]) in _WIDTHS
    return most and not any(map(_elsewhere, lines)) and not _named.find(lines)


def _elsewhere(line: str) -> bool:
    """Whether a line can only come from SpatialAnalyzer."""
    return JOINT in line or line.lstrip().startswith("//")


def _cells(line: str) -> list[str]:
    cells = cells_or_none(line, ";") or []
    return cells[:-1] if cells and not cells[-1] else cells


def _read(text: Text, hints: ExportSettings) -> Export:
    """Read an .xyz file.

    Raises:
        InputError: The unit is not stated in campaign.toml, or the numbers may be angles.
    """
    return table.read(text, hints, READER.name)


def _write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write rows of group, target and coordinates; times are lost."""
    rows = written(readings, unit, digits)
    lines = [";".join([group, target, *xyz]) for group, target, xyz, _ in rows]
    return "\r\n".join([*lines, ""]).encode()


READER = Reader("semicolon xyz", _recognise, _read, _write, suffix=".xyz", says_unit=False)
