"""Joints beyond the limits of the robot file: reported, or the pose is left out."""

import re

import numpy as np
import pytest
from small_case import PLAN

from pipeline.base.errors import InputError
from pipeline.check.findings import limit_findings
from pipeline.machine.robot import load
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import simulate
from pipeline.store.campaign import in_memory

FILES = simulate(PLAN, np.random.default_rng(3)).files


def narrow(theta3_upper=130.0, rail_upper=18.0):
    """The campaign with a robot of other limits."""
    text = load("kr500_rail").text
    for old, new in (
        ("upper_deg = 130.0", f"upper_deg = {theta3_upper!r}"),
        ("upper_m = 18.0", f"upper_m = {rail_upper!r}"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    settings = FILES["campaign.toml"].replace(b'"kr500_rail"', b'"robot.toml"')
    return FILES | {"campaign.toml": settings, "robot.toml": text.encode()}


def logged(name):
    """A joint's values in the log, with their lines."""
    head, *rows = FILES["joints.csv"].decode().splitlines()
    column = head.split(",").index(name)
    return [float(row.split(",")[column]) for row in rows]


def read(files, plausible):
    """As `check` and `run` read it."""
    return ingested(in_memory(files), plausible=plausible)


@pytest.mark.parametrize("plausible", [True, False])
@pytest.mark.parametrize(
    ("limit", "column", "leeway"),
    [("theta3_upper", "theta3_deg", 1.0), ("rail_upper", "r1_m", 0.0174)],
)
def test_a_joint_a_little_beyond_is_told_and_one_far_beyond_costs_its_pose(
    plausible, limit, column, leeway
):
    """Up to 1 deg, or its displacement at a metre, the pose is used and reported."""
    values = logged(column)
    top, line = max(values), 2 + int(np.argmax(values))
    near = read(narrow(**{limit: top - 0.9 * leeway}), plausible)
    far = read(narrow(**{limit: top - 1.1 * leeway}), plausible)

    (told,) = limit_findings(near)
    assert f"joints.csv:{line}: pose {line - 1}: joint {column.split('_')[0]} is at" in told
    assert len(near.joints) == len(values)
    assert not len(near.rejected)
    gone = far.rejected[far.rejected["file"] == "joints.csv"]
    assert gone["line"].tolist() == [line]
    assert set(far.joints["pose"]) == set(range(1, len(values) + 1)) - {line - 1}
    assert set(far.loads["pose"]) == set(far.joints["pose"])
    assert far.rejected["reason"].str.contains("outside its limits").all()
    assert limit_findings(far) == []


def test_a_robot_that_can_take_no_pose_stops_the_campaign():
    """No pose is left, and the reason is the limit with its line."""
    with pytest.raises(InputError, match=r"joints\.csv:2: pose 1: joint theta3 .*outside its"):
        read(narrow(theta3_upper=-19.0), plausible=True)


def flipped(pose, joint):
    """The campaign with the sign of one joint of one pose reversed in the log."""
    head, *rows = FILES["joints.csv"].decode().splitlines()
    k = head.split(",").index(joint)
    cells = rows[pose - 1].split(",")
    cells[k] = f"{-float(cells[k])}"
    rows[pose - 1] = ",".join(cells)
    return "\n".join([head, *rows, ""]).encode()


@pytest.mark.whole
def test_a_row_that_no_robot_can_take_and_its_readings_contradict_is_a_mistake():
    """A missing sign is a mistake with its line, not a pose that is quietly missing."""
    values = logged("theta3_deg")
    pose = 1 + int(np.argmax(values))
    text = load("kr500_rail").text
    lower = re.search(r'name = "theta3".*?lower_deg = (-?[\d.]+)', text, re.S).group(1)
    robot = text.replace(f"lower_deg = {lower}", f"lower_deg = {min(values) - 2.0}", 1)
    assert -max(values) < min(values) - 4
    settings = FILES["campaign.toml"].replace(b'"kr500_rail"', b'"robot.toml"')
    files = FILES | {
        "campaign.toml": settings,
        "robot.toml": robot.encode(),
        "joints.csv": flipped(pose, "theta3_deg"),
    }

    said = campaign_answer("flipped", in_memory(files)).answer

    assert said.diagnosis.verdict == "bad_data"
    (cause,) = [one for one in said.diagnosis.causes if one.name == "outlier"]
    assert cause.readings == (f"joints.csv:{pose + 1}",)
    assert any(one.line == pose + 1 for one in said.rejected)
