"""Tracker exports: every dialect that can be read, chosen by what a file contains."""

from __future__ import annotations

from pipeline.errors import InputError, listed
from pipeline.readers import plain, spatial_analyzer
from pipeline.readers._reader import Export, Hints, Reader
from pipeline.readers._text import Text, text

READERS: dict[str, Reader] = {
    reader.name: reader
    for reader in (
        plain.READER,
        spatial_analyzer.READER,
    )
}

SAMPLE_LINES = 60
"""How many lines a reader looks at to recognise its dialect; headers are shorter."""

__all__ = ["READERS", "Export", "Hints", "Reader", "Text", "read", "recognise", "text"]


def recognise(file: Text) -> Reader:
    """The reader whose dialect a file is written in.

    Raises:
        InputError: No dialect fits, or more than one.
    """
    sample = [line for _, line in file.lines(1, SAMPLE_LINES)]
    fitting = [reader for reader in READERS.values() if reader.recognise(sample)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"the file may be {listed(r.name for r in fitting)}",
            "describe its columns in [tracker.mapping] of campaign.toml",
            file=file.name,
        )
    raise InputError(
        f"the file is none of the exports we can read ({listed(READERS)})",
        "export it as one of these, or as CSV with the columns group,target,x_mm,y_mm,z_mm,time",
        file=file.name,
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
    file = text(name, data)
    return recognise(file).read(file, hints or Hints())
