"""A campaign reported while it is measured: written reading by reading, as by an instrument."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline import identify, load_campaign
from pipeline.live.command import sentences
from pipeline.live.update import Update
from pipeline.live.updates import QUIET_S, LiveState

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"
OTHERS = {f.name: f.read_bytes() for f in DEMO.iterdir() if f.name != "tracker.csv"}
TITLES, *READINGS = (DEMO / "tracker.csv").read_text().splitlines(keepends=True)
BASE = [line for line in READINGS if line.startswith("base_start")]


def of_pose(number):
    return [line for line in READINGS if line.startswith(f"pose{number:02d}")]


def table(*lines):
    return {**OTHERS, "tracker.csv": "".join([TITLES, *BASE, *lines]).encode()}


def wide(line, by_mm):
    """A reading off along y."""
    group, target, x, y, *rest = line.split(",")
    return ",".join([group, target, x, f"{float(y) + by_mm:.4f}", *rest])


def steps(number):
    """The readings of a pose, by load step."""
    groups = dict.fromkeys(line.partition(",")[0] for line in of_pose(number))
    return [[line for line in of_pose(number) if line.startswith(one)] for one in groups]


@pytest.fixture(scope="module")
def told():
    """Two poses, and a third step by step; one of its readings is off, then read again."""
    state, out, lines = LiveState("demo"), [], [*of_pose(1), *of_pose(2)]
    out.append(state.look(table(*lines), 0.0))
    first, pulled, bad = steps(3)[:3]
    bad = [wide(line, 1.3) if ",P2," in line else line for line in bad]
    right = next(line for line in steps(3)[2] if ",P2," in line)
    for now, more in enumerate([first, pulled, bad, [right]], 1):
        lines += more
        out.append(state.look(table(*lines), 8.0 * now))
    return out


@pytest.mark.whole
def test_a_pose_is_told_and_not_its_steps(told):
    assert told[0].pose == 2
    assert told[0].accepted
    assert told[1:3] == [None, None]


@pytest.fixture(scope="module")
def spoilt():
    """What is said at once of two poses and a third whose last reading is off."""
    first, pulled, bad = steps(3)[:3]
    bad = [wide(line, 1.3) if ",P2," in line else line for line in bad]
    lines = [*of_pose(1), *of_pose(2), *first, *pulled, *bad]
    return LiveState("demo").look(table(*lines), 0.0)


@pytest.mark.whole
def test_a_wide_reading_is_told_at_once_by_its_name(spoilt):
    (suspect,) = spoilt.suspects
    line = 1 + len([TITLES, *BASE, *of_pose(1), *of_pose(2), *steps(3)[0], *steps(3)[1]])

    assert suspect.where == "pose03_rep2_loaded/P2"
    assert suspect.readings == (f"tracker.csv:{line + 1}",)
    assert "1.3" in suspect.text
    assert suspect.text.endswith("Measure it again, or correct the file.")


@pytest.mark.whole
def test_a_reading_that_is_shot_again_replaces_it(told):
    (suspect,) = told[3].suspects

    assert suspect.where == "pose03_rep2_loaded/P2"
    assert not told[3].accepted
    assert not told[3].complete
    assert told[4].suspects == ()
    assert told[4].accepted


@pytest.mark.whole
def test_a_pose_is_told_when_it_is_measured_and_not_when_the_next_begins():
    """The pose in progress is not reported."""
    state, (first, *_) = LiveState("demo"), steps(2)
    assert state.look(table(*of_pose(1)), 0.0) is None

    begun = state.look(table(*of_pose(1), *first), 8.0)
    assert (begun.pose, begun.complete) == (1, True)
    done = state.look(table(*of_pose(1), *of_pose(2)), 80.0)
    assert (done.pose, done.complete, done.poses) == (2, True, 2)


@pytest.mark.whole
def test_a_pose_that_stays_as_it_is_is_told_when_nothing_comes():
    state = LiveState("demo")
    files = table(*of_pose(1))
    first = state.look(files, 0.0)

    assert first is None
    later = state.look(files, QUIET_S + 1.0)
    assert (later.pose, later.complete) == (1, False)
    assert state.look(files, 2 * QUIET_S + 2.0) is None
    ended = state.look(table(*of_pose(1), *steps(2)[0]), 3 * QUIET_S)
    assert (ended.pose, ended.complete) == (1, True)


def test_what_cannot_be_read_yet_is_no_alarm():
    state = LiveState("demo")
    files = table(*of_pose(1)[:4])

    assert state.look(files, 0.0) is None
    late = state.look(files, QUIET_S + 1.0)
    assert late.why is not None
    assert next(iter(sentences(late))).startswith("Nothing to say yet: tracker.csv")


@pytest.mark.whole
def test_the_end_is_the_run():
    files = table(*(line for k in range(1, 6) for line in of_pose(k)))
    state = LiveState("demo")
    update = state.look(files, 0.0)
    result = identify(load_campaign(files, name="demo"))

    assert [one.value for one in update.stiffness] == [one.value for one in result.stiffness]
    assert update.verdict == result.verdict
    left = [one.pose for one in update.next]
    assert sorted(left) == list(range(6, 17))
    worth = [np.inf if one.worth is None else one.worth for one in update.next]
    assert worth == sorted(worth, reverse=True)


@pytest.mark.whole
@pytest.mark.parametrize(("most_mm", "decided"), [(1.5, "pass"), (0.4, "fail"), (0.91, None)])
def test_it_ends_when_the_tolerance_is_decided(most_mm, decided):
    """The demo deflects by 0.910 mm at its test pose."""
    files = table(*(line for k in range(1, 6) for line in of_pose(k)))
    asked = f"\n[tolerance]\ndeflection_mm = {most_mm}\n".encode()
    files["campaign.toml"] += asked
    update = LiveState("demo").look(files, 0.0)

    assert update.stop.now == (decided is not None)
    if decided:
        assert update.stop.text == f"the tolerance is decided: {decided}"
        assert update.stop.saved_poses == 11


def test_an_update_is_one_line_of_json():
    one = Update(pose=3, poses=3, accepted=True)
    keys = {"pose", "accepted", "suspects", "stiffness", "next", "stop"}

    assert "\n" not in one.as_json()
    assert keys <= set(json.loads(one.as_json()))


@pytest.mark.whole
def test_the_command_follows_a_file_that_another_program_writes(tmp_path):
    folder = tmp_path / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    for name, data in OTHERS.items():
        (folder / name).write_bytes(data)
    there = folder / "tracker.csv"
    there.write_text("".join([TITLES, *BASE]))
    command = [sys.executable, "-m", "pipeline", "watch", "hall", "--live", "--json"]
    with subprocess.Popen(
        [*command, "--interval", "0.2", "--root", str(tmp_path)],
        stdout=subprocess.PIPE, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as process:  # fmt: skip
        with there.open("a") as export:
            for line in [*of_pose(1), *of_pose(2)]:
                export.write(line[:20])
                export.flush()
                time.sleep(0.01)
                export.write(line[20:])
                export.flush()
        seen = []
        while not seen or seen[-1]["pose"] != 2:
            seen.append(json.loads(process.stdout.readline()))
        process.send_signal(signal.SIGINT)
        process.wait(60)

    assert seen[-1]["accepted"]
    assert len(seen) <= 2
    assert process.returncode == 130
