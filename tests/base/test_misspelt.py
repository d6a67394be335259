"""A misspelt key in a user's file: named with its line, and the intended key."""

import re
from importlib import resources

import pytest

from pipeline.base.errors import InputError
from pipeline.base.toml import line_of
from pipeline.machine.robot.mdh import parse as robot_of
from pipeline.reduction.settings import parse as settings_of

CAMPAIGN = """\
format = 1
name = "cell"
robot = "kr500_rail"
temperature_c = 21.5
operator = "night shift"  # [tracker] is below

[tracker]
files = ["tracker.csv"]
covariance = "none"
sigma_m = 3.0e-5

[tracker.mapping]
delimiter = ";"
comment = "#"
columns = { group = 1, target = 2, x = 3, y = 4, z = 5 }

[naming]
measured = [
    "P1",  # ]
    "P2", "P3",
]

[naming.states]
leer = "unloaded"

[base_frame]
B1 = [0.6, -0.5, -0.30]

[scale]
sigma_n = 2.0
gain_sigma = 0.001

[scale.columns]
"Kraft [kg] = " = "force_kgf"

[payload.gripper]
mass_kg = 80.0
center_m = [0.0, 0.0, 0.1]

[joints]
sigma_rad = 1e-4

[gravity]
direction = [0.0, 0.0, -1.0]

[instrument]
kind = "laser_tracker"
calibrated = 2026-01-01

[robot_unit]
serial = "12"

[[robot_unit.history]]
date = 2025-01-01
what = "gear of axis 2"

[[robot_unit.history]]
date = 2026-01-01
joints = [3]

[cell]
floor_z_m = -1.0

[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]

[tool.acceptance]
P1 = { direction = [0, 0, 1], half_angle_deg = 30 }

[[tool.capsules]]
from = [0, 0, 0]
to = [0, 0, 0.2]
radius = 0.1

[tool_uncertainty]
sigma_m = 1e-4

[test_pose]
q = [8.5, -10, 35, 39, 81, 22, -10]
force_n = [-124.5, -175.4, -209.1]

[tolerance]
deflection_mm = 0.25

[model]
equilibrium = "deformed"

[priors.joint_tilt]
odds = 2.0
"""

OWN_NAMES = {"leer", "B1", "P1", "P2", "P3"}
"""Names chosen by the user."""


def _keys(text):
    """Every key with its line number."""
    for number, line in enumerate(text.split("\n"), 1):
        if (found := re.match(r"([A-Za-z][\w.]+) = ", line)) and found[1] not in OWN_NAMES:
            yield pytest.param(number, found[1], id=f"{number}-{found[1]}")


def _misspelt(text, number, key):
    lines = text.split("\n")
    wrong = key[:2] + key[3:] if len(key) > 4 else key + "e"
    lines[number - 1] = lines[number - 1].replace(key, wrong, 1)
    return "\n".join(lines)


def test_the_campaign_is_good_as_it_stands():
    """So that only the misspelt key is refused."""
    assert settings_of(CAMPAIGN).tolerance.deflection_mm == 0.25


@pytest.mark.parametrize(("number", "key"), [*_keys(CAMPAIGN)])
def test_every_misspelt_key_of_a_campaign_is_named_with_its_line(number, key):
    """In each table, including nested ones and lists of tables, required or not."""
    with pytest.raises(InputError) as refused:
        settings_of(_misspelt(CAMPAIGN, number, key))

    said = str(refused.value)
    assert said.startswith(f"campaign.toml:{number}: ")
    assert key in said
    assert said.endswith("?") or "rename" in said


def test_every_misspelt_key_of_a_robot_is_named_with_its_line():
    """Also in a robot file, whose joints are a list of tables."""
    text = (resources.files("pipeline.machine.robot") / "kr500_rail.toml").read_text("utf-8")
    free = {"name", "axes"}  # a multi-line description may contain such words
    for one in _keys(text):
        number, key = one.values
        if key in free:
            continue
        with pytest.raises(InputError) as refused:
            robot_of(_misspelt(text, number, key), "arm.toml")

        assert str(refused.value).startswith(f"arm.toml:{number}: ")
        assert f"did you mean {key}?" in str(refused.value)


@pytest.mark.parametrize(
    ("was", "instead", "said"),
    [
        (
            "[tracker]\n",
            "[traker]\n",
            "campaign.toml:7: traker: unknown key; did you mean tracker?",
        ),
        ("[tool.acc", "[tool.ac", "tool.aceptance: unknown key; did you mean acceptance?"),
        ("half_angle_deg", "half_angle", "did you mean half_angle_deg?"),
        ("[test_pose]\n", "[test_pose]\ngain_sigma = 0\n", "it belongs to [scale]."),
        (
            "[tracker.mapping]\n",
            '[tracker.mapping]\ngroup = "G"\n',
            "tracker.mapping.group: unknown key; it belongs into columns = { group = ... }.",
        ),
        ("[test_pose]\n", "[test_pose]\ndate = 2026-01-01\n", "the top of the file"),
        ("load_point", "load_pont", "[tool] lacks load_point; is it load_pont?"),
        ("floor_z_m", "colour = [0,0,0]\nfloor_z_m", "correct it as docs/campaign.md describes."),
    ],
)
def test_what_was_meant_is_said(was, instead, said):
    """A table, a table within [tool], an inline key, a misplaced one, one unlike any."""
    with pytest.raises(InputError) as refused:
        settings_of(CAMPAIGN.replace(was, instead, 1))

    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (["robot_unit", "history", 1, "joints"], 59),
        (["robot_unit", "history", 1, "nothing"], 57),
        (["scale", "columns", "Kraft [kg] = "], 34),
        (["tracker", "mapping", "columns", "x"], 15),
        (["tool", "acceptance", "P1", "half_angle_deg"], 71),
        (["nothing"], None),
    ],
)
def test_the_line_of_an_entry_is_where_it_stands(path, line):
    """Counted by hand; for a missing entry, the table around it."""
    assert line_of(CAMPAIGN, path) == line
