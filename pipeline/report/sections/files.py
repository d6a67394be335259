"""Section with links to the files of the run, all campaigns and the previous campaign."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from urllib.parse import quote

from pipeline.answer.contract import Answer
from pipeline.report.columns import Cells, table_of, word_column
from pipeline.report.record import Column, Section, TableEntry, section_of

_HOLDS = {
    "report.pdf": "this report on paper",
    "results.xlsx": "its tables for a spreadsheet; the same as text in csv/",
    "result.json": "every number, for programs",
    "model.toml": "the identified model with its causes and their covariance",
    "model.urdf": "the robot, for programs that read URDF",
    "model.xml": "the robot with its springs, for MuJoCo",
    "model.sdf": "the robot with its springs, for Drake and Gazebo",
}
"""Files that a run writes, with their content."""


def files(beside: Collection[str], previous: Answer | None) -> Section | None:
    """Links to the files in the page's folder and to other campaigns; None without such files.

    Args:
        beside: Names of the files in the page's folder.
        previous: The answer to the robot's previous campaign.
    """
    columns: list[Cells[tuple[TableEntry, str]]] = [
        (Column("File"), lambda row: row[0]),
        word_column("Holds", lambda row: row[1]),
    ]
    rows = list(_rows(beside, previous)) if beside else []
    table = table_of("files", "This campaign elsewhere", columns, rows)
    return section_of("files", "Files and other campaigns", [table])


def _rows(beside: Collection[str], previous: Answer | None) -> Iterator[tuple[TableEntry, str]]:
    for name, holds in _HOLDS.items():
        if name in beside:
            yield TableEntry(name, name, name), holds
    yield _page("All campaigns", ""), "each stiffness of every robot over time"
    if previous is not None:
        name = previous.campaign
        yield _page(name, f"{quote(name, safe='')}/"), "the robot's previous campaign"


def _page(text: str, folder: str) -> TableEntry:
    """Link to the page of a folder in reports/."""
    return TableEntry(text, text, f"../{folder}index.html")
