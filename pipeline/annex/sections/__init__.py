"""Sections of a report after its first page, each made from an answer and its tables."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.annex.sections.cell import cell
from pipeline.annex.sections.geometry import dh_table, geometry, laws
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
    "letters": dh_table,
    "method": method,
}
"""Sections by the names under which the report requests them."""
