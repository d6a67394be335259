"""Sections on campaigns of positions: steps of the model, laws of the joints, DH parameters."""

from __future__ import annotations

from pipeline.answer.contract import Answer, Cause, PositionStep, TableCombination, TableLetter
from pipeline.answer.words import LETTERS
from pipeline.base.quantities import MISSING, mix, p_value, percent
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Cells,
    Paragraph,
    ReportTable,
    Section,
    measured_column,
    number_column,
    roughly,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables


def geometry(answer: Answer, tables: Tables) -> Section | None:
    """Accuracy at held-out poses with each further part of the model."""
    blocks = [
        _steps(answer),
        *figures(("position_steps",), answer, tables),
        Paragraph(_LEFT_OUT),
    ]
    return section_of("positions", "How well poses are predicted", blocks)


_LEFT_OUT = (
    "Poses between measured ones are predicted as the first column says; joint angles in a tenth "
    "of joint space that was not measured as the second; another day or workspace, with the "
    "instrument set up anew, as the third."
)


def laws(answer: Answer, tables: Tables) -> Section | None:
    """Laws of the joints that are outside the catalogue."""
    return section_of(
        "laws",
        "Laws of the joints",
        [_laws(answer), *figures(("curves", "laws"), answer, tables)],
    )


def dh_table(answer: Answer, tables: Tables) -> Section | None:
    """The DH parameters, nominal and identified."""
    return section_of(
        "table", "Geometric parameters of the robot", [_letters(answer), _together(answer)]
    )


def _steps(answer: Answer) -> ReportTable | None:
    columns: list[Cells[PositionStep]] = [
        word_column("The model includes", lambda one: one.model),
        number_column("Every tenth pose held out [mm]", lambda one: one.between_mm, roughly),
        number_column("A tenth of joint space held out [mm]", lambda one: one.space_mm, roughly),
        number_column("One series held out [mm]", lambda one: one.series_mm, roughly),
    ]
    return table_of(
        "position_steps",
        "Mean distance of held-out targets from their prediction",
        columns,
        answer.position_steps,
        "Each model includes the parts in the rows above it.",
    )


def _laws(answer: Answer) -> ReportTable | None:
    columns: list[Cells[Cause]] = [
        word_column("Law", lambda one: one.law.text.capitalize() if one.law else one.name),
        measured_column("Amplitude [mrad or mm]", _amplitude),
        word_column("p", lambda one: p_value(one.p_value)),
        word_column("Reduces the cross-validation error by", lambda one: _gain(one)),
    ]
    found = [one for one in answer.diagnosis.causes if one.law is not None]
    return table_of("laws", "Laws outside the catalogue", columns, found)


def _amplitude(one: Cause) -> tuple[float | None, float | None]:
    first = one.parameters[0]
    value, std = first.value, first.std
    return (None if value is None else 1e3 * value), (None if std is None else 1e3 * std)


def _gain(one: Cause) -> str:
    if one.gain is None or one.gain.reduction is None or one.gain.ci95 is None:
        return ""
    low, high = one.gain.ci95
    if low is None or high is None:
        return percent(one.gain.reduction)
    return f"{percent(one.gain.reduction)} ({percent(low)} to {percent(high)})"


def _letters(answer: Answer) -> ReportTable | None:
    columns: list[Cells[TableLetter]] = [
        word_column("Joint", lambda one: one.where),
        word_column("Parameter", lambda one: LETTERS.get(one.name, one.name)),
        number_column("Nominal [mm or deg]", lambda one: _scaled(one, one.nominal), _as_stated),
        measured_column(
            "Identified minus nominal [mm or mrad]",
            lambda one: (1e3 * (one.value - one.nominal), 1e3 * one.std),
        ),
        word_column("Determined", lambda one: "yes" if one.identifiable else "no"),
    ]
    return table_of(
        "letters",
        "Geometric parameters, nominal and identified",
        columns,
        answer.geometry,
        "A parameter that is not determined moves the targets as others do, or hardly at all; it "
        "keeps the prior uncertainty of the nominal DH parameters.",
    )


def _as_stated(value: float | None) -> str:
    """A nominal length or angle with all digits of the robot file, to a nanometre."""
    return MISSING if value is None else f"{round(value, 6):.10g}"


def _together(answer: Answer) -> ReportTable | None:
    columns: list[Cells[TableCombination]] = [
        word_column("Combination", _sum),
        measured_column(
            "Identified minus nominal [mm or mrad]",
            lambda one: (1e3 * one.value, 1e3 * one.std),
        ),
    ]
    return table_of(
        "letter_combinations",
        "Parameters that are determined only in combination",
        columns,
        answer.geometry_combinations,
        "These move the targets as one, as offsets along parallel axes do. Enter what is found in "
        "any one of them.",
    )


def _sum(one: TableCombination) -> str:
    names = [f"{LETTERS.get(entry.name, entry.name)} {entry.where}" for entry in one.of]
    return mix([entry.weight for entry in one.of], names)


def _scaled(one: TableLetter, value: float) -> float:
    return 1e3 * value if one.unit == "m" else value * 57.29577951308232
