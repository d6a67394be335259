"""Printed part of a report: what decisions need; the page has everything."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pipeline.answer.words import listed
from pipeline.report.record import Block, Paragraph, Report, ReportTable, Section

_ON_THE_PAGE = frozenset(
    {
        "alone",
        "arrows",
        "blind-spots",
        "blind-spots-never",
        "budget",
        "compliance",
        "correlation",
        "deflection-joint-springs",
        "enough",
        "evidence",
        "files",
        "hypotheses",
        "identity",
        "letters",
        "letter_combinations",
        "measured",
        "models",
        "next-joints",
        "noise",
        "pose-rms",
        "poses",
        "prediction",
        "prediction-error",
        "registration",
        "reliability",
        "residual-course",
        "residual-force",
        "separability",
        "whitened",
        "workspace-joint-springs",
    }
)
"""Tables and figures that only a statistician needs; they are on the page only."""

_MOST_ROWS = 30
"""Maximum number of rows of a table that are printed."""


def printed(report: Report) -> Report:
    """The printed version of a campaign's report; other reports are printed as they are."""
    if report.certificate is None:
        return report
    kept = tuple(filter(None, map(_section, report.sections)))
    left = listed([f"{one[0].lower()}{one[1:]}" for one in _left_out(report)] or ["nothing"])
    more = Section(
        "elsewhere",
        "Only on the page",
        (Paragraph(f"index.html and results.xlsx also have: {left}."),),
    )
    return replace(report, sections=(*kept, more))


def _section(one: Section) -> Section | None:
    """A section without blocks for the page only; None if only paragraphs would remain."""
    kept = [block for block in one.blocks if not _stays(block)]
    if len(kept) < len(one.blocks) and all(isinstance(block, Paragraph) for block in kept):
        return None
    return replace(one, blocks=tuple(map(_shortened, kept)))


def _stays(block: Block) -> bool:
    return not isinstance(block, Paragraph) and block.name in _ON_THE_PAGE


def _shortened(block: Block) -> Block:
    """Cut a long table to its first `_MOST_ROWS` rows."""
    if not isinstance(block, ReportTable) or len(block.rows) <= _MOST_ROWS:
        return block
    more = f"{len(block.rows) - _MOST_ROWS} more rows are in index.html."
    return replace(block, rows=block.rows[:_MOST_ROWS], note=f"{more} {block.note}".strip())


def _left_out(report: Report) -> Iterator[str]:
    """Titles of the blocks that are on the page only."""
    for section in report.sections:
        for block in section.blocks:
            if not isinstance(block, Paragraph) and _stays(block):
                yield block.title
