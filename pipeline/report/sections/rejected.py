"""Section on the rows that were left out, with reasons."""

from __future__ import annotations

from pipeline.answer.contract import Answer, Rejected
from pipeline.report.columns import Cells, table_of, word_column
from pipeline.report.record import Column, Paragraph, Section, TableEntry, entry, section_of

_MOST_ROWS = 400
"""Maximum number of rejected rows shown; further ones are counted here and listed in
result.json."""


def rejected(answer: Answer) -> Section | None:
    """Rows that were left out, with reasons; at most `_MOST_ROWS` of them."""
    given = answer.rejected
    columns: list[Cells[Rejected]] = [
        word_column("File", lambda row: row.file, code=True),
        (Column("Line", numeric=True), _line),
        word_column("Reason", lambda row: row.reason),
    ]
    more = len(given) - _MOST_ROWS
    note = f"{more} more are in result.json." if more > 0 else ""
    table = table_of("rejected", "Left out and why", columns, given[:_MOST_ROWS], note)
    return section_of("rejected", "Rejected rows", [Paragraph(_left_out(len(given))), table])


def _left_out(count: int) -> str:
    if not count:
        return "No row of the raw files was unreadable or incomplete."
    rows = "1 row was" if count == 1 else f"{count} rows were"
    return f"{rows} left out of the estimate; nothing was corrected silently."


def _line(row: Rejected) -> TableEntry:
    return TableEntry("whole file", 0) if row.line is None else entry(str(row.line), row.line)
