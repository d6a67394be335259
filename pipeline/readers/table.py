"""Any table of points: read where exactly one reading makes sense, else asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.base.errors import InputError
from pipeline.readers import mapped
from pipeline.readers._cells import shown
from pipeline.readers._reader import Export, Hints, Reader
from pipeline.readers._sheet import sheet
from pipeline.readers._text import Text
from pipeline.readers.proposal import propose

NAME = "table"


def recognise(lines: Sequence[str]) -> bool:
    """Any file may hold one; what it holds is found when it is read."""
    return bool(lines)


def holds_one(text: Text) -> bool:
    """Whether there are rows with three numbers in a file."""
    return sheet(text) is not None


def read(text: Text, hints: Hints, dialect: str = NAME) -> Export:
    """Readings of a table by what its columns seem to be.

    Raises:
        InputError: There is no table, or something has to be answered first.
    """
    found = propose(text, hints)
    if found is None:
        raise InputError(
            "there is no table of points in the file: no rows with three numbers",
            "describe its columns in [tracker.mapping] of campaign.toml, or export it as CSV with "
            "the columns group,target,x_mm,y_mm,z_mm,time",
            line=1,
        )
    if found.questions:
        raise found.questions[0].problem()
    doubtful = (one for one in found.columns if one.why == "untimed")
    untimed = next((f'{one.title} ("{shown(one.example)}")' for one in doubtful), None)
    return replace(mapped.read(text, found.hints, dialect), untimed=untimed)


READER = Reader(NAME, recognise, read, says_unit=False, says_names=False, general=True)
