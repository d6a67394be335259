"""results.xlsx and csv/: the answer as tables for a spreadsheet, derived once from the records.

Units are stated in the headings, or in a column of their own if they differ by row. Numbers are not
rounded except to the sixteen digits of a workbook; unknown values are empty cells.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.answer.contract import Answer, Cause, TargetDeflection
from pipeline.answer.words import ABOUT
from pipeline.base import doors
from pipeline.base.shown import printable
from pipeline.report import words
from pipeline.tables import F64, STR


@dataclass(frozen=True)
class _SheetColumn:
    """One column of a sheet.

    Attributes:
        title: The heading, with its unit.
        of: Function from the object of a row to its cell; None for an empty cell.
        kind: Text or number.
    """

    title: str
    of: Callable[[Any], object]
    kind: pa.DataType = STR


def _number(title: str, of: Callable[[Any], float | None]) -> _SheetColumn:
    return _SheetColumn(title, of, F64)


def files(answer: Answer, tables: Mapping[str, pd.DataFrame]) -> dict[str, bytes]:
    """results.xlsx, and each of its sheets as CSV; without the library the workbook alone.

    Args:
        answer: The answer to the campaign.
        tables: The tables `residuals` and `reliability`, in SI; a missing one gives an empty sheet.
    """
    found = _sheets(answer, tables)
    as_csv = doors.found("pipeline.library.spreadsheets:as_csv")
    each = {f"csv/{name}.csv": as_csv(table) for name, table in found.items() if as_csv}
    return {"results.xlsx": _workbook(found), **each}


def _sheets(answer: Answer, tables: Mapping[str, pd.DataFrame]) -> dict[str, pa.Table]:
    """The sheets by name, in the order of the report."""
    return {
        "summary": _sheet(_SUMMARY, _summary(answer)),
        "stiffness": _sheet(_STIFFNESS, _beside_springs(answer)),
        "combinations": _sheet(_COMBINATIONS, answer.combinations),
        "causes": _sheet(_CAUSES, _parameters(answer.diagnosis.causes)),
        "predictions": _sheet(_PREDICTIONS, answer.test_pose_deflection),
        "validation": _sheet(_VALIDATION, _targets(answer)),
        "residuals": _of_table(_RESIDUALS, tables.get("residuals")),
        "reliability": _of_table(_RELIABILITY, tables.get("reliability")),
        "rejected": _sheet(_REJECTED, answer.rejected),
    }


def _sheet(columns: Iterable[_SheetColumn], things: Iterable[object]) -> pa.Table:
    rows = list(things)
    cells = {c.title: pa.array([_cell(c, one) for one in rows], c.kind) for c in columns}
    return pa.table(cells)


def _cell(column: _SheetColumn, one: object) -> object:
    value = column.of(one)
    return printable(str(value)) if column.kind == STR and value is not None else value


@dataclass(frozen=True)
class _SummaryLine:
    """A line of the summary: text, or a number with its unit."""

    what: str
    said: object = None
    value: float | None = None
    unit: str = ""


_SUMMARY = (
    _SheetColumn("what", lambda fact: fact.what),
    _SheetColumn("said", lambda fact: fact.said),
    _number("value", lambda fact: fact.value),
    _SheetColumn("unit", lambda fact: fact.unit or None),
)


def _summary(answer: Answer) -> Iterator[_SummaryLine]:
    """The most important results."""
    fit, verdict = answer.fit, answer.diagnosis.verdict
    yield _SummaryLine("campaign", answer.campaign)
    yield _SummaryLine("robot", answer.machine)
    yield _SummaryLine("measured", answer.measured)
    yield _SummaryLine("verdict", words.VERDICTS[verdict][0])
    yield from (_SummaryLine(ABOUT[one.about].lower(), one.text) for one in answer.first_screen)
    yield from _asked(answer)
    yield _SummaryLine("values of", words.values_of(answer))
    yield _SummaryLine("because", answer.recommended.why)
    yield _SummaryLine("residuals, root mean square", None, fit.rms_mm, "mm")
    yield _SummaryLine("chi square", None, fit.chi2, "1")
    yield _SummaryLine("degrees of freedom", None, fit.dof, "1")
    yield _SummaryLine("probability of a fit no better", None, fit.p_value, "1")
    yield _SummaryLine("noise known from", fit.noise_from)
    if answer.validation:
        error = answer.validation.held_out_rms_mm
        yield _SummaryLine("cross-validation error, root mean square", None, error, "mm")
    yield from (_SummaryLine("finding", finding) for finding in answer.findings)


def _asked(answer: Answer) -> Iterator[_SummaryLine]:
    """Deflection of the load point at the test pose, and the decision on a tolerance."""
    pose, asked = answer.test_pose, answer.tolerance
    if pose is not None:
        yield _SummaryLine("deflection at the test pose", None, pose.deflection_mm, "mm")
        yield _SummaryLine("its expanded uncertainty, k = 2", None, pose.expanded_mm, "mm")
    if asked is not None:
        yield _SummaryLine("tolerance", None, asked.deflection_mm, "mm")
        yield _SummaryLine("decision at the test pose", asked.test_pose)
    if asked is not None and asked.path is not None:
        yield _SummaryLine(f"decision along {asked.path.file}", asked.path.decision)


@dataclass(frozen=True)
class _Joined:
    """An object and another that belongs to it."""

    of: Any
    beside: Any


def _of(name: str) -> Callable[[Any], Any]:
    return lambda row: getattr(row.of, name)


_STIFFNESS = (
    _SheetColumn("axis", _of("axis")),
    _SheetColumn("joint", _of("joint_name")),
    _SheetColumn("stiffness", _of("name")),
    _number("value", _of("value")),
    _number("standard uncertainty", _of("std")),
    _number("95 % from", lambda row: row.of.ci95[0]),
    _number("95 % to", lambda row: row.of.ci95[1]),
    _SheetColumn("unit", _of("unit")),
    _number("relative uncertainty [%]", lambda row: _percent(row.of.relative_std)),
    _number("nominal", _of("nominal")),
    _number("joint springs alone", lambda row: row.beside.value),
    _number("their standard uncertainty", lambda row: row.beside.std),
    _SheetColumn("determined", lambda row: "yes" if row.of.identifiable else "no"),
    _number("compliance", _of("compliance")),
    _number("standard uncertainty of the compliance", _of("compliance_std")),
    _SheetColumn("unit of the compliance", _of("compliance_unit")),
    _SheetColumn("finding", _of("finding")),
)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _beside_springs(answer: Answer) -> list[_Joined]:
    """Each stiffness with that of the paper's model."""
    springs = answer.joint_springs.stiffness
    return [_Joined(*pair) for pair in zip(answer.stiffness, springs, strict=True)]


_COMBINATIONS = (
    _SheetColumn("compliances", lambda one: one.formula),
    _number("value", lambda one: one.value),
    _number("standard uncertainty", lambda one: one.std),
    _number("95 % from", lambda one: one.ci95[0]),
    _number("95 % to", lambda one: one.ci95[1]),
    _SheetColumn("unit", lambda one: one.unit),
    _SheetColumn("distinguished by", lambda one: one.needs),
)

_CAUSES = (
    _SheetColumn("cause", lambda row: words.placed(row.of)),
    _SheetColumn("name", _of("name")),
    _SheetColumn("where", _of("where")),
    _number("probability [1]", _of("probability")),
    _number("p-value [1]", _of("p_value")),
    _SheetColumn("quantity", lambda row: row.beside and row.beside.meaning),
    _SheetColumn("parameter", lambda row: row.beside and row.beside.name),
    _number("value", lambda row: row.beside and row.beside.value),
    _number("standard uncertainty", lambda row: row.beside and row.beside.std),
    _SheetColumn("unit", lambda row: row.beside and row.beside.unit),
    _SheetColumn("rivals", lambda row: _rivals(row.of)),
    _SheetColumn("evidence", lambda row: row.of.evidence and row.of.evidence.sentence),
    _SheetColumn("settled by", _of("needs")),
)


def _parameters(causes: Iterable[Cause]) -> Iterator[_Joined]:
    """Each cause once per parameter, or once if it has none."""
    for cause in causes:
        yield from (_Joined(cause, one) for one in cause.parameters or (None,))


def _rivals(cause: Cause) -> str | None:
    texts = [f"{words.placed(one)} ({one.probability:.2g})" for one in cause.rivals]
    return ", ".join(texts) or None


def _std_mm(axis: int) -> Callable[[TargetDeflection], float | None]:
    return lambda one: one.std_mm[axis]


_PREDICTIONS = (
    _SheetColumn("target", lambda one: one.target),
    _number("dx [mm]", lambda one: one.dx_mm),
    _number("dy [mm]", lambda one: one.dy_mm),
    _number("dz [mm]", lambda one: one.dz_mm),
    _number("deflection [mm]", lambda one: one.size_mm),
    *(_number(f"standard uncertainty {name} [mm]", _std_mm(k)) for k, name in enumerate("xyz")),
)
"""Deflection at the test pose."""


def _mean(of: str, draw: str) -> Callable[[Any], float | None]:
    """Mean of Eq. (22) for the target of a row, if available."""
    return lambda row: getattr(getattr(row.beside, draw, row.beside), of).get(row.of)


_VALIDATION = (
    _SheetColumn("target", lambda row: row.of),
    _number("relative error around the test pose [1]", _mean("test_pose", "")),
    _number("relative error in the workspace [1]", _mean("global_", "")),
    _number(
        "around the test pose, each stiffness by itself [1]", _mean("test_pose", "independent")
    ),
    _number("in the workspace, each by itself [1]", _mean("global_", "independent")),
)


def _targets(answer: Answer) -> list[_Joined]:
    found = answer.validation
    return [_Joined(target, found) for target in found.test_pose] if found else []


_REJECTED = (
    _SheetColumn("file", lambda one: one.file),
    _number("line", lambda one: one.line),
    _SheetColumn("reason", lambda one: one.reason),
)

_RESIDUALS = {
    "pose": ("pose", 1.0),
    "repeat": ("repeat", 1.0),
    "target": ("target", None),
    "axis": ("axis", None),
    "residual_m": ("residual [mm]", 1e3),
    "whitened": ("residual [standard deviations]", 1.0),
    "left_out_m": ("residual with the pose left out [mm]", 1e3),
}
"""Columns of RESIDUALS: heading, and the factor of a number."""


_RELIABILITY = {
    "source": ("source", None),
    "reading": ("reading", None),
    "file": ("file", None),
    "line": ("line", 1.0),
    "axis": ("axis", None),
    "r": ("redundancy [1]", 1.0),
    "w": ("standardised residual [1]", 1.0),
    "smallest_visible": ("minimal detectable bias", 1.0),
    "unit": ("unit", None),
    "moves_sigmas": ("moves [standard uncertainties]", 1.0),
    "moves_most": ("of", None),
}
"""Columns of RELIABILITY: heading, and the factor of a number."""


def _of_table(
    columns: Mapping[str, tuple[str, float | None]], table: pd.DataFrame | None
) -> pa.Table:
    """All rows of a table with readable headings; numbers that are not finite give empty cells."""
    found = pd.DataFrame(columns=list(columns)) if table is None else table
    return pa.table(
        {
            title: _words_of(found[name]) if factor is None else _numbers_of(found[name], factor)
            for name, (title, factor) in columns.items()
        }
    )


_SOURCE = "pipeline.annex.words:source"
"""Door of the annex: sources of uncertainty in words."""


def _words_of(column: pd.Series) -> pa.Array:
    cells = column.astype(object).where(column.notna(), None)
    words = (doors.found(_SOURCE) if column.name == "source" else None) or str
    return pa.array([None if one is None else printable(words(one)) for one in cells], STR)


def _numbers_of(column: pd.Series, factor: float) -> pa.Array:
    value = column.to_numpy(float, na_value=np.nan) * factor
    return pa.array(np.where(np.isfinite(value), value, np.nan), F64, from_pandas=True)


# --- the workbook --------------------------------------------------------------------------

_ALWAYS = datetime(1980, 1, 1)
"""Creation time stated in every workbook, so that the same answer gives the same bytes."""
_MOST_ROWS = 2**20 - 1
"""Maximum number of rows below the heading of an Excel sheet [1]; the CSV contains all."""
_WIDEST = 60
"""Maximum width of a column [characters]."""


def _workbook(found: Mapping[str, pa.Table]) -> bytes:
    """Write sheets to one .xlsx with bold, frozen headings; no cell is a formula or a link."""
    import xlsxwriter

    sink = io.BytesIO()
    written = xlsxwriter.Workbook(sink, {"in_memory": True})
    written.set_properties({"created": _ALWAYS})
    heading = written.add_format({"bold": True, "text_wrap": True, "valign": "top"})
    for name, table in found.items():
        sheet = written.add_worksheet(name)
        sheet.freeze_panes(1, 0)
        for at, title in enumerate(table.column_names):
            cells = table.column(at).slice(0, _MOST_ROWS).to_pylist()
            sheet.set_column(at, at, _width(title, cells))
            sheet.write_string(0, at, title, heading)
            write = sheet.write_string if table.schema.types[at] == STR else sheet.write_number
            for row, cell in enumerate(cells, 1):
                if cell is not None:
                    write(row, at, cell)
    written.close()
    return sink.getvalue()


def _width(title: str, cells: Iterable[object]) -> float:
    """Width of a column at which its words can be read; a number takes twelve characters."""
    longest = max((len(cell) for cell in cells if isinstance(cell, str)), default=12)
    return float(np.clip(max(longest, *map(len, title.split())), 8, _WIDEST) + 1)
