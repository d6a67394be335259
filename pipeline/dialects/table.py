"""Read any table of points if exactly one interpretation makes sense; otherwise ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.base.doors import opened
from pipeline.dialects import mapped
from pipeline.readers._reader import TABLE, Export, Reader
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings

_DESCRIBED = "pipeline.intake.proposal:described"
"""Reference to the intake, which interprets tables in no known dialect."""


def _recognise(lines: Sequence[str]) -> bool:
    """Whether there is any line; whether it holds a table is found when it is read."""
    return bool(lines)


def read(text: Text, hints: ExportSettings, dialect: str = TABLE) -> Export:
    """Read a table by the apparent meaning of its columns.

    Raises:
        InputError: There is no table, or a question must be answered first.
    """
    mapped_by, untimed = opened(_DESCRIBED)(text, hints)
    return replace(mapped.read(text, mapped_by, dialect), untimed=untimed)


READER = Reader(TABLE, _recognise, read, says_unit=False, says_names=False, general=True)
