"""Times without a date: their day, also over midnight and in files out of order."""

import datetime

import pandas as pd
import pytest

from pipeline import readers
from pipeline.answer.inputs import measured_on
from pipeline.dialects.times_of_day import on_days
from pipeline.intake.inspect import as_csv, inspect
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

DAY = datetime.date(2026, 9, 11)


def export(name, *times):
    rows = [f"R{k};{k},1;{k},2;{k * k},3;{time}" for k, time in enumerate(times, 1)]
    text = "\n".join(["Point;X (mm);Y (mm);Z (mm);Heure", *rows, ""])
    return readers.read(name, text.encode())


def days(exports, date):
    return {
        name: [t.isoformat() for t in one.time.to_pylist()]
        for name, one in on_days(exports, date).items()
    }


def test_a_fall_is_a_midnight_and_a_round_may_come_early():
    """The round after all poses precedes them by name; it is on the day after the night."""
    exports = {
        "base_a": export("base_a", "21:50:00", "21:51:00", "21:52:00"),
        "base_z": export("base_z", "02:00:00", "02:01:00", "02:02:00"),
        "pose1": export("pose1", "22:10:00", "23:59:59", "00:00:10"),
        "pose2": export("pose2", "01:00:00", "01:01:00", "01:00:30"),
    }
    found = days(exports, DAY)

    assert found["base_a"][0] == "2026-09-11T21:50:00"
    assert found["base_z"][0] == "2026-09-12T02:00:00"
    assert found["pose1"][0] == "2026-09-11T22:10:00"
    assert found["pose1"][2] == "2026-09-12T00:00:10"
    assert found["pose2"] == [f"2026-09-12T01:0{k}" for k in ("0:00", "1:00", "0:30")]


def test_the_first_day_is_stated_even_if_its_file_comes_last():
    """`after` comes before `before`; dates of other exports stand in for a missing statement."""
    night = {
        "after": export("after", "00:30:00", "00:31:00", "00:32:00"),
        "before": export("before", "23:30:00", "23:31:00", "23:32:00"),
    }
    other = export("z", *[f"2026-09-14 08:0{k}:00" for k in range(3)])

    assert days(night, DAY)["before"][0] == "2026-09-11T23:30:00"
    assert days(night, DAY)["after"][0] == "2026-09-12T00:30:00"
    assert days({**night, "z": other}, None)["before"][0] == "2026-09-14T23:30:00"


def test_no_date_is_made_up():
    """Without a date `inspect` shows times of day, and no answer says when it was measured."""
    text = b"Point;X (mm);Y (mm);Z (mm);Heure\nA;1,5;2,5;3,5;08:04:12\nB;4,5;5,5;7,5;08:05:00\n"
    seen = inspect("t.txt", text)
    readings = pd.DataFrame({"time": pd.to_datetime(["1900-01-01T08:04:12"])})
    settings = in_memory(simulate(Plan()).files).settings

    assert (seen.time_first, seen.time_last) == ("08:04:12", "08:05:00")
    assert b"1900" not in as_csv("t.txt", text)
    assert measured_on(settings.model_copy(update={"name": "x", "date": None}), readings) is None


@pytest.mark.parametrize("cell", ["08:04:12", "8:04:12 AM"])
def test_a_bare_time_of_day_among_dates_is_damaged(cell):
    """The form is that of the dates, wherever the damaged row is."""
    found = export("t", cell, *[f"2026-09-11 08:0{k}:00" for k in range(9)])

    assert found.line.tolist() == [*range(3, 12)]


def test_a_year_that_comes_first_is_followed_by_its_month():
    """Also below titles of a language that writes the day first: the seventh of October."""
    found = export("a", "2026/10/7 09:04:11", "2026/10/7 09:05:00").time.to_pylist()

    assert [one.isoformat() for one in found] == ["2026-10-07T09:04:11", "2026-10-07T09:05:00"]
