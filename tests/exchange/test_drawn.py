"""Drawings of the robots that ship."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from pipeline.app import cli
from pipeline.exchange.drawn import drawing
from pipeline.machine.robot import SHIPPED, load

SVG = "{http://www.w3.org/2000/svg}"


def typed(*words):
    with pytest.raises(SystemExit) as end:
        cli.main(list(words))
    return end.value.code


def points(svg):
    """Vertices of each arm [px], foot first."""
    lines = ET.fromstring(svg).iter(f"{SVG}polyline")
    return [np.array(re.findall(r"[-.0-9]+", one.get("points")), float).reshape(-1, 2)
            for one in lines]  # fmt: skip


def test_a_kr210_is_drawn_with_its_published_lengths():
    """Stretched forward at zero: 0.330 m to axis 2, arms of 1.150 and 1.220 m, 0.215 m more.

    Axis 2 is 0.645 m high, and the wrist 0.115 m above it.
    """
    (arm,) = points(drawing([load("kr210_r2700_2")]))
    reach, height = np.ptp(arm, axis=0)
    metre = reach / (0.330 + 1.150 + 1.220 + 0.215)

    assert height / metre == pytest.approx(0.645 + 0.115, abs=0.01)
    assert np.abs(arm[2, 0] - arm[1, 0]) / metre == pytest.approx(0.330, abs=0.01)


def test_all_are_drawn_to_one_scale():
    """Every robot that ships once, by name, with its true relative size."""
    svg = drawing([load(name) for name in SHIPPED])
    arms = dict(zip(SHIPPED, points(svg), strict=True))
    words = {one.text for one in ET.fromstring(svg).iter(f"{SVG}text")}
    wide = {name: np.ptp(arms[name][:, 0]) for name in ("kr210_r3100_2", "kr210_r2700_2")}

    assert set(SHIPPED) <= words
    longer = (0.330 + 1.350 + 1.420 + 0.215) / (0.330 + 1.150 + 1.220 + 0.215)
    assert wide["kr210_r3100_2"] / wide["kr210_r2700_2"] == pytest.approx(longer, abs=0.01)


def test_a_drawing_is_a_new_file(tmp_path, capsys):
    """Of a maker's robots or of one.

    No file is overwritten, and nothing is drawn without a robot.
    """
    path = tmp_path / "kuka.svg"

    assert typed("robot", "kuka", "--list", "--draw", str(path)) == 0
    assert len(points(path.read_text())) > 3
    assert typed("robot", "--list", "--draw", str(path)) == 2
    assert typed("robot", "--show", "ur10e", "--draw", str(tmp_path / "u.svg")) == 0
    assert len(points((tmp_path / "u.svg").read_text())) == 1
    for words in (["--show", "ur1o"], ["nobody", "--list"], []):
        assert typed("robot", *words, "--draw", str(tmp_path / "x.svg")) == 2
    assert typed("robot", "--list", "--draw", str(tmp_path / "x.png")) == 2
    assert not (tmp_path / "x.svg").exists()
    capsys.readouterr()
