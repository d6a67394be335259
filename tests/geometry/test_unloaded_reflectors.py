"""Positions of the unloaded reflectors: errors of joint zeros and base frame in the raw files."""

import io
import tomllib
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from bench.league.hidden import SECRETS
from bench.league.play import Rules, drawn, play
from pipeline.machine.robot import load
from pipeline.run import campaign_answer
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.store import campaign


@cache
def clean():
    """Raw files of a robot without hidden causes, with a tool wrong by 0.2 mm."""
    plan = Plan(poses={"count": 12}, pulls={"steps_n": [1500, 3000]}, hidden={"tool_sd_m": 2e-4})
    return simulate(plan, np.random.default_rng(31)).files


def answer(files):
    """result.json of a campaign."""
    return campaign_answer("here", campaign.in_memory(files)).answer


def said(files):
    """`diagnosis` of a campaign's answer."""
    return answer(files).diagnosis


def logged(**off_deg):
    """The files with the joint log wrong by some degrees."""
    joints = pd.read_csv(io.BytesIO(clean()["joints.csv"]))
    for name, degrees in off_deg.items():
        joints[name] += degrees
    return clean() | {"joints.csv": joints.to_csv(index=False).encode()}


@pytest.mark.whole
def test_a_wrong_joint_zero_is_named_with_its_size():
    """The log of joint 3 is 0.1 degrees too large; the displacements would not show it."""
    found = said(logged(theta3_deg=0.1))

    assert found.verdict == "explained"
    (cause,) = found.causes
    assert (cause.name, cause.where) == ("joint_offset", 3)
    (size,) = cause.parameters
    assert size.std < 1e-5
    assert size.value == pytest.approx(-np.deg2rad(0.1), abs=4 * size.std)
    assert cause.gain.of == "unloaded positions"
    assert cause.gain.ci95[0] > 0.9
    assert not any(s.name == "joint_offset" and s.where == 3 for s in found.blind_spots)


@pytest.mark.slow
def test_two_wrong_zeros_are_both_named():
    """Joints 3 and 5 at once; the springs fit better at the true joint values."""
    whole = answer(logged(theta3_deg=-0.2, theta5_deg=0.4))
    found = whole.diagnosis

    assert whole.fit.chi2 < whole.joint_springs.fit.chi2 - 1
    assert found.verdict == "explained"
    assert {(c.name, c.where) for c in found.causes} == {
        ("joint_offset", 3),
        ("joint_offset", 5),
    }


@pytest.mark.slow
def test_a_base_frame_that_is_turned_is_named():
    """The nominal base reflectors are rotated by 1.5 mrad about an oblique axis."""
    turn = 1.5e-3 * np.array([0.6, 0.0, 0.8])
    files = dict(clean())
    text = files["campaign.toml"].decode()
    for name, point in tomllib.loads(text)["base_frame"].items():
        turned = Rotation.from_rotvec(turn).apply(point)
        line = next(row for row in text.splitlines() if row.startswith(f"{name} ="))
        text = text.replace(line, f"{name} = {turned.tolist()}")
    files["campaign.toml"] = text.encode()

    found = said(files)

    assert [c.name for c in found.causes] == ["base_rotation"]
    for size, true in zip(found.causes[0].parameters, turn, strict=True):
        assert size.value == pytest.approx(true, abs=4 * size.std + 2e-6)


@pytest.mark.slow
def test_a_robot_off_its_table_everywhere_is_not_accused():
    """All joint zeros wrong by half a milliradian: usual for robots, and no cause is accused."""
    off = dict(
        zip(
            ["theta2", "theta3", "theta4", "theta5", "theta6"],
            np.array([0.03, -0.025, 0.03, -0.04, 0.035]),
            strict=True,
        )
    )
    found = said(logged(**{f"{name}_deg": degrees for name, degrees in off.items()}))

    assert found.verdict == "adequate"
    assert not found.causes
    assert found.unloaded_off_mm[0] > 0.3
    assert any(s.name == "joint_offset" for s in found.blind_spots)


@pytest.mark.whole
def test_an_innocent_robot_has_no_blind_spot_there():
    """If the reflectors agree with the table, a wrong zero of joint 3 would have been visible."""
    found = said(clean())

    assert found.verdict == "adequate"
    assert found.unloaded_off_mm[0] < 0.1
    assert not any(s.name == "joint_offset" and s.where == 3 for s in found.blind_spots)
    assert not any(s.name == "base_rotation" for s in found.blind_spots)


@pytest.mark.slow
def test_what_the_unloaded_reflectors_refute_is_not_named():
    """A strut whose law the catalogue only approximates leaves residuals like a sag from tons.

    The reflectors are where the table puts them, so the arm does not sag by centimetres.
    """
    robot = load("kr500_rail")
    plan = drawn(robot, np.random.default_rng((2026, 9, 15)), Rules())
    hidden = [(SECRETS["scale_zero"], 2.6), (SECRETS["compensator"], 0.95)]
    game = play(robot, plan, hidden, np.random.default_rng((2026, 1, 15)))

    found = said(game.files)

    assert found.unloaded_off_mm[0] < 0.05
    assert {cause.name for cause in found.causes} == {"scale_zero", "compensator"}


@pytest.mark.slow
def test_a_wrong_zero_is_named_beside_a_stated_uncertainty():
    """The stated uncertainty of the log does not absorb an error 35 times as large."""
    files = logged(theta3_deg=0.1)
    toml = files["campaign.toml"].decode().replace("[joints]\n", "[joints]\nsigma_rad = 5e-5\n")
    assert toml != files["campaign.toml"].decode()

    found = said(files | {"campaign.toml": toml.encode()})

    (cause,) = found.causes
    assert (cause.name, cause.where) == ("joint_offset", 3)
    assert found.unloaded_off_mm[0] > 0.5
    assert found.unloaded_off_mm[1] < 0.05


@pytest.mark.whole
def test_within_its_stated_uncertainty_no_zero_is_wrong():
    """The same log, stated to be uncertain by as much."""
    files = logged(theta3_deg=0.1)
    toml = files["campaign.toml"].decode().replace("[joints]\n", "[joints]\nsigma_rad = 2e-3\n")

    assert not said(files | {"campaign.toml": toml.encode()}).causes


@pytest.mark.slow
def test_the_deflected_robot_stands_where_the_straight_one_does():
    """The unloaded reflectors are judged with either equilibrium."""
    files = logged(theta3_deg=0.1)
    toml = files["campaign.toml"].decode() + '\n[model]\nequilibrium = "deformed"\n'

    (cause,) = said(files | {"campaign.toml": toml.encode()}).causes

    assert (cause.name, cause.where) == ("joint_offset", 3)
