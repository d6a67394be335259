"""What stood where: the cell in three dimensions, and its poses one by one."""

from __future__ import annotations

from typing import Any

from pipeline.annex.figures.scene import joints_of, largest, readings_of
from pipeline.answer.contract import Answer
from pipeline.base.quantities import plain
from pipeline.report.columns import Cells, number, said, table_of
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import ReportTable, Section, section_of
from pipeline.report.summaries import Tables, each_row, has


def cell(answer: Answer, tables: Tables) -> Section | None:
    """The scene and the same in a table, for who cannot see it."""
    drawn = figures(("scene",), answer, tables)
    return section_of("cell", "The cell", [*drawn, _poses(answer, tables) if drawn else None])


def _poses(answer: Answer, tables: Tables) -> ReportTable | None:
    if not has(tables, "poses"):
        return None
    nothing = (float("nan"), float("nan"))
    did = dict.fromkeys(tables["poses"]["pose"], nothing) | largest(tables)
    loads: list[Cells[Any]] = [
        said("Joint values", joints_of),
        number("Pulls", lambda one: one.pulls, str),
        number("Force [N]", lambda one: one.force_n),
    ]
    off = ("Deviation from the nominal robot", "Deviation from the identified robot")
    names = off if answer.of_positions else (
        "Deflection", "Residual"
    )  # fmt: skip
    columns: list[Cells[Any]] = [
        said("Pose", lambda one: one.label.removeprefix("Pose ")),
        said("Readings", readings_of),
        *(() if answer.of_positions else loads),
        *(_millimetres(name, k, did) for k, name in enumerate(names)),
    ]
    note = "Largest force of each pose, and the largest value of its reflectors."
    rows = each_row(tables["poses"])
    return table_of("poses", "The poses of the picture", columns, rows, note)


def _millimetres(name: str, k: int, did: dict[int, tuple[float, float]]) -> Cells[Any]:
    return number(f"{name} [mm]", lambda one: did[one.pose][k], plain)
