"""Rows of positions, pose by pose."""

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


@pytest.mark.parametrize(("further", "line"), [([("B", 1.25)], 6), ([("A", 1.5), ("B", 1.25)], 26)])
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
    with pytest.raises(InputError, match="9 poses are left, of at least 10"):
        of(9)
