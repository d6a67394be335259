"""Times of a table with a header: their column and format, and columns that are not times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base.errors import InputError
from pipeline.dialects import _time
from pipeline.dialects._cells import cells_or_none, is_plain
from pipeline.dialects._named import FOREIGN, Header, Named
from pipeline.readers._iso import ISO
from pipeline.readers._layout import TypedRows
from pipeline.readers._text import Text, shortened

SEARCHED = 1000
"""Number of rows searched for the first one with a time [1]; if there is none, ISO 8601 is
assumed."""
_MOST = 0.9
"""Fraction of the times of a file that must be possible in their format [1]."""
_DAY_FIRST = {*FOREIGN["day_first"], *FOREIGN["titles"]["target"]}
"""Titles of languages other than English."""
_SEVERAL = 2
"""Number of cells that are not times from which the column, rather than a damaged cell, is wrong
[1]."""


def form_of_times(text: Text, header: Header, comment: str | None) -> str:
    """Format of the times, taken from the first row that has one with a date, or any.

    Of dates with slashes the day comes first if that alone makes dates of them, or if the titles
    are of a language that writes it first: all but English do.
    """
    rows = sample(text, header, comment)
    if not header.has("time"):
        _no_times_elsewhere(next(rows, []), header)
        return ISO
    return form_of([_moment(cells, header) for cells in rows], header.columns) or ISO


def form_of(moments: Sequence[str], titles: Sequence[Named]) -> str | None:
    """Format of times below these titles, None if none is a time; see `form_of_times`."""
    form = _time.first_form(moments)
    if form is None or not form.startswith("%m/"):  # a year that comes first settles it
        return form
    if _DAY_FIRST.isdisjoint(one.title.lower() for one in titles):
        return _time.form_of_all([one for one in moments if one], _MOST) or form
    return form.replace("%m/%d", "%d/%m")


def trusted_times(text: Text, header: Header, comment: str | None) -> tuple[Header, str | None]:
    """Drop a time column that contains no time; return header, and its title with an example."""
    place = header.where("time")
    if place is None or header.has("date"):
        return header, None
    cells = [row[place] for row in sample(text, header, comment) if len(row) > place]
    filled = [cell for cell in cells if cell]
    if len(filled) < _SEVERAL or any(map(_time.form_of, filled)):
        return header, None
    columns = list(header.columns)
    columns[place] = replace(columns[place], role="")
    untimed = f'{columns[place].title} ("{shortened(filled[0])}")'
    return replace(header, columns=tuple(columns)), untimed


def sample(text: Text, header: Header, comment: str | None) -> Iterator[list[str]]:
    """Cells of the first `SEARCHED` rows below the header."""
    for _, line in text.lines(header.begins, most=SEARCHED):
        if is_plain(line, comment) and (cells := cells_or_none(line, header.delimiter)):
            yield cells


def _moment(cells: Sequence[str], header: Header) -> str:
    """Date and time of a row as written; empty if the time is not filled in."""
    places = (header.where(role) for role in ("date", "time"))
    day, clock = ("" if k is None else "".join(cells[k : k + 1]) for k in places)
    return f"{day} {clock.lstrip(_time.APOSTROPHE)}".strip() if clock else ""


def _no_times_elsewhere(cells: Sequence[str], header: Header) -> None:
    """Check that no column holds times if none is called time: they would be lost unnoticed."""
    for column, cell in zip(header.columns, cells, strict=False):
        if not column.role and _time.form_of(cell) not in (None, *_time.OF_DAY):
            raise InputError(
                f'column "{shortened(column.title)}" contains times, but is not called time',
                "call it time, or say what it is in [tracker.mapping] of campaign.toml",
            )


def dated(table: TypedRows, form: str) -> TypedRows:
    """Combine times of day with dates; reject rows whose time cannot be read."""
    days, clocks = (table.columns[role].cast(pa.string()) for role in ("date", "time"))
    clocks = pc.utf8_ltrim(clocks, characters=_time.APOSTROPHE)
    cells = pc.utf8_trim_whitespace(pc.binary_join_element_wise(days, clocks, " "))
    times, _ = _time.moments(cells, form)
    keep = np.asarray(pc.or_(times.is_valid(), pc.equal(cells, "")))
    return replace(table, columns={**table.columns, "time": times}).only(
        keep, "date and time are no time in the form of the others; correct or remove the row"
    )
