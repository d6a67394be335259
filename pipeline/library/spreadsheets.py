"""Tables for a spreadsheet: no text is taken for a formula."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv


def as_csv(table: pa.Table) -> bytes:
    """Table as CSV for a spreadsheet, with no text cell that it would take for a formula.

    Names come from files, and a spreadsheet evaluates a cell that starts with one of = + - @, also
    of full width: such cells get a leading apostrophe.
    """
    words = pa.types.is_dictionary
    texts = [one.cast(pa.string()) if words(one.type) else one for one in table.columns]
    columns = [harmless(column) if column.type == pa.string() else column for column in texts]
    sink = pa.BufferOutputStream()
    csv.write_csv(pa.table(columns, table.column_names), sink)
    return bytes(sink.getvalue())


def harmless(words: pa.ChunkedArray) -> pa.ChunkedArray:
    """Text with a leading apostrophe where a spreadsheet would evaluate it."""
    formula = pc.match_substring_regex(words, r"^[\s\pZ]*[=+\-@\t\r＝＋－＠]")
    return pc.if_else(formula, pc.binary_join_element_wise("'", words, ""), words)
