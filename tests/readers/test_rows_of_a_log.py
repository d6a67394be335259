"""Which rows of a log or an export are kept: repeated ones, numbers of poses, times, the last."""

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._log_table import Quantity, once, table, whole_numbers
from pipeline.readers._text import text

LOADS = (Quantity("pose", {}), Quantity("repeat", {}), Quantity("force", {"n": 1.0, "kn": 1e3}))
TIMED = Layout((Field("x", "number"), Field("time", "time", needed=False)), ",", 1)
PLAIN = Layout((Field("name", "name"), Field("x", "number")), ",", 1)


def log(*lines):
    return table("loads.csv", "\n".join(["pose,repeat,force_kn", *lines, ""]).encode(), LOADS)


def test_of_rows_that_contradict_each_other_none_is_kept():
    """Of equal ones the first is; a force is in newtons."""
    found = once(log("1,1,2", "1,2,3", "1,1,2", "2,1,4", "2,1,5"), ["pose", "repeat"])

    assert found.line.tolist() == [2, 3]
    assert found.number["force"].tolist() == [2000.0, 3000.0]
    assert [(line, why.partition(";")[0]) for _, line, why in found.rejected] == [
        (4, "repeats line 2"),
        (5, "lines 5, 6 contradict each other"),
        (6, "lines 5, 6 contradict each other"),
    ]


@pytest.mark.parametrize("pose", ["-1", "1.5", "3000000000"])
def test_a_pose_is_numbered_by_a_whole_number(pose):
    found = whole_numbers(log("0,1,2", f"{pose},1,2"))

    assert found.line.tolist() == [2]
    assert "pose is not a whole number" in found.rejected[0][2]


def timed(*times):
    data = "\n".join(f"{k}.5,{time}" for k, time in enumerate(times)).encode() + b"\n"
    return rows(text("tracker.csv", data), TIMED)


def test_a_row_without_a_time_has_no_zone_to_agree_with():
    """The last cell is no time, so that every cell is read by itself."""
    found = timed("2026-11-03T08:00:00Z", "", "2026-11-03T08:01:00Z", "later")

    assert found.line.tolist() == [1, 2, 3]
    assert np.asarray(found.columns["time"].is_valid()).tolist() == [True, False, True]
    with pytest.raises(InputError, match="some times have a zone and some have none"):
        timed("2026-11-03T08:00:00Z", "2026-11-03T08:01:00", "later")


@pytest.mark.parametrize(("last", "kept"), [("1.2", 6), ("1.250", 7), ("1.2500", 7)])
def test_a_file_ends_inside_a_number_with_fewer_digits_than_all_others(last, kept):
    """More digits are those of another program, or of whoever corrected the row."""
    data = "\n".join([*["P1,1.250"] * 6, f"P1,{last}"]).encode()
    found = rows(text("tracker.csv", data), PLAIN)

    assert len(found.line) == kept
    assert [why.partition(";")[0] for _, why in found.rejected] == [
        "the file ends inside this line"
    ] * (7 - kept)
