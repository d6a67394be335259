"""Sections for filing: what was measured, rows left out, links to files and other campaigns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from urllib.parse import quote

from pipeline.annex.identity import LabelledText, rows
from pipeline.answer.contract import Answer, Measuring, Rejected, SetAside, Unit
from pipeline.answer.words import listed
from pipeline.report.record import (
    Cells,
    Column,
    Paragraph,
    ReportTable,
    Section,
    TableEntry,
    entry,
    section_of,
    table_of,
    word_column,
)


def identity(answer: Answer) -> Section | None:
    """Date, operator, instrument, scale, robot, software, and one line on what is not stated."""
    columns: list[Cells[LabelledText]] = [
        word_column("What", lambda row: row[0]),
        word_column("Stated", lambda row: row[1]),
    ]
    every = [*rows(answer), *_unsaid(answer)]
    return section_of(
        "identity", "This campaign", [table_of("identity", "What was measured", columns, every)]
    )


def _unsaid(answer: Answer) -> Iterator[LabelledText]:
    """LabelledText listing what should be filed but is not stated in campaign.toml."""
    found, instrument = answer.identity, answer.instrument
    papers = {"robot": answer.robot_unit, "instrument": instrument, "scale": found.scale}
    if found.force_n is None:
        del papers["scale"]
    stated = {
        "the date": found.first or answer.measured,
        "the operator": found.operator,
        "the model of the instrument": instrument and instrument.model,
        "the temperature of the base": found.temperature_c is not None,
    }
    lacking = [what for what, said in stated.items() if not said]
    lacking += [f"{listed(_lacking(of))} of the {k}" for k, of in papers.items() if _lacking(of)]
    if lacking:
        yield "Not stated", "; ".join(lacking)


def _lacking(of: Unit | Measuring | None) -> list[str]:
    papers = (None,) * 3 if of is None else (of.serial, of.certificate, of.calibrated)
    words = ("serial number", "certificate", "date of calibration")
    return [word for word, paper in zip(words, papers, strict=True) if not paper]


_MOST_ROWS = 400
"""Maximum number of rejected rows shown; further ones are counted here and listed in
result.json."""


def rejected(answer: Answer) -> Section | None:
    """Rows that were left out, with reasons; at most `_MOST_ROWS` of them."""
    given = answer.rejected
    columns: list[Cells[Rejected]] = [
        word_column("File", lambda row: row.file, code=True),
        (Column("Line", numeric=True), _line),
        word_column("Reason", lambda row: row.reason),
    ]
    more = len(given) - _MOST_ROWS
    note = f"{more} more are in result.json." if more > 0 else ""
    table = table_of("rejected", "Left out and why", columns, given[:_MOST_ROWS], note)
    parts = [Paragraph(_left_out(len(given))), table, *_set_aside(answer.set_aside)]
    return section_of("rejected", "Rejected rows", parts)


def _set_aside(given: Sequence[SetAside]) -> list[ReportTable | None]:
    """What the operator set aside; no table where there is nothing."""
    columns: list[Cells[SetAside]] = [
        word_column("Set aside", lambda one: one.name, code=True),
        (Column("Readings", numeric=True), lambda one: entry(str(one.readings), one.readings)),
        word_column("Reason", lambda one: one.reason),
    ]
    title = "Set aside by the operator, in campaign.toml"
    return [table_of("set-aside", title, columns, given, "")] if given else []


def _left_out(count: int) -> str:
    if not count:
        return "No row of the raw files was unreadable or incomplete."
    were = "1 row was" if count == 1 else f"{count} rows were"
    return f"{were} left out of the estimate; nothing was corrected silently."


def _line(row: Rejected) -> TableEntry:
    return TableEntry("whole file", 0) if row.line is None else entry(str(row.line), row.line)


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
    every = list(_links(beside, previous)) if beside else []
    table = table_of("files", "This campaign elsewhere", columns, every)
    return section_of("files", "Files and other campaigns", [table])


def _links(beside: Collection[str], previous: Answer | None) -> Iterator[tuple[TableEntry, str]]:
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
