"""A campaign that is watched in the browser while it is measured."""

import json
import time

import pytest
from test_server import DEMO, client, drop, outside  # noqa: F401  # fixtures

from pipeline.page import drawing

TITLES, *READINGS = (DEMO / "tracker.csv").read_text().splitlines(keepends=True)


def measured(poses):
    """The export when so many poses are measured."""
    base = [line for line in READINGS if line.startswith("base_start")]
    some = [line for line in READINGS if line[:4] == "pose" and int(line[4:6]) <= poses]
    return "".join([TITLES, *base, *some])


@pytest.mark.whole
def test_poses_that_come_are_shown_until_it_is_stopped(client, tmp_path):  # noqa: F811
    drop(client, *(DEMO / one for one in ("loads.csv", "joints.csv", "campaign.toml")))
    export = tmp_path / "data" / "raw" / "hall" / "tracker.csv"
    assert "Not watching" in client.get("/c/hall/live").text
    export.write_text(measured(2))
    client.post("/c/hall/live", content="{}")

    now = until(client, lambda now: now["told"] > 0)
    assert "Pose 2 accepted" in now["html"]
    assert "<polyline" in now["html"]
    assert "pose 2" not in now["html"]

    bad = measured(3).replace("pose03_rep2_loaded,P2,", "pose03_rep2_loaded,P2,9")
    export.write_text(bad)
    now = until(client, lambda now: now["suspects"] == 1)
    assert "pose03_rep2_loaded/P2" in now["html"]

    client.post("/c/hall/live/stop", content="{}")
    assert not until(client, lambda now: not now["running"])["running"]


def until(client, met):  # noqa: F811
    """What is shown once it is so."""
    for _ in range(600):
        now = client.get("/c/hall/live/now").json()
        if met(now):
            return now
        time.sleep(0.1)
    raise AssertionError(json.dumps(now)[:500])


def test_a_joint_that_is_not_determined_has_no_curve():
    axis = {"axis": "<A1>", "relative_std": 0.1}
    update = {"poses": 2, "stiffness": [axis, {"axis": "E1", "relative_std": None}]}
    drawn = drawing.curves([update, {**update, "poses": 3}, {"poses": 0}])

    assert drawn.count("<polyline") == 1
    assert "&lt;A1&gt;" in drawn
    assert "E1" not in drawn
    assert drawing.curves([]) == ""
