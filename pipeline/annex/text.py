"""A report as plain text, for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from pipeline.base.shown import quoted
from pipeline.report.record import Figure, Paragraph, Report, ReportTable

_WIDTH = 96
"""Maximum length of a line [characters]."""


def as_text(report: Report) -> str:
    """The texts and tables of a report, with the alternative texts of its figures."""
    return quoted("\n".join(_lines(report)) + "\n")


def _lines(report: Report) -> Iterator[str]:
    yield from (report.title, "=" * len(report.title), "")
    if report.judged is not None:
        yield report.judged.word
    yield report.verdict
    for one in report.first:
        yield from textwrap.wrap(f"{one.label}: {one.text}" if one.label else one.text, _WIDTH)
    for section in report.sections:
        yield from ("", section.title, "-" * len(section.title))
        for block in section.blocks:
            yield ""
            if isinstance(block, ReportTable):
                yield from _table(block)
            elif isinstance(block, Paragraph):
                mark = "! " if block.tone == "finding" else ""
                yield from textwrap.wrap(mark + block.text, _WIDTH)
            elif isinstance(block, Figure):
                yield from textwrap.wrap(f"[{block.name}.svg] {block.alt}", _WIDTH)


def _table(table: ReportTable) -> Iterator[str]:
    yield table.title
    head = [column.title for column in table.columns]
    rows = [head, *([entry.text for entry in row] for row in table.rows)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    for row in rows:
        cells = (
            text.rjust(width) if column.numeric else text.ljust(width)
            for text, width, column in zip(row, widths, table.columns, strict=True)
        )
        yield f"  {'   '.join(cells)}".rstrip()
    if table.note:
        yield from textwrap.wrap(table.note, _WIDTH)
