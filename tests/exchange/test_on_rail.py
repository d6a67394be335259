"""An arm that ships, put on a rail by one command."""

import numpy as np
import pytest

from pipeline.app import cli
from pipeline.machine.robot import load
from pipeline.machine.robot.configuration import configure
from pipeline.machine.robot.mdh import parse

DIRECTION = {"x": (1, 0, 0), "y": (0, 1, 0), "-x": (-1, 0, 0), "-y": (0, -1, 0)}


def flange(robot, shown):
    """Position [m] and orientation of the flange for what the controller shows [m, rad]."""
    q = robot.controller_matrix @ np.array(shown) + robot.controller_offset
    here = configure(robot, q[None])
    return here.flange_origin[0], here.flange_axes[0]


@pytest.mark.parametrize("name", ["kr210_r2700_2", "irb6700_200_260", "kr120_r2700_2", "gp180"])
@pytest.mark.parametrize(
    ("way", "turn", "foot"),
    [
        ("y", 0, (0, 0, 0)),
        ("x", 90, (0.2, -0.1, 0.57)),
        ("-x", -30, (0, 0, 0.4)),
        ("-y", 180, (1, 2, 3)),
    ],
)
def test_the_flange_is_where_the_arm_stands_on_its_rail(capsys, name, way, turn, foot):
    words = [
        "robot",
        name,
        f"--rail={way}",
        "--turn",
        str(turn),
        "--foot",
        ",".join(map(str, foot)),
    ]
    assert cli._exit_code(words) == 0
    arm, railed = load(name), parse(capsys.readouterr().out, "railed.toml")
    shown = np.array([0.3, -1.1, 1.2, 0.4, -0.7, 0.9])
    at, turned = flange(arm, shown)
    angle = np.deg2rad(turn)
    Rz = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )

    place, orientation = flange(railed, [2.5, *shown])

    assert place == pytest.approx(Rz @ at + foot + 2.5 * np.array(DIRECTION[way]), abs=1e-9)
    assert orientation == pytest.approx(Rz @ turned, abs=1e-9)
    assert list(railed.controller) == ["E1", *arm.controller]


@pytest.mark.parametrize("words", [["kr500_rail", "--rail=x"], ["kr210_r2700_2", "--rail=z"],
                                   ["kr210_r2700_2", "--rail=x", "--foot", "1,2"],
                                   ["kr999", "--rail=x"]])  # fmt: skip
def test_what_cannot_be_is_refused(capsys, words):
    assert cli._exit_code(["robot", *words]) == 2
    assert capsys.readouterr().err.count("\n") <= 3
