"""Tracker exports: every dialect that can be read, chosen by what a file contains."""

from __future__ import annotations

from pipeline.base.errors import InputError, at, listed
from pipeline.readers import emscon, leica_6dof, mapped, plain, spatial_analyzer, tracker_pilot, xyz
from pipeline.readers._cells import text_of
from pipeline.readers._names import split
from pipeline.readers._reader import Columns, Export, Hints, Reader, Readings
from pipeline.readers._text import LARGEST_FILE, Text, refuse_other_programs, text

READERS: dict[str, Reader] = {
    "plain": plain.READER,
    "spatialanalyzer": spatial_analyzer.READER,
    "emscon": emscon.READER,
    "leica_6dof": leica_6dof.READER,
    "tracker_pilot": tracker_pilot.READER,
    "xyz": xyz.READER,
}

WRITERS = {key: reader for key, reader in READERS.items() if reader.write}
"""Those in whose dialect `simulate` writes, too."""

__all__ = [
    "LARGEST_FILE",
    "READERS",
    "WRITERS",
    "Columns",
    "Export",
    "Hints",
    "Reader",
    "Readings",
    "Text",
    "read",
    "recognise",
    "refuse_other_programs",
    "text_of",
]


def recognise(file: Text) -> Reader:
    """The reader whose dialect a file is written in.

    Raises:
        InputError: No dialect fits, or more than one.
    """
    sample = file.sample()
    fitting = [reader for reader in READERS.values() if reader.recognise(sample)]
    fitting = [reader for reader in fitting if not reader.general] or fitting
    if len(fitting) == 1:
        return fitting[0]
    known = listed(reader.name for reader in fitting or READERS.values())
    thing = f"the file may be {known}" if fitting else f"the file is none of {known}"
    raise InputError(
        thing,
        "describe its columns in [tracker.mapping] of campaign.toml, or export it as CSV with the "
        "columns group,target,x_mm,y_mm,z_mm,time",
        line=1,
    )


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
        file = text(name, data)
        read_by = mapped.read if hints.mapping else recognise(file).read
        return split(read_by(file, hints), hints.names)
