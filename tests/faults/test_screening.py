"""Bad data are named with their place, corrected on the side, and never silently."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from small_case import screen

from bench.league.hidden import SECRETS
from bench.league.play import Rules, drawn, play
from pipeline.diagnosis.diagnose import diagnose
from pipeline.faults.conventions import anchored_miss, conventions, miss
from pipeline.faults.screen import ScreeningBase
from pipeline.machine.robot import load
from pipeline.machine.robot.variants import variants
from pipeline.reduction.bring import bring
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import campaign_answer, ingested, run
from pipeline.simulate import Plan, revised, simulate
from pipeline.simulate.plan import TOOL
from pipeline.store.campaign import find, in_memory
from pipeline.system.fit import fit

PLAN = Plan(name="bad", seed=11, poses={"count": 8}, pulls={"steps_n": [1500.0, 3000.0]})


def campaign(*effects, **changes):
    """A campaign with something planted in it."""
    return simulate(revised(PLAN, {"hidden": {"effects": list(effects)}, **changes}))


def case_of(files):
    return ingested(in_memory(files), plausible=False)


def findings(files):
    case = case_of(files)
    return screen(case, bring(case)).findings


BLUNDERS = [
    "outlier:pose03_rep0_unloaded/P2=1e-3",
    "label_swap",
    "tool_point",
    "unit_mixup:inch",
    "outlier",
    "label_swap:pose05_rep2_loaded",
    "tool_point:P2=4e-3",
    "unit_mixup:m",
    "unit_mixup:kgf",
    "unit_mixup:lbf",
    "unit_mixup:rad",
    "sign_or_convention:controller_axes",
    "sign_or_convention:left_handed",
    "sign_or_convention:pull_reversed",
    "sign_or_convention:d_5",
    "sign_or_convention:modified_dh",
]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("blunder", BLUNDERS)
def test_a_blunder_is_named_with_its_place(blunder):
    """The first finding states what is wrong, and where."""
    made = campaign(blunder)
    truth = made.truth["effects"][0]

    found = findings(made.files)

    assert [(f.name, f.where) for f in found] == [(truth["name"], truth["where"])]


@pytest.mark.slow
def test_a_shift_that_is_half_unseen_is_not_stated_larger_than_it_was():
    """Two reflectors leave a rotation of the effector about their line to the bad reading.

    Of all shifts that fit, the shortest is stated. Beside the backlash that the answer adds to the
    model, it is that reading alone, and no more than the planted 3 mm apart from scatter. (Screened
    with springs alone, a pull of two reflectors also shows its backlash as a shift of both.)
    """
    tool = {"load_point": TOOL["load_point"], "P1": (0.2, 0.05, 0.12), "P2": (-0.2, 0.05, 0.12)}
    for seed in range(1, 6):
        plan = Plan(
            name="two", seed=seed, tool=tool, poses={"count": 12}, pulls={"steps_n": [3000.0]},
            tracker={"sigma_m": 3e-5}, hidden={"effects": ["outlier=3e-3", "rail_backlash=5x"]},
        )  # fmt: skip
        made = simulate(plan)
        (truth,) = (one for one in made.truth["effects"] if one["name"] == "outlier")
        causes = campaign_answer("two", in_memory(made.files)).answer.diagnosis.causes
        (bad,) = (one for one in causes if one.name == "outlier")
        assert bad.where == truth["where"]
        assert bad.parameters[0].value < 3e-3 + 3 * np.sqrt(2) * 3e-5  # loaded minus unloaded
        assert "rail_backlash" in {one.name for one in causes}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("noise", [{"sigma_m": 3e-5}, {"noise": "paper"}, {"noise_scale": 1.3}])
def test_good_data_are_left_alone(noise):
    """Nothing is found in a clean campaign, whatever its noise."""
    assert not findings(campaign(tracker=noise).files)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "effect",
    [
        "rail_backlash",
        "joint_hysteresis:3",
        "rail_roll=2x",
        "base_rotation=3x",
        "joint_offset:3=5x",
    ],
)
def test_physics_is_no_bad_data(effect):
    """Misfit of the model is left to the diagnosis."""
    assert not findings(campaign(effect).files)


@pytest.mark.whole
def test_an_outlier_is_seen_beside_a_fault_of_the_model():
    """A beam break of 1 mm while the rail has an unreported backlash: both are found.

    Screened before the backlash is in the model, the pose of that reading may be in a spell.
    """
    made = campaign("outlier=1e-3", "rail_backlash")

    found = campaign_answer("both", in_memory(made.files)).answer.diagnosis.causes

    truth = {effect["name"]: effect["where"] for effect in made.truth["effects"]}
    assert {(one.name, one.where) for one in found} == set(truth.items())


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("off_m", [0.0, 1e-3])
def test_a_reading_that_a_cause_explains_comes_back(off_m):
    """With a tilting joint, a good reading appears bad beside springs alone; a bad one is bad."""
    robot, rng = load("kr500_rail"), np.random.default_rng([77, 5, 12])
    plan = drawn(robot, np.random.default_rng([78, 5]), Rules())
    game = play(robot, plan, [(SECRETS["joint_tilt:3"], rng.uniform(1, 2.5))], rng)
    lines = game.files["tracker.csv"].decode().splitlines()
    bad = next(k for k, line in enumerate(lines) if line.startswith("pose03_rep1_loaded,P2"))
    group, target, x, *more = lines[bad].split(",")
    lines[bad] = ",".join([group, target, str(float(x) + 1e3 * off_m), *more])
    game.files["tracker.csv"] = "\n".join(lines).encode()
    case = case_of(game.files)
    screened = screen(case, bring(case))
    right = fit(screened.case, bring(screened.case))
    where = place_of_interest(None, robot, right.data.pulls)
    said = diagnose(right.case.cell, right.data, right.estimate, where, rng)
    assert [effect.label for effect in said.modelled] == ["joint_tilt:3"]

    cell = case.cell.with_effects(*said.modelled)
    judged = screen(case, bring(case), ScreeningBase(cell, said.estimate.value))

    assert [f.where for f in judged.findings] == (["pose03_rep1_loaded/P2"] if off_m else [])


@pytest.mark.whole
def test_an_outlier_of_the_base_is_found():
    """One base reading 1 mm off."""
    made = campaign()
    head, row, *rest = made.files["tracker.csv"].decode().splitlines()
    group, target, x, *more = row.split(",")
    row = ",".join([group, target, str(float(x) + 1.0), *more])

    found = findings({**made.files, "tracker.csv": "\n".join([head, row, *rest]).encode()})

    assert [(f.name, f.where) for f in found] == [("outlier", f"{group}/{target}")]
    assert found[0].size == pytest.approx(1e-3, rel=0.2)


@pytest.mark.whole
def test_an_outlier_of_the_chain_is_found():
    """One end of the chain read 20 mm off along it."""
    made = campaign()
    lines = made.files["tracker.csv"].decode().splitlines()
    k = next(i for i, line in enumerate(lines) if line.startswith("pose03_rep1_loaded,Pl2"))
    near, far = (np.array(lines[i].split(",")[2:5], float) for i in (k - 1, k))
    off = far + 20 * (far - near) / np.linalg.norm(far - near)
    cells = lines[k].split(",")
    lines[k] = ",".join([*cells[:2], *(f"{v:.4f}" for v in off), *cells[5:]])

    found = findings({**made.files, "tracker.csv": "\n".join(lines).encode()})

    assert [(f.name, f.where) for f in found] == [("outlier", "pose03_rep1_loaded/Pl1-Pl2")]


@pytest.mark.whole
def test_names_exchanged_in_the_whole_campaign_are_one_finding():
    """P1 and P3 are exchanged everywhere."""
    text = campaign().files["tracker.csv"].decode()
    text = text.replace(",P1,", ",P?,").replace(",P3,", ",P1,").replace(",P?,", ",P3,")

    found = findings({**campaign().files, "tracker.csv": text.encode()})

    assert [(f.name, f.where) for f in found] == [("label_swap", "all groups")]


@pytest.mark.whole
def test_exchanged_names_of_base_reflectors_are_found():
    """B1 and B3 are exchanged in campaign.toml."""
    made = campaign()
    text = made.files["campaign.toml"].decode()
    text = text.replace("B1 =", "B? =").replace("B3 =", "B1 =").replace("B? =", "B3 =")

    found = findings({**made.files, "campaign.toml": text.encode()})

    assert [(f.name, f.where) for f in found] == [("label_swap", "B1-B3")]


@pytest.mark.whole
def test_one_pull_with_the_chain_the_wrong_way_round():
    """Pl1 and Pl2 exchanged in one group are a swapped label, not a convention."""
    made = campaign()
    lines = made.files["tracker.csv"].decode().splitlines()
    swap = {"Pl1": "Pl2", "Pl2": "Pl1"}
    for i, line in enumerate(lines):
        group, target, *rest = line.split(",")
        if group == "pose02_rep2_loaded":
            lines[i] = ",".join([group, swap.get(target, target), *rest])

    found = findings({**made.files, "tracker.csv": "\n".join(lines).encode()})

    assert [(f.name, f.where) for f in found] == [("label_swap", "pose02_rep2_loaded")]


def test_a_wrong_sign_in_a_robot_file_is_named():
    """The user's robot file has the wrong sign of d_4; or DH parameters in the other convention."""
    made = campaign()
    wrong = load("kr500_rail").text.replace("d_m = 1.3", "d_m = -1.3")
    text = made.files["campaign.toml"].decode().replace('"kr500_rail"', '"robot.toml"')
    changed = {"campaign.toml": text.encode(), "robot.toml": wrong.encode()}
    raw = in_memory({**made.files, **changed})

    found = conventions(ingested(raw, plausible=False))

    assert [(f.name, f.where) for f in found] == [("sign_or_convention", "d_4")]


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("joint", ["theta3", "theta6", "theta7"])
def test_a_joint_that_counts_the_other_way_is_one_mistake(joint):
    """A wrong sign in the log moves most reflectors, and is not a dozen of exchanged names."""
    made = campaign()
    log = pd.read_csv(io.BytesIO(made.files["joints.csv"]))
    log[f"{joint}_deg"] *= -1

    found = findings({**made.files, "joints.csv": log.to_csv(index=False).encode()})

    assert [(f.name, f.where) for f in found] == [("sign_or_convention", f"{joint}_reversed")]


def test_dh_for_modified_dh_is_named():
    """Modified (Khalil) DH parameters declared as classic."""
    made = campaign()
    text = load("kr500_rail").text.replace('"khalil"', '"standard"')
    text = re.sub("^r_m", "d_m", re.sub("^d_m", "a_m", text, flags=re.M), flags=re.M)
    settings = made.files["campaign.toml"].decode().replace('"kr500_rail"', '"robot.toml"')
    changed = {"campaign.toml": settings.encode(), "robot.toml": text.encode()}
    raw = in_memory({**made.files, **changed})

    found = conventions(ingested(raw, plausible=False))

    assert [(f.name, f.where) for f in found] == [("sign_or_convention", "modified_dh")]


def test_every_variant_of_a_table_stands_elsewhere():
    """No sign of the shipped DH parameters can be reversed without moving the reflectors."""
    case = case_of(campaign().files)

    for name, other in variants(case.robot):
        moved = replace(case, robot=other)
        assert miss(moved) > 0.03 or anchored_miss(moved) > 0.3, name


@pytest.mark.whole
def test_two_mistakes_at_once_are_both_named():
    """Radians for degrees, and a left-handed tracker frame."""
    made = campaign("unit_mixup:rad", "sign_or_convention:left_handed")

    found = findings(made.files)

    assert {(f.name, f.where) for f in found} == {
        ("unit_mixup", "rad"),
        ("sign_or_convention", "left_handed"),
    }


@pytest.mark.whole
def test_the_corrected_result_is_that_of_good_data():
    """With the unit corrected, the stiffnesses are those of the campaign without the mistake."""
    clean = case_of(campaign().files)
    case = case_of(campaign("unit_mixup:kgf").files)

    right = screen(case, bring(case)).case

    expected = fit(clean, bring(clean)).estimate.value
    assert fit(right, bring(right)).estimate.value == pytest.approx(expected, rel=1e-3)


def test_a_value_beyond_a_limit_that_readings_contradict_costs_its_pose():
    """The row is named and its pose left out; the others are used."""
    made = campaign()
    head, row, *rest = made.files["joints.csv"].decode().splitlines()
    cells = row.split(",")
    cells[3] = "170.0"
    log = "\n".join([head, ",".join(cells), *rest]).encode()

    case = case_of({**made.files, "joints.csv": log})
    out = case.rejected[case.rejected["file"] == "joints.csv"]

    assert out["line"].tolist() == [2]
    assert "outside its limits" in out["reason"].iloc[0]
    screened = screen(case, bring(case))
    (row,) = screened.findings
    assert (row.name, row.where) == ("outlier", "joints.csv pose01")
    assert 1 not in screened.case.joints["pose"].to_numpy()
    assert len(screened.case.joints) == len(rest)


@pytest.mark.whole
@pytest.mark.usefixtures("unseen")
def test_the_answer_has_both_results(tmp_path):
    """result.json.

    Bad_data, the corrected values at the top, the given ones under joint_springs.
    """
    made = campaign("sign_or_convention:pull_reversed")
    folder = tmp_path / "data" / "raw" / "bad"
    folder.mkdir(parents=True)
    for name, content in made.files.items():
        (folder / name).write_bytes(content)

    answer = run(find(tmp_path, "bad"))

    written = json.loads((tmp_path / "reports" / "bad" / "result.json").read_text())
    assert written == answer.as_json()
    assert answer.diagnosis.verdict == "bad_data"
    (cause,) = answer.diagnosis.causes
    assert (cause.name, cause.where) == ("sign_or_convention", "pull_reversed")
    given = [entry.compliance for entry in answer.joint_springs.stiffness]
    right = [entry.compliance for entry in answer.stiffness]
    assert given == pytest.approx([-x for x in right], rel=1e-2)
    assert "from the corrected data" in " ".join(answer.verdict_sentence)
    assert [x > 0 for x in right] == [True] * 7
