"""Times as instruments write them: which form a cell has, and cells to timestamps."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

import pyarrow as pa
import pyarrow.compute as pc

MOMENT = pa.timestamp("us")
ISO = "ISO 8601"
APOSTROPHE = "'"
"""Leica's programs put one before a time, so that Excel leaves it alone."""

_CLOCK = r"[0-9]{1,2}:[0-9]{2}:[0-9]{2}"
_FORMS = {
    ISO: r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}(:[0-9]{2}(\.[0-9]{1,9})?)?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?",
    "%m/%d/%y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK}",
    "%m/%d/%Y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK}",
    "%m/%d/%y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK} [AP]M",
    "%m/%d/%Y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK} [AP]M",
    "%d.%m.%Y %H:%M:%S": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{4}} {_CLOCK}",
}
"""SpatialAnalyzer writes month/day/year, Leica's programs day.month.year; slashes are American."""

_FRACTION = re.compile(r"(?<=:[0-9]{2})[.,]([0-9]{1,6})(?= |$)")


def form_of(cell: str) -> str | None:
    """The form in which a time is written, or None when it is none that we know."""
    bare = _FRACTION.sub("", cell.strip().lstrip(APOSTROPHE))
    for form, pattern in _FORMS.items():
        if re.fullmatch(pattern, bare):
            return form
    return None


def template(form: str) -> str:
    """A time of this form with zeros for digits, or nothing where its width may vary."""
    digits = {"%Y": "0000"} | dict.fromkeys(("%y", "%m", "%d", "%H", "%M", "%S"), "00")
    for mark, zeros in digits.items():
        form = form.replace(mark, zeros)
    return "" if "%" in form or form == ISO else form


def moment(cell: str, form: str) -> datetime | None:
    """The time in a cell, with its zone if it has one, or None when the cell is of another form."""
    bare = cell.strip().lstrip(APOSTROPHE)
    if form in _FORMS and form_of(bare) != form:  # strptime takes 16:38:2 for a time
        return None
    try:
        if form == ISO:
            return datetime.fromisoformat(bare)
        fraction = _FRACTION.search(bare)
        found = datetime.strptime(_FRACTION.sub("", bare), form)
    except ValueError:
        return None
    digits = fraction[1] if fraction else "0"
    return found + timedelta(microseconds=int(digits.ljust(6, "0")))


def without_zone(found: datetime) -> datetime:
    """UTC where the zone is known, else as written."""
    return found if found.tzinfo is None else found.astimezone(UTC).replace(tzinfo=None)


def moments(cells: pa.Array, form: str) -> pa.TimestampArray:
    """All cells at once, of a `strptime` form.

    Raises:
        pa.ArrowInvalid: A cell needs a closer look.
    """
    bare = (
        pc.utf8_ltrim(cells, characters=APOSTROPHE)
        if pc.starts_with(cells[:1], APOSTROPHE)[0].as_py()
        else cells
    )
    length = pc.min_max(pc.binary_length(bare)).as_py()
    # where widths differ the careful way decides
    if length["min"] != length["max"]:
        raise pa.ArrowInvalid("times of different width")
    return pc.strptime(bare, format=form, unit="us")
