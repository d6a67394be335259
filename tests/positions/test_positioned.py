"""Rows of positions, pose by pose."""

import re

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.positions.positioned import as_read, usable
from pipeline.reduction.settings import parse

ROBOT = load("ur10")
TOML = """\
format = 1
name = "made"
robot = "ur10"
[positions]
file = "poses.csv"
"""
HEAD = "pose,target,x_mm,y_mm,z_mm," + ",".join(f"{joint.name}_deg" for joint in ROBOT.joints)


def table(rows):
    """poses.csv of twelve poses with two targets, with further rows (pose, target, x, angle)."""
    plain = [(pose, target, 100.0 * pose, 5.0 * pose) for pose in range(1, 13) for target in "AB"]
    lines = [f"{p},{t},{x},0,0,{angle},-90,0,0,0,0" for p, t, x, angle in (*plain, *rows)]
    return "\n".join([HEAD, *lines]) + "\n"


@pytest.mark.parametrize(
    ("further", "line"), [([("B", 15.02)], 6), ([("A", 15.05), ("B", 15.02)], 26)]
)
def test_a_target_read_twice_in_a_pose_stands_where_its_last_row_has_the_robot(further, line):
    """Position, joint values, file and line are of one row, not of two."""
    rows = [(3, target, 999.0, angle) for target, angle in further]
    files = {"poses.csv": table(rows).encode()}
    said = parse(TOML)
    read = usable(said, ROBOT, *as_read(said, ROBOT, files)).readings
    k = read.pose.tolist().index(3)
    again = [target for target, _ in further]

    for target in "AB":
        at = read.at[k, read.targets.tolist().index(target), 0]
        assert at == pytest.approx(0.999 if target in again else 0.3)
    told = table(rows).splitlines()[read.line[k] - 1].split(",")
    assert read.line[k] == line
    assert np.rad2deg(read.q[k, 0]) == pytest.approx(float(told[5]))
    assert len(read) == 12


def test_ten_poses_are_enough_and_nine_are_not():
    """Tool, frame and a few entries of the table are some twenty unknowns."""
    said, lines = parse(TOML), table([]).splitlines()

    def of(poses):
        files = {"poses.csv": "\n".join(lines[: 1 + 2 * poses]).encode()}
        return usable(said, ROBOT, *as_read(said, ROBOT, files)).readings

    assert len(of(10)) == 10
    with pytest.raises(InputError, match="9 different poses are left, of at least 10"):
        of(9)


def test_a_pose_that_is_measured_again_counts_once():
    """Twelve numbers of poses with nine sets of joint values, to a hundredth of a degree."""
    alike = re.sub(r",(50|55|60)\.0,-90", ",5.01,-90", table([]))
    with pytest.raises(InputError, match="9 different poses are left, of at least 10"):
        read_with(change=lambda _: alike)


def read_with(rows=(), toml=TOML, change=lambda text: text):
    said = parse(toml)
    given = as_read(said, ROBOT, {"poses.csv": change(table(rows)).encode()})
    return usable(said, ROBOT, *given)


@pytest.mark.parametrize(
    ("rows", "lines"),
    [
        ([(3, "C", 300.0, 1.25)], [26]),
        ([(3, "C", 300.0, 1.25), (3, "D", 300.0, 1.25)], [6, 7, 26, 27]),
        ([(3.5, "C", 300.0, 15.0), (-3, "C", 300.0, 15.0)], [26, 27]),
    ],
)
def test_rows_that_contradict_their_pose_are_left_out(rows, lines):
    """Most rows of a pose decide its joint values; the number of a pose is whole."""
    read = read_with(rows)

    assert sorted(read.rejected["line"]) == lines
    assert len(read.readings) == 12 - (6 in lines)


def test_a_payload_is_known_and_that_of_the_whole_pose():
    body = "[payload.disk]\nmass_kg = 5.0\ncenter_m = [0.0, 0.0, 0.1]\n"

    def loaded(text):
        head, *lines = text.splitlines()
        names = ["disk" if k == 4 or k > 7 else "" for k in range(len(lines))]
        rows = [f"{line},{name}" for line, name in zip(lines, names, strict=True)]
        return "\n".join([f"{head},payload", *rows]) + "\n"

    assert read_with([], TOML + body, loaded).rejected["line"].tolist() == [6, 7]
    with pytest.raises(InputError, match=r'csv:6: payload "disk" is not .*\[payload."disk"\]'):
        read_with(change=loaded)


def test_a_temperature_is_that_of_a_hall():
    def warm(text):
        head, *lines = text.splitlines()
        return "\n".join(
            [f"{head},temperature_c", *(f"{one},21" for one in lines[1:]), lines[0] + ",294"]
        )

    assert read_with(change=warm).rejected["line"].tolist() == [25]


def test_a_table_of_which_no_row_can_be_read_says_why():
    """By its first row, not by what is missing then."""
    with pytest.raises(
        InputError, match=r"csv:2: theta1.* is \"\?\".*24 rows .* 0 different poses are"
    ):
        read_with(change=lambda text: re.sub(r",[0-9.]+,-90", ",?,-90", text))
