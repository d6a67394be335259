"""Open a file as text, whether it is text or a workbook."""

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
    """Open a file as text; workbooks are opened by the dialects.

    Args:
        name: File name, for messages.
        data: Its content.
        sheet: Name of the sheet to read, None if not stated.
        mark: Expected decimal mark, None for any.
        table: Table of campaign.toml that may state both; None if none may.
        fits: How well a sheet fits, 0 for not at all; used if there are several and none is named.

    Raises:
        InputError: The file is neither text nor a workbook, is too large, or not exactly one sheet
            fits.
    """
    if not is_workbook(data):
        return text(name, data)
    found: Text = behind("pipeline.dialects.workbook:opened")(name, data, sheet, mark, table, fits)
    return found
