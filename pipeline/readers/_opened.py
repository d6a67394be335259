"""A file as text, whether it is text or a workbook."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.base.doors import opened as behind
from pipeline.readers._text import Text, is_workbook, text


def opened(
    name: str,
    data: bytes,
    sheet: str | None,
    mark: str | None,
    table: str | None,
    fits: Callable[[Text], int],
) -> Text:
    """A file as text; a workbook is for the dialects to open.

    Args:
        name: Its name, for messages.
        data: Its content.
        sheet: Which sheet is meant, None where nobody says.
        mark: The decimal mark that is expected, None for any.
        table: Table of campaign.toml that may say both; None where none may.
        fits: How well a sheet fits, 0 for not at all, where there are several and none is named.

    Raises:
        InputError: No text and no workbook, too large, or not one sheet fits.
    """
    if not is_workbook(data):
        return text(name, data)
    found: Text = behind("pipeline.dialects.workbook:opened")(name, data, sheet, mark, table, fits)
    return found
