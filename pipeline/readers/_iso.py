"""Times in ISO 8601, as our own tables have them."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

ISO = "ISO 8601"
ISO_FORM = (
    r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}(:[0-9]{2}(\.[0-9]{1,9})?)?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?"
)
NO_YEAR = 1900
"""Year in which times without a date are kept: the default of `strptime`, before any tracker."""
MOMENT = pa.timestamp("us")
_FIRST, _LAST = (pa.scalar(datetime(year, 1, 1), MOMENT) for year in (NO_YEAR, 2200))
"""Limits of plausible times of a reading; a clock that was never set begins in 1970 or 1980."""
_HOUR = 3_600_000_000
"""An hour [us]."""


def possible(found: pa.TimestampArray) -> pa.TimestampArray:
    """Replace implausible times, such as those of the year 0, by null."""
    between = pc.and_(pc.greater_equal(found, _FIRST), pc.less(found, _LAST))
    return pc.if_else(between, found, pa.scalar(None, MOMENT))


def at_once(cells: pa.StringArray) -> pa.TimestampArray:
    """Convert cells in ISO 8601, all with a time zone or all without, or empty.

    Raises:
        pa.ArrowInvalid: One is in another format, or not a time.
    """
    if pc.min(pc.binary_length(cells)).as_py() == 0:
        cells = pc.if_else(pc.equal(cells, ""), None, cells)
    try:
        found = cells.cast(MOMENT)
        ticks = found.cast(pa.int64()).fill_null(1).to_numpy()
        cells = cells.filter(pa.array(ticks % _HOUR == 0))
    except pa.ArrowInvalid:
        found = cells.cast(pa.timestamp("us", "UTC")).cast(MOMENT)
    # Arrow also accepts 2026-11-03 and 2026-11-03T08 as times
    if not np.asarray(pc.match_substring_regex(cells.drop_null(), f"^(?:{ISO_FORM})$")).all():
        raise pa.ArrowInvalid("a date without a time")
    return found
