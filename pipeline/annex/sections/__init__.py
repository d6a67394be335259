"""Parts of a report behind its first page, each from an answer and its tables."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.annex.sections.cell import cell
from pipeline.annex.sections.geometry import geometry, laws, letters
from pipeline.annex.sections.method import method
from pipeline.annex.sections.readings import budget, enough, registration, reliability, residuals
from pipeline.answer.contract import Answer
from pipeline.report.record import Section
from pipeline.report.summaries import Tables

SECTIONS: dict[str, Callable[[Answer, Tables], Section | None]] = {
    "cell": cell,
    "residuals": residuals,
    "budget": budget,
    "enough": enough,
    "registration": registration,
    "reliability": reliability,
    "geometry": geometry,
    "laws": laws,
    "letters": letters,
    "method": method,
}
"""By the names under which the report asks for them."""
