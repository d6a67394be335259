"""Times as instruments write them: the moments are written out here by hand."""

from datetime import datetime

import pyarrow as pa
import pytest

from pipeline.dialects._time import form_of, form_of_all, moments

HALF_PAST = datetime(2026, 11, 3, 8, 30)


@pytest.mark.parametrize(
    "cell",
    [
        "2026-11-03T08:30:00", "2026-11-03 08:30", "11/03/26 08:30:00", "11/3/2026 8:30:00 AM",
        "03.11.2026 08:30:00", "'03.11.26 08:30:00", "2026/11/3 08:30:00", "11/03/2026 08:30",
    ],
)  # fmt: skip
def test_one_moment_in_every_form_is_one_moment(cell):
    """By itself, and beside a cell that is none."""
    times, _ = moments(pa.array([cell, "x"]), form_of(cell))

    assert times.to_pylist() == [HALF_PAST, None]


@pytest.mark.parametrize(
    "cell", ["16:38:2", "2026-11-03", "3.11.26", "yesterday", "26-11-03 08:30"]
)
def test_what_is_no_date_with_a_time_has_no_form(cell):
    """A date alone, a clock alone, or an order of parts that nobody writes."""
    assert form_of(cell) is None


def test_a_day_beyond_twelve_tells_which_number_is_the_month():
    """Slashes are American unless the numbers contradict."""
    american, european = "11/03/26 08:30:00", "25/03/26 08:30:00"

    assert form_of_all([american, american], 1.0) == "%m/%d/%y %H:%M:%S"
    form = form_of_all([american, european], 1.0)
    assert moments(pa.array([american]), form)[0].to_pylist() == [datetime(2026, 3, 11, 8, 30)]


def test_a_zone_is_taken_off_and_reported():
    """08:30 at +02:00 is 06:30 UTC; a fraction of a second stays."""
    cells = pa.array(["2026-11-03T08:30:00.25+02:00", "2026-11-03T08:30:00"])
    times, zoned = moments(cells, "ISO 8601")

    assert times.to_pylist() == [datetime(2026, 11, 3, 6, 30, 0, 250_000), HALF_PAST]
    assert zoned.tolist() == [True, False]


def test_a_clock_that_was_never_set_gives_no_time():
    """The year 0001 passes the format, and no tracker read then."""
    times, _ = moments(pa.array(["0001-01-01T00:00:00", "2026-11-03T08:30:00"]), "ISO 8601")

    assert times.to_pylist() == [None, HALF_PAST]


@pytest.mark.parametrize("way", [1, -1])
def test_a_damaged_date_does_not_date_all_others_anew(way):
    """A day above 12 settles the order of day and month only if the clock then runs one way.

    The newest row may come last or first.
    """
    day = [f"11/03/26 08:{minute:02d}:00" for minute in range(20)]
    damaged = [*day[:9], "31/03/26 08:09:00", *day[10:]]
    assert form_of_all(damaged[::way], 0.9) == "%m/%d/%y %H:%M:%S"
    days = [*day, *(f"{one}/03/26 09:{m:02d}:00" for one in (12, 13) for m in range(20))]
    assert form_of_all(days[::way], 0.9) == "%d/%m/%y %H:%M:%S"
