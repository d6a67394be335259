"""Blunders change the written files exactly as the truth states, and nothing else."""

import csv
import io
import tomllib

import numpy as np
import pytest

from pipeline.base.errors import UsageError
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.simulate import plant, revised, simulate

XYZ = ("x_mm", "y_mm", "z_mm")


@pytest.fixture
def wrong(small_plan):
    """The small campaign with one blunder in it."""
    return lambda words: simulate(revised(small_plan, {"hidden": {"effects": [words]}}))


def rows(campaign, file="tracker.csv"):
    """The rows of a written CSV file."""
    return list(csv.DictReader(io.StringIO(campaign.files[file].decode())))


def numbers(campaign, file, columns):
    """Some columns of a written file."""
    return np.array([[float(row[column]) for column in columns] for row in rows(campaign, file)])


def changed(one, two):
    """Names of the files that differ."""
    return {name for name in one.files if one.files[name] != two.files[name]}


@pytest.mark.parametrize("place", ["", ":pose03_rep2_loaded/P2"])
def test_an_outlier_moves_one_reading(small_campaign, wrong, place):
    """One reading is off by the requested size; the truth names it."""
    campaign = wrong(f"outlier{place}=5e-4")
    moved = numbers(campaign, "tracker.csv", XYZ) - numbers(small_campaign, "tracker.csv", XYZ)
    hit = np.flatnonzero(np.abs(moved).max(axis=1))
    said = campaign.truth["effects"][0]

    assert len(hit) == 1
    assert np.linalg.norm(moved[hit]) == pytest.approx(0.5, abs=2e-4)  # mm, four decimals
    row = rows(campaign)[hit[0]]
    assert said["where"] == f"{row['group']}/{row['target']}"
    assert place in ("", f":{said['where']}")
    assert said["parameters"] == [{"name": "size", "unit": "m", "value": 5e-4}]
    assert changed(campaign, small_campaign) == {"tracker.csv"}


@pytest.mark.parametrize("blunder", ["failed_lock", "stale"])
@pytest.mark.parametrize("place", ["", ":base_end/B2", ":pose03_rep2_loaded/Pl2"])
def test_a_reading_that_was_not_taken_is_written(small_campaign, wrong, blunder, place):
    """The origin or the previous row; in the truth it is an outlier without a size."""
    campaign = wrong(f"{blunder}{place}")
    was, now = (numbers(c, "tracker.csv", XYZ) for c in (small_campaign, campaign))
    (hit,) = np.flatnonzero(np.abs(now - was).max(axis=1))
    row, said = rows(campaign)[hit], campaign.truth["effects"][0]

    assert (said["name"], said["parameters"]) == ("outlier", [])
    assert said["where"] == f"{row['group']}/{row['target']}"
    assert place in ("", f":{said['where']}")
    assert now[hit] == pytest.approx(np.zeros(3) if blunder == "failed_lock" else was[hit - 1])


def test_the_first_reading_repeats_none(wrong):
    """Nothing was read before it."""
    with pytest.raises(UsageError, match='nothing was read before "base_start/B1"'):
        wrong("stale:base_start/B1")


def test_a_label_swap_exchanges_two_names_of_one_group(small_campaign, wrong):
    """Coordinates stay; two targets of the named group have exchanged names."""
    campaign = wrong("label_swap")
    pairs = list(zip(rows(small_campaign), rows(campaign), strict=True))
    other = [(a, b) for a, b in pairs if a != b]

    assert {a["group"] for a, _ in other} == {campaign.truth["effects"][0]["where"]}
    assert [(a["target"], b["target"]) for a, b in other] == [
        (b["target"], a["target"]) for a, b in reversed(other)
    ]
    assert len(other) == 2
    assert all(a[axis] == b[axis] for a, b in pairs for axis in XYZ)


@pytest.mark.parametrize(
    ("where", "file", "columns", "ratio"),
    [
        ("inch", "tracker.csv", XYZ, 1 / 25.4),
        ("m", "tracker.csv", XYZ, 1 / 1000),
        ("kgf", "loads.csv", ["force_n"], 1 / 9.80665),
        ("lbf", "loads.csv", ["force_n"], 0.2248089431),
        ("rad", "joints.csv", [f"theta{j}_deg" for j in range(2, 8)], np.pi / 180),
    ],
)
def test_a_unit_mixup_scales_one_file(small_campaign, wrong, where, file, columns, ratio):
    """The numbers are those of the other unit, under the old name."""
    campaign = wrong(f"unit_mixup:{where}")
    was, now = (numbers(c, file, columns) for c in (small_campaign, campaign))

    assert now == pytest.approx(was * ratio, abs=6e-3 if file == "loads.csv" else 6e-5)
    carriage = [[row["r1_m"] for row in rows(c, "joints.csv")] for c in (small_campaign, campaign)]
    assert carriage[0] == carriage[1]
    assert changed(campaign, small_campaign) == {file}


def test_controller_axes_stand_where_joint_angles_should(small_campaign, wrong):
    """Theta2 = -A1, theta3 = -A2, theta4 = 90 deg - A3, theta5..7 = -A4..-A6 of the KUKA."""
    campaign = wrong("sign_or_convention:controller_axes")
    columns = ["r1_m", *(f"theta{j}_deg" for j in range(2, 8))]
    theta, axes = (numbers(c, "joints.csv", columns).T for c in (small_campaign, campaign))

    assert axes == pytest.approx(
        np.stack([theta[0], -theta[1], -theta[2], 90 - theta[3], *-theta[4:]]), abs=2e-6
    )


def test_other_conventions_are_broken_as_named(small_campaign, wrong):
    """A left-handed tracker, a reversed pull, the robot with the other sign of d_5."""
    was = numbers(small_campaign, "tracker.csv", XYZ)
    left, reversed_pull, other_robot = (
        wrong(f"sign_or_convention:{where}") for where in ("left_handed", "pull_reversed", "d_5")
    )

    assert np.array_equal(numbers(left, "tracker.csv", XYZ), was * [1, -1, 1])
    assert np.array_equal(numbers(reversed_pull, "tracker.csv", XYZ), was)
    assert [
        (a["target"], b["target"])
        for a, b in zip(rows(small_campaign), rows(reversed_pull), strict=True)
        if a != b
    ] == [("Pl1", "Pl2"), ("Pl2", "Pl1")] * 21
    assert changed(other_robot, small_campaign) == {"campaign.toml"}
    assert b'robot = "kr500_rail_kuka"' in other_robot.files["campaign.toml"]


def test_modified_parameters_are_entered_as_standard_ones(small_campaign, wrong):
    """The robot file keeps every number; its lengths are under the classic letters."""
    campaign = wrong("sign_or_convention:modified_dh")
    was = tomllib.loads(load("kr500_rail").text)
    now = tomllib.loads(campaign.files["robot.toml"].decode())
    lengths = [(row["a_m"], row["d_m"]) for row in now["joint"]]

    assert (was["convention"], now["convention"]) == ("khalil", "standard")
    assert lengths == [(row.get("d_m", 0), row.get("r_m", 0)) for row in was["joint"]]
    assert changed(small_campaign, campaign) == {"campaign.toml"}
    assert campaign.truth["effects"][0]["where"] == "modified_dh"


def test_blunders_and_effects_mix(small_plan):
    """Several things at once are all in the truth, in the words of result.json."""
    words = ["rail_roll=2x", "outlier", "tracker_drift(warm-up)", "joint_tilt:2=1e-7,2e-7"]
    truth = simulate(revised(small_plan, {"hidden": {"effects": words}})).truth
    effects = {effect["name"]: effect for effect in truth["effects"]}
    typical = plant("rail_roll", load("kr500_rail"))

    assert set(effects) == {"rail_roll", "outlier", "tracker_drift", "joint_tilt"}
    assert effects["rail_roll"]["parameters"][0]["value"] == 2 * typical.values[0]
    assert effects["joint_tilt"]["where"] == 2
    assert [p["value"] for p in effects["joint_tilt"]["parameters"]] == [1e-7, 2e-7]
    assert effects["tracker_drift"]["parameters"][0]["name"] == "a_x"


def test_the_first_form_of_an_effect_is_meant():
    """A name without a form means the first form in the catalogue."""
    robot = load("kr500_rail")
    first = next(e for e in catalogue(robot) if e.name == "rail_backlash")
    others = [e for e in catalogue(robot) if e.name == "rail_backlash" and e is not first]

    assert plant("rail_backlash", robot).effect.form == first.form
    assert [plant(f"rail_backlash({e.form})", robot).effect.form for e in others] == [
        e.form for e in others
    ]
    assert others


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("outlier:pose99_rep1_loaded/P1", "choose from base_start/B1"),
        ("unit_mixup:stone", "choose from inch, m, kgf"),
        ("unit_mixup:kgf=3", "it has no size"),
        ("joint_tilt:2=1e-7", "give one number for each"),
        ("rail_roll=twice", "2x for twice"),
    ],
)
def test_a_wrong_place_or_size_is_answered_with_the_right_ones(wrong, words, said):
    """The message lists the valid words."""
    with pytest.raises(UsageError, match=said):
        wrong(words)
