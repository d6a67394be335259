"""Remarks on campaign.toml beside positions."""

import numpy as np
import pytest
from test_positioned import HEAD, ROBOT, TOML

from pipeline.positions import checked
from pipeline.positions.positioned import as_read, usable
from pipeline.positions.remarks import remarks
from pipeline.reduction.settings import parse
from pipeline.store.campaign import in_memory

TRIPLE = {"A": (0.1, 0.0, 0.0), "B": (0.0, 0.2, 0.0), "C": (0.0, 0.0, 0.15)}
PLACED = "[tool]\n" + "".join(f"{name} = {list(at)}\n" for name, at in TRIPLE.items())
ENTRIES = {
    "[base_frame]": "[base_frame]\nB1 = [1.0, 2.0, 0.0]\n",
    "[anchors]": "[anchors]\nK1 = [1.0, 2.0, 0.0]\n",
    "[base_frame_uncertainty]": "[base_frame_uncertainty]\nsigma_m = 1e-4\n",
    "[naming]": '[naming]\nmeasured = ["A", "B"]\n',
    "[joints]": '[joints]\nfile = "joints.csv"\n',
    "[tool_uncertainty]": "[tool_uncertainty]\nsigma_m = 1e-4\n",
    "[test_pose]": "[test_pose]\nq = [0, -90, 0, 0, 0, 0]\nforce_n = [0, 0, 100]\n",
    "[model]": '[model]\nequilibrium = "deformed"\n',
    "[priors]": "[priors.link_bending]\nodds = 2.0\n",
}


def table():
    """Three targets on one effector, turned with the first joint, in twelve poses."""
    rows = []
    for pose in range(12):
        angle = np.deg2rad(5.0 * pose)
        R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                      [0, 0, 1]])  # fmt: skip
        for name, at in TRIPLE.items():
            place = ",".join(f"{x:.4f}" for x in 1e3 * (R @ at + [0.5, 0.1, 0.3]))
            rows.append(f"{pose + 1},{name},{place},{5 * pose},-90,0,0,0,0")
    return "\n".join([HEAD, *rows, ""]).encode()


def told(toml):
    said = parse(TOML + toml)
    given = as_read(said, ROBOT, {"poses.csv": table()})
    return [*remarks(said, usable(said, ROBOT, *given).readings)]


@pytest.mark.parametrize("name", ENTRIES)
def test_a_table_that_serves_pulls_alone_is_told(name):
    """In one sentence with its name; one that is used is not."""
    (sentence,) = told(ENTRIES[name] + PLACED)

    assert sentence.startswith(f"{name} of campaign.toml is not used")


def test_several_are_told_together():
    (sentence,) = told(ENTRIES["[base_frame]"] + ENTRIES["[anchors]"])

    assert sentence.startswith("[base_frame], [anchors] of campaign.toml are not used: they")
    assert sentence.endswith("add [tracker] if something was pulled")


def test_what_is_used_is_not_told():
    """Gravity, payloads, the instrument and points where the readings have them."""
    more = '[gravity]\ndirection = [0, 0, -1]\n[instrument]\nkind = "camera"\n'
    more += "[payload.p]\nmass_kg = 1.0\ncenter_m = [0, 0, 0.1]\n"

    assert told(PLACED + more) == []
    assert told("") == []


@pytest.mark.parametrize(
    "points",
    [
        [[0.1, 0.0, 0.0]] * 3,
        [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0]],
        [[100.0e-3, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.0]],
    ],
    ids=["one point", "one line", "one wrong"],
)
def test_points_that_are_not_as_far_apart_as_their_readings_are_told(points):
    """With both distances and the way out."""
    tool = "".join(f"{name} = {at}\n" for name, at in zip("ABC", points, strict=True))
    (sentence,) = told("[tool]\n" + tool)

    assert "mm apart, and their readings" in sentence
    assert "correct their coordinates" in sentence


def test_check_tells_them(monkeypatch):
    """As notes and complaints; they are no reason to reject the campaign."""
    monkeypatch.setattr(checked, "position_rows", lambda sheet: ([], sheet))
    text = (TOML + ENTRIES["[anchors]"] + PLACED).encode()
    found = checked.of_positions("made", in_memory({"campaign.toml": text, "poses.csv": table()}))

    assert any("[anchors] of campaign.toml is not used" in one for one in found.complaints)
    assert any("[anchors]" in one for one in found.content["notes"])
    assert found.exit_code == 0
