"""The paper's numbers compared with ours, as page, PDF and figures."""

from __future__ import annotations

from collections.abc import Sequence

from bench.paper.tables import ASSUMPTIONS, MISPRINTS, Entry, Reproduction
from pipeline.base.quantities import plain
from pipeline.design.plan_figures import anchor_curve, size_curves
from pipeline.report.record import (
    Block,
    Column,
    Figure,
    Report,
    ReportTable,
    Section,
    entry,
    text_entry,
    unlabelled,
)
from pipeline.report.record import TableEntry as Cell
from pipeline.report.render import page, pdf
from pipeline.report.svg import Drawing

MM = 1e3
LABEL = "Criterion [mm]"
COLUMNS = (
    Column("Entry"),
    Column("Unit"),
    Column("Paper", True),
    Column("Ours", True),
    Column("Ratio", True),
    Column("Better plan", True),
    Column("Note"),
)


def paper_files(parts: Sequence[Reproduction], seconds: float) -> dict[str, bytes]:
    """All files of the page.

    Args:
        parts: One reproduction for each robot.
        seconds: Time they took [s].

    Returns:
        Content by path: index.html, report.pdf, figures/*.svg.
    """
    report, drawings = _report(parts, seconds), _drawn(parts)
    return {
        "index.html": page(report, {n: d.inline for n, d in drawings.items()}).encode(),
        "report.pdf": pdf(report, {n: d.svg for n, d in drawings.items()}),
        **{f"figures/{n}.svg": d.svg.encode() for n, d in drawings.items()},
    }


def _report(parts: Sequence[Reproduction], seconds: float) -> Report:
    known = [one.ratio for one in parts[0].entries if one.table == "II" and one.ratio]
    found = parts[0].better.figure / parts[0].published.figure
    missing = sum(one.ours is None for one in parts[0].entries)
    return Report(
        kicker="Optimal measurement poses for a robot on a rail",
        heading="The paper's tables, computed again",
        title="The paper's tables, computed again",
        verdict=f"Table II within {100 * max(abs(r - 1) for r in known):.1f} %",
        tone="neutral",
        first=unlabelled(
            f"{missing} entries cannot be reproduced from what is printed; each says why.",
            f"With the same pull, limits and number of readings, another choice of poses has "
            f"{plain(100 * found, 3)} % of the published plan's criterion.",
        ),
        sections=(
            _said("assumptions", "Assumptions", ASSUMPTIONS),
            _said("misprints", "Misprints and gaps", MISPRINTS),
            *(_section(part) for part in parts),
        ),
        elsewhere="The same stands in index.html and report.pdf, the numbers in paper.json.",
        run_time=f"{seconds:.1f} s",
    )


def _said(key: str, title: str, lines: Sequence[str]) -> Section:
    rows = tuple((text_entry(line),) for line in lines)
    return Section(key, title, (ReportTable(key, title, (Column("What"),), rows),))


def _section(part: Reproduction) -> Section:
    tables = dict.fromkeys(one.table for one in part.entries)
    blocks: list[Block] = []
    for name in tables:
        rows = tuple(_row(one) for one in part.entries if one.table == name)
        title = name if name.startswith("Fig") else f"Table {name}"
        blocks.append(
            ReportTable(f"{part.robot}-{name.lower().replace('. ', '')}", title, COLUMNS, rows)
        )
    size = "The criterion of our best plans against the number of readings, as in Fig. 5."
    place = "The criterion against x of the anchor, as in Fig. 6: published poses, and poses anew."
    blocks.append(Figure(f"{part.robot}-size", "Size of the plan", size, f"Curves. {size}"))
    blocks.append(Figure(f"{part.robot}-anchor", "Place of the anchor", place, f"Curves. {place}"))
    return Section(part.robot, part.robot, tuple(blocks))


def _row(one: Entry) -> tuple[Cell, ...]:
    numbers = (one.paper, one.ours, one.ratio, one.better)
    return (
        text_entry(one.what),
        text_entry("" if one.unit == "1" else one.unit),
        *(entry(plain(value, 4), value) for value in numbers),
        text_entry(one.note),
    )


def _drawn(parts: Sequence[Reproduction]) -> dict[str, Drawing]:
    out = {}
    for part in parts:
        out[f"{part.robot}-size"] = size_curves(part.sizes, MM, LABEL, f"{part.robot}-size")
        out[f"{part.robot}-anchor"] = anchor_curve(part.anchors, MM, LABEL, f"{part.robot}-anchor")
    return out
