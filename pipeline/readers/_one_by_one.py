"""Rows one by one, to say of each that cannot be read why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.base.errors import InputError
from pipeline.readers import _time
from pipeline.readers._cells import NUMBER, Bad, cells, cells_or_none, cut_off, is_special, shown
from pipeline.readers._layout import Field, Kind, Layout, Rows
from pipeline.readers._text import Text
from pipeline.readers._time import MOMENT

_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(,[0-9]{3})+")
_JOINT = "::"


def one_by_one(text: Text, layout: Layout) -> Rows:
    decimal = layout.decimal or _decimal(text, layout)
    kept: list[list[Any]] = []
    line: list[int] = []
    rejected: list[tuple[int, str]] = []
    zoned: set[bool] = set()
    for number, content in text.lines(layout.first):
        if is_special(content, layout):
            continue
        try:
            kept.append(_row(content, layout, decimal, zoned))
            line.append(number)
        except Bad as reason:
            rejected.append((number, str(reason)))
    if len(zoned) > 1:
        raise InputError(
            "some times have a zone and some have none",
            "export all times in the same form",
            file=text.name,
        )
    if line and cut_off(text, layout, np.array(line)):
        kept.pop()
        rejected.append((line.pop(), "the file ends inside this line; export it again"))
    everything = sorted([*line, *(number for number, _ in rejected)])
    columns = {
        f.name: _array([row[k] for row in kept], f.kind)
        for k, f in enumerate(layout.fields)
        if f.kind in ("name", "number", "time")
    }
    lines = np.array(line, dtype=np.int64)
    order = np.searchsorted(everything, lines) + 1
    return Rows(columns, lines, order, tuple(rejected))


def _array(values: list[Any], kind: Kind) -> pa.Array:
    if kind == "name":
        return pa.array(values, pa.string()).dictionary_encode()
    return pa.array(values, pa.float64() if kind == "number" else MOMENT)


def _row(line: str, layout: Layout, decimal: str, zoned: set[bool]) -> list[Any]:
    found = cells(line, layout.delimiter)
    if layout.joined:
        names = [name.strip() for name in found[0].split(_JOINT)]
        if len(names) != layout.joined:
            raise Bad(
                f"has {len(names)} names in its first cell where {layout.joined} are expected; "
                "write the name again or remove the row"
            )
        found = [*names, *found[1:]]
    if len(found) != len(layout.fields):
        raise Bad(_wrong_count(found, layout))
    return [
        _cell(cell, field, layout, decimal, zoned)
        for cell, field in zip(found, layout.fields, strict=True)
    ]


def _wrong_count(found: Sequence[str], layout: Layout) -> str:
    said = f"has {len(found)} fields where {len(layout.fields)} are expected"
    if layout.delimiter == "," and len(found) > len(layout.fields):
        return (
            f"{said}, as if a comma stood where a decimal point belongs; write numbers with a point"
        )
    return f"{said}; write the row again or remove it"


def _cell(cell: str, field: Field, layout: Layout, decimal: str, zoned: set[bool]) -> Any:
    if field.kind == "any":
        return None
    if field.kind == "blank":
        if cell:
            raise Bad(f'has "{shown(cell)}" behind the last column; remove it')
        return None
    if not cell:
        if field.needed:
            raise Bad(f"has nothing in column {field.said}; fill it in or remove the row")
        return None if field.kind != "name" else ""
    if field.kind == "name":
        return cell
    if field.kind == "number":
        return _number(cell, field, decimal)
    return _moment(cell, field, layout, zoned)


def _number(cell: str, field: Field, decimal: str) -> float:
    foreign = "." if decimal == "," else ","
    written = cell.replace(",", ".") if decimal == "," else cell
    if foreign not in cell and NUMBER.fullmatch(written):
        value = float(written)
        if np.isfinite(value):
            return value
        raise Bad(
            f'{field.said} is "{shown(cell)}", too large for a number; correct or remove the row'
        )
    if cell.lower().lstrip("+-") in (
        "nan",
        "inf",
        "infinity",
        "na",
        "n/a",
        "null",
        "none",
        "1.#qnan",
    ):
        raise Bad(
            f'{field.said} is "{shown(cell)}", not a number; measure it again or remove the row'
        )
    if foreign in cell and re.fullmatch(r"[+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?", cell):
        raise Bad(
            f'{field.said} is "{shown(cell)}": this file has the decimal mark "{decimal}"; '
            "write all numbers the same way"
        )
    raise Bad(f'{field.said} is "{shown(cell)}", not a number; correct or remove the row')


def _moment(cell: str, field: Field, layout: Layout, zoned: set[bool]) -> datetime:
    found = _time.moment(cell, layout.moment)
    if found is None:
        known = _time.form_of(cell) not in (None, layout.moment)
        other = "in another form than the first one" if known else "not a time"
        raise Bad(f'{field.said} is "{shown(cell)}", {other}; correct or remove the row')
    zoned.add(found.tzinfo is not None)
    return _time.without_zone(found)


def _decimal(text: Text, layout: Layout) -> str:
    """The decimal mark of a file: the one that most of its numbers have.

    Raises:
        InputError: Every comma could as well stand between thousands.
    """
    numeric = [k for k, field in enumerate(layout.fields) if field.kind == "number"]
    points = commas = 0
    doubtful: tuple[int, str] | None = None
    for number, line in text.lines(layout.first):
        if is_special(line, layout):
            continue
        found = cells_or_none(line, layout.delimiter) or []
        for cell in (found[k] for k in numeric if k < len(found)):
            if _GROUPED.fullmatch(cell):
                doubtful = doubtful or (number, cell)
            else:
                points += "." in cell and "," not in cell
                commas += "," in cell and "." not in cell
    if doubtful and not commas and not points:
        where, cell = doubtful
        raise InputError(
            f'"{cell}" may be {cell.replace(",", ".", 1)} or {cell.replace(",", "")}',
            'say which with decimal = "," or decimal = "." in [tracker] of campaign.toml',
            file=text.name,
            line=where,
        )
    return "," if commas > points else "."
