"""A table of no dialect: its entries of [tracker], or the question to be answered first."""

from __future__ import annotations

from pipeline.base.errors import InputError
from pipeline.intake._sheet import sheet
from pipeline.intake.proposal import propose
from pipeline.readers._cells import shortened
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings


def holds_one(text: Text) -> bool:
    """Whether a file has rows with three numbers."""
    return sheet(text) is not None


def described(text: Text, hints: ExportSettings) -> tuple[ExportSettings, str | None]:
    """All entries of [tracker] that it needs, and a column that should contain times and does not.

    Raises:
        InputError: There is no table, or a question must be answered first.
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
    untimed = next((f'{one.title} ("{shortened(one.example)}")' for one in doubtful), None)
    return found.hints, untimed
