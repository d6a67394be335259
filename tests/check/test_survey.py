"""What a campaign contains before anything is computed: its clock, its poses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.check.survey import clock, misshapen, stands
from pipeline.machine.effect import Pulls


def case(minutes, files="a"):
    """A campaign whose readings are so many minutes after eight, one pose each."""
    time = pd.Timestamp("2026-11-03 08:00") + pd.to_timedelta(minutes, unit="min")
    table = {"time": time, "group": [f"pose{k}" for k in range(len(minutes))], "file": [*files]}
    readings = pd.DataFrame(table | {"pose": np.arange(1.0, len(minutes) + 1)})
    return SimpleNamespace(readings=readings)


def test_the_longest_pause_is_named_by_what_follows_it():
    """Forty minutes before the third; nothing runs backwards."""
    seen = clock(case([0, 5, 45, 50], "aaaa"), {})

    assert (seen.first.minute, seen.last.minute) == (0, 50)
    assert seen.pause == pd.Timedelta(minutes=40)
    assert seen.before == "pose2"
    assert seen.backwards == 0


def test_a_reading_is_backwards_within_its_own_file_only():
    """A second export that begins earlier is no fault of its clock."""
    assert clock(case([0, 5, 2, 7], "aabb"), {}).backwards == 0
    assert clock(case([0, 5, 2, 7], "aaaa"), {}).backwards == 1


class Campaign(SimpleNamespace):
    """Tables of a campaign, of which results are cached."""

    __hash__ = object.__hash__


@pytest.mark.parametrize(("wrong", "found"), [([2], ["z2"]), ([0, 1, 2], [])])
def test_one_state_of_another_unit_is_set_apart_and_not_most_of_them(wrong, found):
    """A file in metres among four, its reflectors a thousandth as far apart as stated."""
    tool = {"P1": (0.2, 0.0, 0.1), "P2": (-0.1, 0.2, 0.1), "P3": (-0.1, -0.2, 0.2)}
    rows = [
        {"group": f"z{k}", "pose": k + 1.0, "target": name, "state": "unloaded"}
        | dict(
            zip(("x_m", "y_m", "z_m"), (1e-3 if k in wrong else 1.0) * np.array(at), strict=True)
        )
        for k in range(4)
        for name, at in tool.items()
    ]
    one = Campaign(
        readings=pd.DataFrame(rows),
        settings=SimpleNamespace(tool=tool, measured=tuple(tool)),
        joints=pd.DataFrame({"pose": [1, 2, 3, 4]}),
    )

    assert misshapen(one, 0.02) == found


@pytest.mark.parametrize(("hours", "told"), [(0, {}), (1, {"loads.csv": pd.Timedelta(hours=1)})])
def test_a_log_whose_clock_is_an_hour_off_is_listed(hours, told):
    """A time zone apart; logs without times are not compared."""
    rows = [f"{k},{pd.Timestamp('2026-11-03') + pd.Timedelta(hours=8 + hours, minutes=5 * k)}"
            for k in (1, 2, 3)]  # fmt: skip
    logs = {"loads.csv": "\n".join(["pose,time", *rows]).encode(), "joints.csv": b"pose\n1\n2\n3\n"}

    assert clock(case([5, 10, 15], "aaa"), logs).away == told


def test_without_times_there_is_no_clock():
    """As in exports of many programs."""
    given = case([0, 1], "aa")
    given.readings["time"] = pd.NaT

    assert clock(given, {}) is None


def test_every_pose_has_its_smallest_and_largest_force():
    """In the order of the poses, however the pulls are ordered."""
    force = np.array([[3.0, 4.0, 0.0], [0, 0, 1.0], [6.0, 8.0, 0.0]])
    pulls = replace(Pulls.at(np.array([[2.0], [1.0], [2.0]]), force), pose=np.array([2, 1, 2]))
    first, second = stands(SimpleNamespace(pulls=pulls))

    assert (first.pose, first.pulls, first.least_n, first.most_n) == (1, 1, 1.0, 1.0)
    assert (second.pose, second.pulls, second.least_n, second.most_n) == (2, 2, 5.0, 10.0)
    assert second.q == [2.0]
