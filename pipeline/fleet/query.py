"""SQL over all finished campaigns: DuckDB reads the tables of tables.py, and nothing else."""

from __future__ import annotations

import contextlib
import csv
import importlib
import io
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.base import files
from pipeline.base.errors import CannotWrite, UsageError, listed
from pipeline.base.shown import in_json, printable, say
from pipeline.fleet import tables as fleet
from pipeline.fleet.preferred import expected_scatter
from pipeline.library.spreadsheets import harmless

FORMATS = ("table", "csv", "json", "xlsx")


@dataclass(frozen=True)
class _Found:
    """Result of a query.

    Attributes:
        columns: Names of the columns.
        rows: Rows of plain Python values.
    """

    columns: list[str]
    rows: list[tuple[Any, ...]]


def ask(root: Path, query: str) -> _Found:
    """Execute one query.

    Args:
        root: The project's root.
        query: One SELECT, in DuckDB's SQL.

    Raises:
        UsageError: It is not one, cannot be executed, or no campaign is finished.
    """
    scatter = expected_scatter(root)
    try:
        fleet.refresh(root, scatter)
    except CannotWrite:  # a read-only project: tables as left by the last run
        if not fleet.folder(root).is_dir():
            raise
    duckdb, place = _duckdb(), fleet.folder(root).resolve()
    if not any(place.glob("campaigns/*/*.parquet")):
        raise UsageError("no campaign is finished: run `pipeline run` first")
    try:
        return _answered(duckdb, place, query)
    except duckdb.Error as problem:
        if not (damaged := fleet.mend(root, scatter)):
            raise UsageError(f"the query cannot be answered: {_said(problem)}; {_SEE}") from problem
    say(f"{listed(map(str, damaged))} could not be read and was made again.", sys.stderr)
    try:
        return _answered(duckdb, place, query)
    except duckdb.Error as problem:
        raise UsageError(f"the query cannot be answered: {_said(problem)}; {_SEE}") from problem


def _answered(duckdb: Any, place: Path, query: str) -> _Found:
    """Result of one query.

    Raises:
        duckdb.Error: It cannot be executed, or one of its tables cannot be read.
    """
    with duckdb.connect(":memory:") as base:
        _prepare(duckdb, base, place)
        _select(duckdb, query)
        answer = base.execute(query)
        return _Found([column[0] for column in answer.description], answer.fetchall())


_SEE = "docs/query.md has the tables, their columns and examples"


def _duckdb() -> Any:
    try:
        return importlib.import_module("duckdb")
    except ImportError:
        raise UsageError(
            "queries need the package duckdb: pip install 'rail-stiffness[query]'"
        ) from None


def _prepare(duckdb: Any, base: Any, place: Path) -> None:
    """Create views of the tables; then deny access to any other file, and lock that setting.

    A table that cannot be read has no view, so that a query of it fails.
    """
    for name, promise in fleet.VIEWS.items():
        columns = ", ".join(["robot", *(f'"{column}"' for column in promise.names)])
        source = _quoted(f"{place}/{name}/*/*.parquet")
        options = "hive_partitioning = true, hive_types = {'robot': varchar}"
        with contextlib.suppress(duckdb.Error):
            base.execute(
                f"create view {name} as select {columns} from read_parquet({source}, {options})"
            )
    base.execute("set temp_directory = ''")  # its default is `.tmp` in the current folder
    base.execute(f"set allowed_directories = [{_quoted(f'{place}/')}]")
    base.execute("set enable_external_access = false")
    base.execute("set python_enable_replacements = false")  # or a name could mean a Python variable
    base.execute("set lock_configuration = true")


def _quoted(text: str) -> str:
    doubled = text.replace("'", "''")
    return f"'{doubled}'"


def _select(duckdb: Any, query: str) -> None:
    """Check that a query is a single SELECT."""
    asked = duckdb.extract_statements(query)
    if len(asked) != 1 or asked[0].type != duckdb.StatementType.SELECT:
        raise UsageError(f"a query is one SELECT, which changes nothing; {_SEE}")


def _said(problem: Exception) -> str:
    """DuckDB's message in one line, without the query and the arrow below it."""
    words = str(problem).partition("\n\nLINE ")[0]
    return printable(" ".join(words.split()), 400).rstrip(" .")


# --- output --------------------------------------------------------------------------------------


def written(found: _Found, form: str) -> bytes:
    """The rows as content of a file in one of `FORMATS` except `table`."""
    return {"csv": _csv, "json": _json, "xlsx": _xlsx}[form](found)


def _csv(found: _Found) -> bytes:
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    columns = [_cells([row[k] for row in found.rows]) for k in range(len(found.columns))]
    writer.writerow(_cells(found.columns))
    writer.writerows(zip(*columns, strict=True))
    return sink.getvalue().encode("utf-8", "backslashreplace")


def _cells(values: Sequence[Any]) -> list[str]:
    """A column as text, in which no string can act as a formula, as in csv/ of a report."""
    words = [None if isinstance(one, int | float | Decimal) else _word(one) for one in values]
    safe = harmless(pa.array(words, pa.string())).to_pylist()
    pairs = zip(values, safe, strict=True)
    return [_word(value) if word is None else word for value, word in pairs]


def _json(found: _Found) -> bytes:
    rows = [dict(zip(found.columns, map(_plain, row), strict=True)) for row in found.rows]
    return f"{in_json(rows, indent=2)}\n".encode()


def _xlsx(found: _Found) -> bytes:
    try:
        from openpyxl import Workbook
    except ImportError:
        raise UsageError(
            "workbooks need the package openpyxl: pip install 'rail-stiffness[query]', or use csv"
        ) from None
    book = Workbook()
    sheet = book.active
    for at, row in enumerate([found.columns, *found.rows], 1):
        for beside, value in enumerate(map(_plain, row), 1):
            cell = sheet.cell(at, beside)
            cell.value = value if isinstance(value, bool | int | float) else _word(value) or None
            if isinstance(cell.value, str):
                cell.data_type = "s"  # a name that begins with = is no formula
    sink = io.BytesIO()
    book.save(sink)
    return sink.getvalue()


def _word(value: Any) -> str:
    """A value as text, empty for None; control characters are escaped."""
    if value is None:
        return ""
    if isinstance(value, datetime | date):
        return value.isoformat()
    return printable(value if isinstance(value, str) else str(value))


def _plain(value: Any) -> Any:
    """A value that JSON can represent."""
    if isinstance(value, float | Decimal):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Sequence):
        return [_plain(one) for one in value]
    return {key: _plain(one) for key, one in value.items()} if isinstance(value, dict) else (
        _word(value))  # fmt: skip


_WIDEST = 10_000
"""Width of a table that is not for a terminal [character], so that no line is broken."""


def show(found: _Found) -> None:
    """Print the rows as a table on stdout."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, header_style="bold", pad_edge=False)
    for k, name in enumerate(found.columns):
        numbers = all(isinstance(row[k], int | float | Decimal | None) for row in found.rows)
        table.add_column(Text(printable(name)), justify="right" if numbers else "left")
    for row in found.rows:
        table.add_row(*(Text(_shown(value)) for value in row))
    console = Console()
    console.print(table, width=None if console.is_terminal else _WIDEST, soft_wrap=True)


def _shown(value: Any) -> str:
    """Four digits of a number, for legibility; the other formats have all digits."""
    return f"{value:.4g}" if isinstance(value, float | Decimal) else _word(value)


def described() -> _Found:
    """The tables and their columns, with unit and meaning."""
    robot = ("robot", "1", "the robot that was measured")
    rows = [
        (name, *about)
        for name, promise in fleet.VIEWS.items()
        for about in (robot, *((f.name, *_about(f)) for f in promise))
    ]
    return _Found(["table", "column", "unit", "meaning"], rows)


def _about(field: Any) -> tuple[str, str]:
    return field.metadata[b"unit"].decode(), field.metadata[b"meaning"].decode()


def save(found: _Found, form: str, path: Path) -> None:
    """Write the rows to a file.

    Raises:
        CannotWrite: The disk cannot be written.
    """
    files.write(path, written(found, form))
