"""Tracker exports: every dialect that can be read, chosen by what a file contains."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

from pipeline.base import doors
from pipeline.base.errors import InputError, at, listed
from pipeline.readers import plain
from pipeline.readers._cells import text_of
from pipeline.readers._names import split
from pipeline.readers._opened import opened
from pipeline.readers._reader import TABLE, Export, Faces, Reader, Readings
from pipeline.readers._text import Text, largest, refuse_other_programs, text
from pipeline.readers.said import Columns, Hints

__all__ = [
    "TABLE",
    "Columns",
    "Export",
    "Faces",
    "Hints",
    "Reader",
    "Readings",
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
_HOLDS = "pipeline.intake.table:holds_one"
_NAMED = "pipeline.dialects._named:find"
"""What files of others are, where those that say it are there."""


@functools.cache
def catalogue() -> dict[str, Reader]:
    """Every reader by its key: of our own CSV, of other programs' dialects, of any other table."""
    return {"plain": plain.READER} | (doors.found(_DIALECTS) or {})


def writers() -> dict[str, Reader]:
    """Those in whose dialect `simulate` writes, too."""
    return {key: reader for key, reader in catalogue().items() if reader.write}


def recognise(file: Text) -> Reader:
    """The reader whose dialect a file is written in; a table of no dialect is one of its own.

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
    """The readers that claim a file; one with a mark of its own before those of any table."""
    fitting = [reader for reader in dialects if reader.recognise(sample)]
    return [reader for reader in fitting if not reader.general] or fitting


def read(name: str, data: bytes, hints: Hints | None = None) -> Export:
    """Readings of a tracker export.

    Args:
        name: File name relative to the campaign folder, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.

    Raises:
        InputError: The file cannot be read or trusted as a whole.
    """
    hints = hints or Hints()
    with at(name):
        return split(_read(opened_as_text(name, data, hints), hints), hints.names)


def opened_as_text(name: str, data: bytes, hints: Hints) -> Text:
    """An export as text, of a workbook the sheet that is meant."""
    refuse_other_programs(name, data)
    return opened(name, data, hints.sheet, hints.decimal, "tracker", lambda one: _fits(one, hints))


def _read(file: Text, hints: Hints) -> Export:
    read_by = doors.opened(_MAPPED) if hints.mapping else recognise(file).read
    export: Export = read_by(file, hints)
    return export


def _fits(sheet: Text, hints: Hints) -> int:
    """How well a sheet of a workbook fits.

    3 where it can be read, 2 where titles name coordinates, 1 where points may be in it.
    """
    try:
        return 3 if len(_read(sheet, hints).line) else 0
    except InputError:
        return int(_holds_one(sheet)) and 1 + (doors.opened(_NAMED)(sheet.sample()) is not None)


def _holds_one(file: Text) -> bool:
    """Whether there are rows with three numbers in a file, as far as anybody can say."""
    holds = doors.found(_HOLDS)
    return holds is not None and bool(holds(file))
