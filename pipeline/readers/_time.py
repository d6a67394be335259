"""Times as instruments write them: which form a cell has, and cells to timestamps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base.arrays import Bools

_MOMENT = pa.timestamp("us")
ISO = "ISO 8601"
APOSTROPHE = "'"
"""Leica's programs put one before a time, so that Excel leaves it alone."""

_MINUTE = r"[0-9]{1,2}:[0-9]{2}"
_CLOCK = rf"{_MINUTE}:[0-9]{{2}}"
_FORMS = {
    ISO: r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}(:[0-9]{2}(\.[0-9]{1,9})?)?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?",
    "%m/%d/%y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK}",
    "%m/%d/%Y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK}",
    "%m/%d/%y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK} [AP]M",
    "%m/%d/%Y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK} [AP]M",
    "%m/%d/%Y %H:%M": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_MINUTE}",
    "%d.%m.%Y %H:%M:%S": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{4}} {_CLOCK}",
    "%d.%m.%y %H:%M:%S": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{2}} {_CLOCK}",
    "%d.%m.%Y %H:%M": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{4}} {_MINUTE}",
    "%Y/%m/%d %H:%M:%S": rf"[0-9]{{4}}/[0-9]{{1,2}}/[0-9]{{1,2}} {_CLOCK}",
}
"""SpatialAnalyzer writes month/day/year, Leica's programs day.month.year; slashes are American."""
_OTHER_DAY = {"%m/%d": "%d/%m"}
"""What slashes mean where no month has the number that stands first."""

_PLACES = {
    "%Y": slice(4), "%y": slice(2, 4), "%m": slice(5, 7), "%d": slice(8, 10),
    "%H": slice(11, 13), "%M": slice(14, 16), "%S": slice(17, 19),
}  # fmt: skip
_EARLIEST = b"1900-01-01T00:00:00"
"""What `strptime` takes for parts that a form does not have; the others have their places in it."""
_SIXTY_NINE = b"69"
"""The first year of two digits that `strptime` takes for one of the last century."""
_FIRST, _LAST = (pa.scalar(datetime(year, 1, 1), _MOMENT) for year in (1900, 2200))
"""Between which a reading was taken; a clock that nobody has set begins in 1970 or 1980."""
_HOUR = 3_600_000_000
"""An hour [us]."""

_FRACTION = re.compile(r"(?<=:[0-9]{2})[.,]([0-9]{1,6})(?= |$)")


def form_of(cell: str) -> str | None:
    """The form in which a time is written, or None when it is none that we know."""
    bare = _FRACTION.sub("", cell.strip().lstrip(APOSTROPHE))
    for form, pattern in _FORMS.items():
        if re.fullmatch(pattern, bare):
            return form
    return None


def form_of_all(cells: Sequence[str], most: float) -> str | None:
    """The form in which so large a share of some cells are written as times, None for none.

    Slashes are American unless the numbers between them say otherwise.
    """
    form = next(filter(None, map(form_of, cells)), None)
    if form is None:
        return None
    ways = [form, *(form.replace(a, b) for a, b in _OTHER_DAY.items() if a in form)]
    fitting = [sum(_moment(cell, way) is not None for cell in cells) for way in ways]
    best = max(fitting)
    return ways[fitting.index(best)] if best >= most * len(cells) else None


def _moment(cell: str, form: str) -> datetime | None:
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


def _without_zone(found: datetime) -> datetime:
    """UTC where the zone is known, else as written."""
    return found if found.tzinfo is None else found.astimezone(UTC).replace(tzinfo=None)


def moments(cells: pa.StringArray, form: str) -> tuple[pa.TimestampArray, Bools | None]:
    """All cells as times without zone, null for none; and which had a zone, where some may."""
    try:
        bare = _bare(cells)
        return _possible(_at_once(bare if form == ISO else _as_iso(bare, form))), None
    except pa.ArrowInvalid:
        different = cells.dictionary_encode()
    found = [_moment(cell, form) for cell in different.dictionary.to_pylist()]
    values = pa.array([None if m is None else _without_zone(m) for m in found], _MOMENT)
    zoned = np.array([m is not None and m.tzinfo is not None for m in found], dtype=bool)
    return _possible(values).take(different.indices), zoned[np.asarray(different.indices)]


def _possible(found: pa.TimestampArray) -> pa.TimestampArray:
    """Null for a time at which nobody has measured anything, such as the year 0."""
    between = pc.and_(pc.greater_equal(found, _FIRST), pc.less(found, _LAST))
    return pc.if_else(between, found, pa.scalar(None, _MOMENT))


def _bare(cells: pa.StringArray) -> pa.StringArray:
    if not any(cell.startswith(APOSTROPHE) for cell in cells[:1].to_pylist()):
        return cells
    return pc.utf8_ltrim(cells, characters=APOSTROPHE)


def _at_once(cells: pa.StringArray) -> pa.TimestampArray:
    """Cells in ISO 8601, all with a zone or all without, or empty.

    Raises:
        pa.ArrowInvalid: One is of another form, or no time.
    """
    if pc.min(pc.binary_length(cells)).as_py() == 0:
        cells = pc.if_else(pc.equal(cells, ""), None, cells)
    try:
        found = cells.cast(_MOMENT)
        ticks = found.cast(pa.int64()).fill_null(1).to_numpy()
        cells = cells.filter(pa.array(ticks % _HOUR == 0))
    except pa.ArrowInvalid:
        found = cells.cast(pa.timestamp("us", "UTC")).cast(_MOMENT)
    # Arrow takes 2026-11-03 and 2026-11-03T08 for times, too
    if not np.asarray(pc.match_substring_regex(cells.drop_null(), f"^(?:{_FORMS[ISO]})$")).all():
        raise pa.ArrowInvalid("a date without a time")
    return found


def _as_iso(cells: pa.StringArray, form: str) -> pa.StringArray:
    """Cells whose parts stand in the same places, as in 11/03/26 08:00:00, as ISO 8601.

    Raises:
        pa.ArrowInvalid: One has other places or marks, or the form leaves them open.
    """
    parts = re.findall("%.|.", form)
    ends = np.cumsum([len(_EARLIEST[_PLACES.get(part, slice(1))]) for part in parts])
    written = cells.cast(pa.binary(int(ends[-1]))).buffers()[1]
    sheet = np.frombuffer(written, dtype=np.uint8).reshape(len(cells), ends[-1])
    out = np.tile(np.frombuffer(_EARLIEST, dtype=np.uint8), (len(cells), 1))
    for part, cut in zip(parts, np.split(sheet, ends[:-1], axis=1), strict=True):
        if part in _PLACES:
            out[:, _PLACES[part]] = cut
        elif part.startswith("%") or (cut != ord(part)).any():
            raise pa.ArrowInvalid("parts in no fixed places")
    if "%y" in parts:
        year = out[:, 2:4].copy().view(">u2")[:, 0]
        out[year < int.from_bytes(_SIXTY_NINE), :2] = list(b"20")
    begins = np.arange(len(out) + 1, dtype=np.int32) * len(_EARLIEST)
    return pa.StringArray.from_buffers(len(out), pa.py_buffer(begins), pa.py_buffer(out))
