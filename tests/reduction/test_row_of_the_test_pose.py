"""The row of a joint log that is the test pose has no readings, and needs none."""

import csv
import io

import pytest

from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

FILES = dict(simulate(Plan(name="s", seed=3, poses={"count": 4})).files)
AXES = [8.5, -10.0, 35.0, 39.0, 81.0, 22.0, -10.0]
"""Joint values of a pose that was not measured [m], [deg]."""


def rejected(axes, stated):
    """Rows of the joint log that are left out, where one more pose has no readings."""
    rows = list(csv.reader(io.StringIO(FILES["joints.csv"].decode())))
    row = dict.fromkeys(rows[0], "0") | dict(zip(rows[0][1:8], map(str, axes), strict=True))
    rows.append([row[title] if title != "pose" else "30" for title in rows[0]])
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    toml = FILES["campaign.toml"].decode().partition("[test_pose]")
    pose = f"\n[test_pose]\nq = {stated}\nforce_n = [0, 0, -1000]\n"
    changed = FILES | {
        "joints.csv": text.getvalue().encode(),
        "campaign.toml": (toml[0] + pose).encode(),
    }
    found = ingested(in_memory(changed)).rejected
    return found[found["file"] == "joints.csv"]["line"].tolist()


def test_what_is_asked_about_is_no_missing_measurement():
    assert rejected(AXES, AXES) == []


@pytest.mark.parametrize("joint", [0, 4])
def test_another_pose_without_readings_is(joint):
    other = list(AXES)
    other[joint] += 1.0
    assert rejected(AXES, other) == [6]
