"""Whether more poses would pay, and which estimates they would have to part."""

from __future__ import annotations

from pipeline.answer.contract import Answer
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Section, section_of
from pipeline.report.summaries import Tables


def enough(answer: Answer, tables: Tables) -> Section | None:
    """Uncertainty over the number of poses, and correlation."""
    names = ("enough", "correlation")
    return section_of("enough", "Are the poses enough?", figures(names, answer, tables))
