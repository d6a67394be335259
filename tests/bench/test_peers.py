"""The judge of other tools, and the two peers that are written here: each against what is known."""

import json
import re
import tomllib

import numpy as np
import pinocchio as pin
import pytest

from bench.peers import arm as arms
from bench.peers import cut, dh, judge, page, springs
from bench.peers.urdf import urdf
from bench.reference import lre
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.mdh import parse

UR10 = cut.ROBOTS / "ur10.toml"


def test_points_are_laid_on_each_other_by_the_motion_that_took_them_apart():
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(12, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))

    off = judge.distances((seen - [3.0, -1.0, 2.0]) @ turn, seen, lay=True)
    mirrored = judge.distances(seen * [1, 1, -1], seen, lay=True)

    assert off.max() < 1e-12
    assert mirrored.max() > 0.1  # a rigid body cannot be turned inside out


def test_the_interval_of_a_mean_holds_it_and_is_wider_where_errors_come_in_runs():
    """95 % of 400 samples with a common part in every run of ten, within binomial bounds."""
    rng, cluster = np.random.default_rng(2), np.arange(400) // 10
    inside, apart = [], []
    for _ in range(400):
        off = 1 + np.repeat(rng.normal(0, 0.2, 40), 10) + rng.normal(0, 0.05, 400)
        found = judge.errors(off, cluster)
        inside.append(found.mean_ci[0] < 1 < found.mean_ci[1])
        apart.append(np.diff(found.mean_ci)[0])

    one_by_one = np.diff(judge.errors(off, np.arange(400)).mean_ci)[0]
    assert 0.90 < np.mean(inside) < 0.98
    assert np.mean(apart) > 2 * one_by_one


def test_a_tool_of_half_the_error_has_half_of_it_in_every_resample():
    off, cluster = np.random.default_rng(3).uniform(0.5, 1, 60), np.arange(60) // 10

    assert judge.ratio(off / 2, off, cluster) == pytest.approx((0.5, 0.5, 0.5))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("trial", cut.TRIALS, ids=lambda one: one.name)
def test_no_reading_that_is_held_out_teaches(trial, tmp_path):
    held = cut.positions(trial, tmp_path, tmp_path / "peers")
    train = np.loadtxt(tmp_path / "peers/train.csv", delimiter=",", skiprows=1)
    campaign = "".join(
        path.read_text("utf-8") for path in (tmp_path / "data/raw" / trial.name).glob("*.csv")
    )
    rows = (cut.RAW / trial.campaign / trial.held).read_text("utf-8").splitlines()[1:]
    other = trial.teaches.get(trial.held, lambda row: False)
    out = [row for k, row in enumerate(rows) if not other(k)]

    assert len(out) == len(held)
    assert not any(row in campaign for row in out)
    assert not {tuple(row) for row in held} & {tuple(row) for row in train[:, :3]}
    assert len(campaign.splitlines()) - len(trial.teaches) == len(train)
    named = tomllib.loads(
        (tmp_path / "data/raw" / trial.name / "campaign.toml").read_text("utf-8")
    )["positions"]
    assert (
        {named["file"]} if "file" in named else set(named["files"].values()) == set(trial.teaches)
    )


@pytest.mark.parametrize("trial", cut.LOADS, ids=lambda one: one.name)
def test_every_pull_is_held_out_once_and_then_does_not_teach(trial, tmp_path):
    poses = []
    for fold in range(trial.folds):
        held = cut.loads(trial, fold, tmp_path, tmp_path / "peers")
        arm = arms.read(trial.robot)
        taught = springs.read(tmp_path / f"data/raw/{trial.name}_{fold}", arm)
        assert not set(held.pose) & set(taught.pose)
        poses += held.pose.tolist()

    whole = springs.read(cut.RAW / trial.name, arms.read(trial.robot))
    assert sorted(poses) == sorted(whole.pose)


def test_least_squares_on_the_table_gives_a_wrong_table_back():
    """Positions of an arm whose table is off, by frames that are not those of the peer."""
    rng, arm = np.random.default_rng(4), arms.read(UR10)
    size = {"a_m": 1e-3, "d_m": 1e-3, "alpha_deg": 0.05, "theta_deg": 0.05}
    text = re.sub(
        r"(?m)^(a_m|d_m|alpha_deg|theta_deg) = (.*)$",
        lambda row: f"{row[1]} = {float(row[2]) + size[row[1]] * rng.uniform(-1, 1)!r}",
        UR10.read_text("utf-8"),
    )
    wrong = parse(text, "ur10")
    q, there = rng.uniform(-2.5, 2.5, (80, 6)), rng.uniform(-2.5, 2.5, (50, 6))
    tip = np.array([[0.05, -0.02, 0.12]])
    seen, true = (configure(wrong, one).points(tip)[:, 0] + [2.0, 1.0, -0.5] for one in (q, there))

    off = dh.told(arm, dh.calibrated(arm, q, seen + rng.normal(0, 1e-6, (80, 3))), there) - true

    assert np.abs(off).max() < 1e-5
    assert judge.distances(dh.told(arm, np.zeros(33), there), true, lay=True).min() > 1e-4


def test_the_papers_method_gives_the_certified_compliances():
    """The reference campaign `plain`, certified in 50-digit arithmetic by other formulas."""
    arm = arms.read(cut.ROBOTS / "kr500_rail.toml")

    x = springs.compliances(arm, springs.read(lre.CASES / "plain", arm))

    certified = np.concatenate(lre.certified("plain").value)
    assert np.abs(x / certified - 1).max() < 1e-9


def test_the_urdf_of_a_peer_is_the_arm():
    robot = pin.buildModelFromXML(urdf(arms.read(UR10)))
    data, q = robot.createData(), np.random.default_rng(5).uniform(-3, 3, (20, 6))
    ours = configure(load("ur10"), q).points(np.zeros((1, 3)))[:, 0]

    for here, at in zip(q, ours, strict=True):
        pin.framesForwardKinematics(robot, data, here)
        theirs = data.oMf[robot.getFrameId("wrist_3_link")].translation
        assert np.abs(theirs - at).max() < 1e-12


def test_the_page_shows_the_answers_that_are_kept():
    """docs/peers.md says what tests/validation/peers.json says, to the digits that it prints."""
    kept = json.loads((cut.HERE / "tests/validation/peers.json").read_text("utf-8"))
    shown = (cut.HERE / "docs/peers.md").read_text("utf-8")

    made = page.written(kept, "").partition("## Run again")[0].strip()

    assert made in shown
    assert re.search(r"of \d+ lines", made)


def test_what_differs_between_two_runs_is_said():
    one = {"ur5": {"this": {"mean_mm": 0.1, "rms_mm": 0.2, "largest_mm": 0.3, "seconds": 2.0}}}
    other = json.loads(json.dumps(one))
    other["ur5"]["this"] |= {"rms_mm": 0.2004, "seconds": 3.0}

    assert "no error differs in any digit (1 rows)" in page.again(one, one)
    assert "at most 0.0004 mm (this, ur5); times of the processor are 1.50" in page.again(
        other, one
    )
