"""Sections of a report after its first page, each made from an answer and its tables."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from pipeline.annex.sections import filed
from pipeline.annex.sections.cell import cell
from pipeline.annex.sections.diagnosis import diagnosis
from pipeline.annex.sections.geometry import dh_table, geometry, laws
from pipeline.annex.sections.method import method
from pipeline.annex.sections.prediction import test_pose, validation
from pipeline.annex.sections.readings import budget, enough, registration, reliability, residuals
from pipeline.annex.sections.stiffness import stiffness
from pipeline.answer.contract import Answer
from pipeline.report.record import Section, present
from pipeline.report.summaries import Tables

_Sections = Sequence[Section | None]


def sections(
    answer: Answer,
    tables: Tables,
    previous: Answer | None,
    beside: Collection[str],
    wear: str | None,
) -> tuple[Section, ...]:
    """All sections for which the answer has data, in their order; arguments as for `compose`."""
    if answer.of_positions:
        those = _of_positions(answer, tables)
    else:
        those = _of_pulls(answer, tables, stiffness(answer, previous, wear))
    last = (filed.files(beside, previous), filed.identity(answer), method(answer, tables))
    return present([*those, *last])


def _of_pulls(answer: Answer, tables: Tables, springs: Section | None) -> _Sections:
    """Sections of a campaign of pulls."""
    of_both = (geometry(answer, tables), laws(answer, tables)) if answer.position_steps else ()
    return [
        validation(answer, tables),
        diagnosis(answer, tables),
        test_pose(answer, tables),
        springs,
        cell(answer, tables),
        residuals(answer, tables),
        budget(answer, tables),
        enough(answer, tables),
        registration(answer, tables),
        reliability(answer, tables),
        *of_both,
        dh_table(answer, tables),
        filed.rejected(answer),
    ]


def _of_positions(answer: Answer, tables: Tables) -> _Sections:
    """Sections of a campaign of absolute positions, which are not compared with another one."""
    return [
        geometry(answer, tables),
        laws(answer, tables),
        cell(answer, tables),
        stiffness(answer, None),
        dh_table(answer, tables),
        filed.rejected(answer),
    ]
