"""Section on the cell: its picture in three dimensions, and a table of its poses."""

from __future__ import annotations

from typing import Any

from pipeline.annex.figures.scene import joints_of, largest, readings_of
from pipeline.answer.contract import Answer
from pipeline.base.quantities import plain
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Cells,
    ReportTable,
    Section,
    number_column,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables, each_row, has


def cell(answer: Answer, tables: Tables) -> Section | None:
    """The scene, and a table with the same content for readers who cannot see it."""
    drawn = figures(("scene",), answer, tables)
    return section_of("cell", "The cell", [*drawn, _poses(answer, tables) if drawn else None])


def _poses(answer: Answer, tables: Tables) -> ReportTable | None:
    if not has(tables, "poses"):
        return None
    nothing = (float("nan"), float("nan"))
    did = dict.fromkeys(tables["poses"]["pose"], nothing) | largest(tables)
    loads: list[Cells[Any]] = [
        word_column("Joint values", joints_of),
        number_column("Pulls", lambda one: one.pulls, str),
        number_column("Force [N]", lambda one: one.force_n),
    ]
    off = ("Deviation from the nominal robot", "Deviation from the identified robot")
    names = off if answer.of_positions else (
        "Deflection", "Residual"
    )  # fmt: skip
    columns: list[Cells[Any]] = [
        word_column("Pose", lambda one: one.label.removeprefix("Pose ")),
        word_column("Readings", readings_of),
        *(() if answer.of_positions else loads),
        *(_millimetres(name, k, did) for k, name in enumerate(names)),
    ]
    note = "Largest force of each pose, and the largest value of its reflectors."
    rows = each_row(tables["poses"])
    return table_of("poses", "The poses of the picture", columns, rows, note)


def _millimetres(name: str, k: int, did: dict[int, tuple[float, float]]) -> Cells[Any]:
    return number_column(f"{name} [mm]", lambda one: did[one.pose][k], plain)
