"""Any table of points: read where exactly one reading makes sense, else asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.base.doors import found, opened
from pipeline.readers import mapped
from pipeline.readers._reader import Export, Reader
from pipeline.readers._text import Text
from pipeline.readers.said import Hints

NAME = "table"


def recognise(lines: Sequence[str]) -> bool:
    """Any file may hold one; what it holds is found when it is read."""
    return bool(lines)


_HOLDS, _DESCRIBED = "pipeline.intake.table:holds_one", "pipeline.intake.table:described"
"""What a table of no dialect is, is for the intake to say."""


def holds_one(text: Text) -> bool:
    """Whether there are rows with three numbers in a file."""
    holds = found(_HOLDS)
    return holds is not None and bool(holds(text))


def read(text: Text, hints: Hints, dialect: str = NAME) -> Export:
    """Readings of a table by what its columns seem to be.

    Raises:
        InputError: There is no table, or something has to be answered first.
    """
    mapped_by, untimed = opened(_DESCRIBED)(text, hints)
    return replace(mapped.read(text, mapped_by, dialect), untimed=untimed)


READER = Reader(NAME, recognise, read, says_unit=False, says_names=False, general=True)
