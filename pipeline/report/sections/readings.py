"""What the data look like: residuals, budget, registration, rejected rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.base.quantities import MISSING, known, p_value, plain, with_std
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Column, Entry, Section, Table, Text, entry, text_entry
from pipeline.report.sections._tree import items, section_of
from pipeline.report.summaries import Result, Tables, has, registration_by_target

_MOST_ROWS = 400
"""Rows of rejected readings shown; the rest is counted and stands in the tables."""


def residuals(result: Result, tables: Tables) -> Section | None:
    """Pictures of what the fit leaves."""
    names = ("pose-rms", "residual-force", "residual-course", "whitened", "arrows")
    return section_of("residuals", "Residuals", figures(names, result, tables))


def budget(result: Result) -> Section | None:
    """Which error makes each stiffness uncertain, and the noise found beside the stated."""
    return section_of(
        "budget",
        "Uncertainty budget",
        [
            _budget_table(items(result, "budget")),
            _noise_table(items(result, "noise", "components")),
        ],
    )


def _budget_table(lines: list[Any]) -> Table | None:
    if not lines:
        return None
    shares = [key for key in lines[0] if key != "source"]
    rows = [
        (
            text_entry(words.SOURCES.get(str(line.get("source")), line.get("source"))),
            *[entry(_share(line.get(key)), line.get(key)) for key in shares],
        )
        for line in lines
    ]
    columns = (Column("Source"), *[Column(key, numeric=True) for key in shares])
    note = "Shares of the variance of each stiffness; the largest is where better measuring pays."
    return Table("budget", "Where the uncertainty comes from", columns, tuple(rows), note)


def _share(value: Any) -> str:
    return "below 0.1" if known(value) and value < 0.1 else plain(value, 2)


def _noise_table(found: list[Any]) -> Table | None:
    rows = []
    for one in found:
        scale, std = one.get("found_over_stated"), one.get("std")
        p = one.get("p_value")
        rows.append(
            (
                text_entry(words.SOURCES.get(str(one.get("name")), one.get("name"))),
                entry(with_std(scale, std), scale),
                entry(p_value(p) if known(p) else MISSING, p),
            )
        )
    columns = (
        Column("Noise of"),
        Column("Found over stated", numeric=True),
        Column("Chance of as much or more", numeric=True),
    )
    note = "Found from repeats, zeros read again and the effector's own triangle; 1 is as stated."
    title = "Noise in the readings beside the stated noise"
    return Table("noise", title, columns, tuple(rows), note) if rows else None


def registration(result: Result, tables: Tables) -> Section | None:
    """How well the base reflectors fit."""
    table = None
    if has(tables, "registration"):
        digest = registration_by_target(tables["registration"])
        rows = [
            (
                text_entry(r.target),
                entry(str(r.readings), r.readings),
                *[entry(plain(v, 2), v) for v in (r.dx, r.dy, r.dz, r.rms, r.largest)],
            )
            for r in _rows(digest)
        ]
        names = ("mean dx", "mean dy", "mean dz", "rms", "largest")
        columns = (
            Column("Base reflector"),
            Column("Readings", numeric=True),
            *[Column(f"{name} [mm]", numeric=True) for name in names],
        )
        table = Table(
            "registration",
            "Base reflectors: measured minus nominal, base frame",
            columns,
            tuple(rows),
        )
    return section_of(
        "registration",
        "Registration of the tracker",
        [_registration_text(result), table, *figures(("registration",), result, tables)],
    )


def _rows(table: pd.DataFrame) -> Iterator[Any]:
    """Rows with their columns as attributes."""
    return table.itertuples()


def _registration_text(result: Result) -> Text | None:
    given = result.get("registration")
    if not isinstance(given, Mapping):
        return None
    said = []
    if known(given.get("rms_mm")):
        said.append(f"The base reflectors fit their nominals to {plain(given['rms_mm'])} mm rms")
        if known(given.get("max_mm")):
            said[-1] += f", {plain(given['max_mm'])} mm at worst"
        said[-1] += "."
    if known(given.get("chi2")) and known(given.get("dof")):
        tested = f" ({p_value(given['p_value'])})" if known(given.get("p_value")) else ""
        said.append(
            f"chi² is {plain(given['chi2'], 4)} for {given['dof']} degrees of freedom{tested}."
        )
    rotation, translation = _worst(given, "rotation_std_rad"), _worst(given, "translation_std_m")
    if rotation is not None:
        said.append(
            f"The standard uncertainty of its orientation is {plain(1e6 * rotation, 2)} µrad."
        )
    if translation is not None:
        said.append(f"That of its origin is {plain(1e6 * translation, 2)} µm.")
    return Text(" ".join(said)) if said else None


def _worst(given: Mapping[str, Any], key: str) -> float | None:
    value = given.get(key)
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    sizes = [float(v) for v in values if known(v)]
    return max(sizes) if sizes else None


def rejected(result: Result, tables: Tables) -> Section:
    """Rows that were left out and why, at most MOST_ROWS of them."""
    given = items(result, "rejected")
    if not given and has(tables, "rejected"):
        given = tables["rejected"].to_dict("records")
    title = "Rejected rows"
    if not given:
        return Section("rejected", title, (Text("No row of the raw files was rejected."),))
    rows = [
        (text_entry(r.get("file")), _line(r.get("line")), text_entry(r.get("reason")))
        for r in given[:_MOST_ROWS]
    ]
    columns = (Column("File", code=True), Column("Line", numeric=True), Column("Reason"))
    more = len(given) - len(rows)
    note = f"{more} more stand in result.json." if more > 0 else ""
    count = "1 row was" if len(given) == 1 else f"{len(given)} rows were"
    said = Text(f"{count} left out of the estimate; nothing was corrected silently.")
    return Section(
        "rejected", title, (said, Table("rejected", "Left out and why", columns, tuple(rows), note))
    )


def _line(line: Any) -> Entry:
    return Entry("whole file", 0) if not known(line) else entry(str(int(line)), int(line))
