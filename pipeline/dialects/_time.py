"""Parse times as instruments write them: recognise the format, convert cells to timestamps."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base.arrays import Bools
from pipeline.readers._iso import ISO, ISO_FORM, MOMENT, NO_YEAR, at_once, possible

APOSTROPHE = "'"
"""Leica's programs write one before a time so that Excel leaves it alone."""

_MINUTE = r"[0-9]{1,2}:[0-9]{2}"
_CLOCK = rf"{_MINUTE}:[0-9]{{2}}"
_FORMS = {
    ISO: ISO_FORM,
    "%m/%d/%y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK}",
    "%m/%d/%Y %H:%M:%S": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK}",
    "%m/%d/%y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{2}} {_CLOCK} [AP]M",
    "%m/%d/%Y %I:%M:%S %p": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_CLOCK} [AP]M",
    "%m/%d/%Y %H:%M": rf"[0-9]{{1,2}}/[0-9]{{1,2}}/[0-9]{{4}} {_MINUTE}",
    "%d.%m.%Y %H:%M:%S": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{4}} {_CLOCK}",
    "%d.%m.%y %H:%M:%S": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{2}} {_CLOCK}",
    "%d.%m.%Y %H:%M": rf"[0-9]{{1,2}}\.[0-9]{{1,2}}\.[0-9]{{4}} {_MINUTE}",
    "%Y/%m/%d %H:%M:%S": rf"[0-9]{{4}}/[0-9]{{1,2}}/[0-9]{{1,2}} {_CLOCK}",
    "%H:%M:%S": _CLOCK,
    "%I:%M:%S %p": rf"{_CLOCK} [AP]M",
    **{f"%I{mark}%M %p": rf"[0-9]{{1,2}}{re.escape(mark)}[0-9]{{2}} [AaPp][Mm]" for mark in ":."},
}
"""Known formats; SpatialAnalyzer writes month/day/year, Leica's programs day.month.year; slashes
are taken as American."""
OF_DAY = ("%H:%M:%S", "%I:%M:%S %p", "%I:%M %p", "%I.%M %p")
"""Formats without a date."""
_OTHER_DAY = {"%m/%d": "%d/%m"}
"""Alternative meaning of dates with slashes if the first number is too large for a month."""

_PLACES = {
    "%Y": slice(4), "%y": slice(2, 4), "%m": slice(5, 7), "%d": slice(8, 10),
    "%H": slice(11, 13), "%M": slice(14, 16), "%S": slice(17, 19),
}  # fmt: skip
_EARLIEST = b"1900-01-01T00:00:00"
"""Defaults of `strptime` for parts missing from a format; the template also fixes the place of each
part."""
_SIXTY_NINE = b"69"
"""First two-digit year that `strptime` assigns to the last century."""

_FRACTION = re.compile(r"(?<=:[0-9]{2})[.,]([0-9]{1,6})(?= |$)")


def shown(found: datetime | None) -> str | None:
    """A time in ISO 8601, without the date if none is known."""
    if found is None:
        return None
    return found.isoformat() if found.year > NO_YEAR else found.time().isoformat()


def form_of(cell: str) -> str | None:
    """The format of a time, or None if it is not a known one."""
    bare = _FRACTION.sub("", cell.strip().lstrip(APOSTROPHE))
    for form, pattern in _FORMS.items():
        if re.fullmatch(pattern, bare):
            return form
    return None


def first_form(cells: Iterable[str]) -> str | None:
    """The format of the first time; one with a date takes precedence over a bare time of day."""
    bare = None
    for form in filter(None, map(form_of, cells)):
        if form not in OF_DAY:
            return form
        bare = bare or form
    return bare


def form_of_all(cells: Sequence[str], most: float) -> str | None:
    """The format in which at least a fraction `most` of the cells are times, None if there is none.

    Dates with slashes are American unless their numbers contradict this: in more cells than run
    against the others if the day comes first, so that a damaged cell does not date all others anew.
    One at either end of them runs with them, and does.
    """
    form = first_form(cells)
    if form is None:
        return None
    ways = [form, *(form.replace(a, b) for a, b in _OTHER_DAY.items() if a in form)]
    every = [[at for cell in cells if (at := _moment(cell, way)) is not None] for way in ways]
    fitting = {
        w: times for w, times in zip(ways, every, strict=True) if len(times) >= most * len(cells)
    }
    return max(fitting, key=lambda way: len(fitting[way]) - _against(fitting[way]), default=None)


def _against(times: Sequence[datetime]) -> int:
    """Number of steps in time that go against the others, whether the newest is last or first."""
    steps = [*pairwise(map(_without_zone, times))]
    return min(sum(a > b for a, b in steps), sum(a < b for a, b in steps))


def _moment(cell: str, form: str) -> datetime | None:
    """The time in a cell, with its time zone if it has one; None if the format differs."""
    bare = cell.strip().lstrip(APOSTROPHE)
    written = form.replace("%d/%m", "%m/%d")
    if written in _FORMS and form_of(bare) != written:  # strptime accepts 16:38:2 as a time
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
    """Convert to UTC if the time zone is known, otherwise leave as written."""
    return found if found.tzinfo is None else found.astimezone(UTC).replace(tzinfo=None)


def moments(cells: pa.StringArray, form: str) -> tuple[pa.TimestampArray, Bools | None]:
    """Convert all cells to times without time zone.

    Returns:
        The times, null where a cell has none, and which of them had a time zone; None instead of
        the latter if they were converted at once.
    """
    try:
        bare = _bare(cells)
        return possible(at_once(bare if form == ISO else _as_iso(bare, form))), None
    except pa.ArrowInvalid:
        different = cells.dictionary_encode()
    found = [_moment(cell, form) for cell in different.dictionary.to_pylist()]
    values = pa.array([None if m is None else _without_zone(m) for m in found], MOMENT)
    zoned = np.array([m is not None and m.tzinfo is not None for m in found], dtype=bool)
    return possible(values).take(different.indices), zoned[np.asarray(different.indices)]


def _bare(cells: pa.StringArray) -> pa.StringArray:
    if not any(cell.startswith(APOSTROPHE) for cell in cells[:1].to_pylist()):
        return cells
    return pc.utf8_ltrim(cells, characters=APOSTROPHE)


def _as_iso(cells: pa.StringArray, form: str) -> pa.StringArray:
    """Convert cells whose parts are at fixed places, such as 11/03/26 08:00:00, to ISO 8601.

    Raises:
        pa.ArrowInvalid: One has other places or separators, or the places of the format vary.
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
