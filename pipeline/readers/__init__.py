"""Read tracker exports in any known dialect, recognised by the content of the file."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

from pipeline.base import doors
from pipeline.base.errors import InputError, at, listed
from pipeline.readers import plain
from pipeline.readers._reader import (
    TABLE,
    Export,
    Faces,
    OutgoingReadings,
    Reader,
    named_by_file,
    split,
    text_of,
)
from pipeline.readers._text import Text, largest, opened, refuse_other_programs, text
from pipeline.readers.export_settings import Columns, ExportSettings

__all__ = [
    "TABLE",
    "Columns",
    "Export",
    "ExportSettings",
    "Faces",
    "OutgoingReadings",
    "Reader",
    "Text",
    "catalogue",
    "largest",
    "opened_as_text",
    "read",
    "recognise",
    "refuse_other_programs",
    "sheet",
    "text",
    "text_of",
    "writers",
]


_DIALECTS, _MAPPED = "pipeline.dialects:DIALECTS", "pipeline.dialects.mapped:read"
_HOLDS = "pipeline.intake.proposal:holds_one"
_NAMED = "pipeline.dialects._named:find"
"""References to the code for files of other programs, which may not be installed."""


@functools.cache
def catalogue() -> dict[str, Reader]:
    """All readers by key: our own CSV, dialects of other programs, any other table.

    Where the dialects are installed, their `plain` replaces our own: it knows similar titles, too.
    """
    return {"plain": plain.READER} | (doors.found(_DIALECTS) or {})


def writers() -> dict[str, Reader]:
    """The readers in whose dialect `simulate` can also write."""
    return {key: reader for key, reader in catalogue().items() if reader.write}


def recognise(file: Text) -> Reader:
    """Recognise the dialect of a file; a table in no known dialect counts as one of its own.

    Raises:
        InputError: More than one dialect fits, or there is no table of points.
    """
    dialects = [reader for key, reader in catalogue().items() if key != TABLE]
    fitting = _fitting(dialects, file.sample())
    if not fitting and TABLE in catalogue() and _holds_one(file):
        return catalogue()[TABLE]
    if len(fitting) == 1:
        return fitting[0]
    known = listed(reader.name for reader in fitting or dialects)
    none = f"the file is none of {known}, and there are no rows with three numbers in it"
    raise InputError(
        f"the file may be {known}" if fitting else none,
        "describe its columns in [tracker.mapping] of campaign.toml, or export it as CSV with the "
        "columns group,target,x_mm,y_mm,z_mm,time",
        line=1,
    )


def _fitting(dialects: Iterable[Reader], sample: Sequence[str]) -> list[Reader]:
    """The readers that recognise a file; those of a distinctive dialect before general ones."""
    fitting = [reader for reader in dialects if reader.recognise(sample)]
    return [reader for reader in fitting if not reader.general] or fitting


def read(name: str, data: bytes, hints: ExportSettings | None = None) -> Export:
    """Readings of a tracker export.

    Args:
        name: File name relative to the campaign folder, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.

    Raises:
        InputError: The file cannot be read or trusted as a whole.
    """
    hints = hints or ExportSettings()
    with at(name):
        found = split(_read(opened_as_text(name, data, hints), hints), hints.names)
        return named_by_file(found, hints.groups) if hints.groups else found


def opened_as_text(name: str, data: bytes, hints: ExportSettings) -> Text:
    """Open an export as text; of a workbook, the sheet that holds the readings."""
    refuse_other_programs(name, data)
    return opened(name, data, hints.sheet, hints.decimal, "tracker", lambda one: _fits(one, hints))


def _read(file: Text, hints: ExportSettings) -> Export:
    read_by = doors.opened(_MAPPED) if hints.mapping else recognise(file).read
    export: Export = read_by(file, hints)
    return export


def _fits(sheet: Text, hints: ExportSettings) -> int:
    """Rate how well a sheet of a workbook fits.

    Returns:
        3 if readings can be read from it, 2 if titles name coordinates, 1 if it may contain points,
        0 otherwise.
    """
    try:
        return 3 if len(_read(sheet, hints).line) else 0
    except InputError:
        return int(_holds_one(sheet)) and 1 + (doors.opened(_NAMED)(sheet.sample()) is not None)


def _holds_one(file: Text) -> bool:
    """Whether a file has rows with three numbers; False if the intake is not installed."""
    holds = doors.found(_HOLDS)
    return holds is not None and bool(holds(file))
