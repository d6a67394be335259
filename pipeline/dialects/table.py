"""Any table of points: read where exactly one reading makes sense, else asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.base.doors import opened
from pipeline.dialects import mapped
from pipeline.readers._reader import TABLE, Export, Reader
from pipeline.readers._text import Text
from pipeline.readers.said import Hints

_DESCRIBED = "pipeline.intake.table:described"
"""What a table of no dialect is, is for the intake to say."""


def _recognise(lines: Sequence[str]) -> bool:
    """Any file may hold one; what it holds is found when it is read."""
    return bool(lines)


def read(text: Text, hints: Hints, dialect: str = TABLE) -> Export:
    """Readings of a table by what its columns seem to be.

    Raises:
        InputError: There is no table, or something has to be answered first.
    """
    mapped_by, untimed = opened(_DESCRIBED)(text, hints)
    return replace(mapped.read(text, mapped_by, dialect), untimed=untimed)


READER = Reader(TABLE, _recognise, read, says_unit=False, says_names=False, general=True)
