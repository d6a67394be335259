"""From a raw folder to result.json, through files and command line, without Prefect."""

import csv
import json
import math
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.league.play import Rules, drawn, play
from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.reduction.bring import bring
from pipeline.run import campaign_answer, ingested, run
from pipeline.simulate import Plan, revised, simulate
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify
from pipeline.system.fit import fit

PROJECT = Path(__file__).parents[1]


def pipeline(root, *arguments):
    """Run the command line as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "pipeline", *arguments, "--root", str(root)],
        capture_output=True,
        text=True,
        cwd=PROJECT,
        timeout=300,
    )


def write(root, files, name="campaign"):
    """A raw folder with these files, and its campaign."""
    folder = root / "data" / "raw" / name
    folder.mkdir(parents=True)
    for file, content in files.items():
        (folder / file).write_bytes(content)
    return campaigns.find(root, name)


def told(files):
    """Answer for these files, without tables and report on disk."""
    return campaign_answer("told", in_memory(files)).answer


def exact(changes=None):
    """A KR500 campaign without noise, coordinates written with all digits."""
    plan = Plan(name="exact", poses={"count": 7})
    silent = {
        "tracker": {"noise_scale": 0.0, "digits": "full"},
        "scale": {"noise_scale": 0.0},
    }
    return revised(revised(plan, silent), changes or {})


SWAPPED = "label_swap:pose03_rep1_loaded"
FEW = Plan(name="c", poses={"count": 7})
TABLE_III = [8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5]


@pytest.mark.whole
def test_exact_data_give_back_the_stiffnesses():
    """Through the raw files, all seven are recovered to 1e-9 of Table III."""
    answer = told(simulate(exact()).files)
    found = [entry.value for entry in answer.stiffness]

    assert found == pytest.approx(TABLE_III, rel=1e-9)
    assert [entry.name for entry in answer.stiffness] == [
        "k_r1", *(f"k_theta{j}" for j in range(2, 8))
    ]  # fmt: skip
    assert answer.diagnosis.verdict == "adequate"


def fanuc_by_hand():
    """B and c of the FANUC's 43 pulls from the published table, one pose at a time."""
    folder = PROJECT / "data" / "raw" / "fanuc_r2000ic"

    def rows(name, columns):
        with open(folder / name, newline="") as file:
            return np.array([[float(r[c]) for c in columns] for r in csv.DictReader(file)])

    angles = rows("joints.csv", [f"J{j}_rad" for j in range(1, 7)])
    force = rows("forces.csv", ["fx_n", "fy_n", "fz_n"])
    moved = rows("displacements.csv", ["dx_m", "dy_m", "dz_m"])
    half = math.pi / 2
    table = [
        (0, 0, 0, 0.670),
        (-half, 0.312, -half, 0),
        (0, 1.075, 0, 0),
        (-half, 0.225, 0, 1.28),
        (half, 0, 0, 0),
        (-half, 0, 0, 0.215),
    ]
    B = []
    for (q1, q2, q3, q4, q5, q6), f in zip(angles, force, strict=True):
        T, axes, at = np.eye(4), [], []
        for m, (alpha, a, offset, d) in zip(
            (q1, q2, -(q2 + q3), -q4, -q5, -q6), table, strict=True
        ):
            ca, sa, ct, st = (
                math.cos(alpha), math.sin(alpha), math.cos(m + offset), math.sin(m + offset)
            )  # fmt: skip
            T = T @ np.array(
                [
                    [ct, -st, 0, a],
                    [st * ca, ct * ca, -sa, -sa * d],
                    [st * sa, ct * sa, ca, ca * d],
                    [0, 0, 0, 1],
                ]
            )
            axes.append(T[:3, 2])
            at.append(T[:3, 3])
        p = (T @ [0.0069, 0.2453, 0.3193, 1.0])[:3]
        J = np.array([np.cross(z, p - o) for z, o in zip(axes, at, strict=True)]).T
        B.append(J * (J.T @ f))
    return np.vstack(B), moved.ravel()


@cache
def fanuc():
    """The answer to the FANUC's published campaign."""
    folder = PROJECT / "data" / "raw" / "fanuc_r2000ic"
    return told({path.name: path.read_bytes() for path in folder.iterdir()})


@pytest.mark.whole
def test_real_fanuc_pulls_agree_with_an_independent_least_squares():
    """Equal weights, joints only: k_1..k_6, residual 0.220 mm, 0.2339 mm at left-out poses."""
    B, c = fanuc_by_hand()
    scale = np.linalg.norm(B, axis=0)
    x = np.linalg.lstsq(B / scale, c, rcond=None)[0] / scale
    residual = c - B @ x

    answer = fanuc()

    springs = answer.joint_springs
    assert [e.value for e in springs.stiffness] == pytest.approx(1 / x, rel=1e-6)
    assert springs.fit.residual_std_mm == pytest.approx(
        1e3 * math.sqrt(residual @ residual / (129 - 6)), rel=1e-9
    )
    assert springs.fit.residual_std_mm == pytest.approx(0.220, abs=5e-4)
    assert springs.validation.held_out_rms_mm == pytest.approx(0.2339, abs=5e-5)
    assert springs.fit.noise_from == "residuals"
    assert springs.fit.p_value is None
    assert "Joint springs alone do not explain the readings" in answer.verdict_sentence[0]


@pytest.mark.whole
def test_left_out_error_is_that_of_refitting_without_the_pose():
    """FANUC: 43 refits by lstsq give the same left-out residuals as the table."""
    B, c = fanuc_by_hand()
    scale = np.linalg.norm(B, axis=0)
    out = np.empty_like(c)
    for i in range(0, len(c), 3):
        keep = np.ones(len(c), bool)
        keep[i : i + 3] = False
        x = np.linalg.lstsq(B[keep] / scale, c[keep], rcond=None)[0] / scale
        out[~keep] = (c - B @ x)[~keep]
    answer = fanuc()

    assert answer.joint_springs.validation.held_out_rms_mm == pytest.approx(
        1e3 * math.sqrt(np.mean(out**2)), rel=1e-9
    )


@pytest.mark.whole
def test_a_pull_through_the_axis_of_joint_7_is_told_by_name():
    """The other six are given; k_theta7 is not, and the finding says what to change."""
    tool = exact().tool | {"load_point": [0.0, 0.0, 0.25]}
    answer = told(simulate(exact({"tool": tool})).files)
    entries = {entry.name: entry for entry in answer.stiffness}

    assert entries["k_theta7"].value is None
    assert not entries["k_theta7"].identifiable
    assert "off that joint's axis" in entries["k_theta7"].finding
    values = [e.value for e in answer.stiffness[:6]]
    assert values == pytest.approx(TABLE_III[:6], rel=1e-9)


@pytest.mark.slow
def test_a_negative_compliance_is_a_finding_and_no_stiffness():
    """Rail displacements of the wrong sign: k_r1 has no value, and the sentence says why."""
    files = dict(simulate(exact()).files)
    right = campaign_answer("right", in_memory(files))
    answer, moved, forces = right.answer, right.shown["displacements"].copy(), right.shown["forces"]
    pull = moved.merge(forces, on=["pose", "repeat"])
    moved["dy_m"] -= 3 * pull["fy_n"] / 8.0e7
    content = tomllib.loads(files["campaign.toml"].decode())
    toml = [
        "format = 1",
        'name = "wrong"',
        'robot = "kr500_rail"',
        "[displacements]",
        "sigma_m = 3e-5",
        "[tool]",
        *(f"{name} = {point}" for name, point in content["tool"].items()),
    ]
    reduced = {
        "campaign.toml": "\n".join(toml).encode(),
        "joints.csv": files["joints.csv"],
        "displacements.csv": csv_of(moved, ["pose", "repeat", "target", "dx_m", "dy_m", "dz_m"]),
        "forces.csv": csv_of(forces, ["pose", "repeat", "fx_n", "fy_n", "fz_n"]),
    }

    wrong = told(reduced).stiffness[0]

    assert answer.stiffness[0].value == pytest.approx(8e7, rel=1e-9)
    assert wrong.compliance == pytest.approx(-2 / 8e7, rel=1e-6)
    assert wrong.value is None
    assert "negative" in wrong.finding


def csv_of(table, columns):
    """Columns of a table as CSV bytes, with all digits."""
    return table[columns].to_csv(index=False).encode()


@pytest.mark.slow
def test_json_on_stdout_is_the_result_file(tmp_path):
    """One line per campaign.

    A bad one has an error, does not stop others, and sets the exit code.
    """
    write(tmp_path, simulate(FEW).files, "good")
    write(tmp_path, {"campaign.toml": b"format = 1\n"}, "broken")

    done = pipeline(tmp_path, "run", "--engine", "local", "--json")
    broken, good = (json.loads(line) for line in done.stdout.splitlines())

    assert done.returncode == 5
    assert broken["campaign"] == "broken"
    assert broken["error"]["file"] == "campaign.toml"
    assert good == json.loads((tmp_path / "reports/good/result.json").read_text())
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("unseen")
def test_a_second_run_computes_nothing_and_a_changed_input_does(tmp_path, monkeypatch):
    """No file is written if nothing changed; one changed input byte is computed anew."""
    campaign, computed = write(tmp_path, simulate(few(2, 1, 3)).files), []

    def counted(*given):
        computed.append(computed[0] if computed else campaign_answer(*given))
        return computed[-1]

    monkeypatch.setattr("pipeline.run.campaign_answer", counted)
    first = run(campaign)
    stamps = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()}

    again = run(campaign)

    assert again == first
    assert len(computed) == 1
    watched = {p: s for p, s in stamps.items() if p.name != ".lock"}
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in watched.items())

    loads = campaign.folder / "loads.csv"
    loads.write_bytes(loads.read_bytes().replace(b"\n1,1,3", b"\n1,1,2", 1))
    run(campaign)
    assert len(computed) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("unseen")
def test_a_damaged_answer_is_made_again(tmp_path):
    """The manifest records what the outputs were."""
    campaign = write(tmp_path, simulate(FEW).files)
    first = run(campaign)
    result = campaign.reports / "result.json"
    result.write_text(result.read_text().replace('"dof"', '"dog"'))

    assert run(campaign) == first
    assert json.loads((campaign.reports / "result.json").read_text()) == first.as_json()


def test_a_point_that_no_effector_reaches_is_refused():
    """Millimetres in [tool] are refused by everything that would compute with them."""
    files = dict(simulate(Plan(name="mm")).files)
    toml = re.sub(rb"(?m)^P1 = .*$", b"P1 = [200.0, 50.0, 120.0]", files["campaign.toml"])

    with pytest.raises(InputError, match=r":\d+: \[tool\] P1: a coordinate of 200 m is on"):
        told(files | {"campaign.toml": toml})


def few(poses, steps, targets):
    """A campaign with these numbers of poses, load steps and targets."""
    plan = Plan(name="few", poses={"count": poses}, pulls={"steps_n": [3000.0] * steps})
    return plan.model_copy(update={"tool": dict(list(plan.tool.items())[: 1 + targets])})


@pytest.mark.whole
@pytest.mark.parametrize("size", [(2, 1, 1), (1, 1, 3)])
def test_too_few_pulls_are_answered_by_what_they_determine(size):
    """Fewer rows than unknowns, or none determined alone: combinations, and no stiffness."""
    answer = told(simulate(few(*size)).files)

    assert not any(entry.identifiable for entry in answer.stiffness)
    assert answer.combinations
    assert not answer.rejected


@pytest.mark.whole
def test_two_poses_cannot_predict_each_other():
    """There is then no cross-validation error, and no number for it."""
    answer = told(simulate(few(2, 1, 3)).files)

    assert answer.validation.held_out_rms_mm is None
    assert any(entry.value for entry in answer.stiffness)


@pytest.mark.slow
def test_a_base_reflector_off_by_centimetres_is_told():
    """It is named with its table, and the registration is that of the others."""
    files = dict(simulate(Plan(name="c")).files)
    good = told(files)
    toml = files["campaign.toml"].replace(b"B2 = [0.6, 18.5, -0.3]", b"B2 = [0.63, 18.5, -0.3]")
    assert toml != files["campaign.toml"]
    bad = told(files | {"campaign.toml": toml})

    assert good.findings == tuple(e.finding for e in good.stiffness if e.finding)
    assert "B2 is 30.0" in bad.verdict_sentence[0]
    assert not any("[base_frame]" in finding for finding in bad.findings)
    assert bad.registration.max_mm < 0.2
    assert bad.registration.rotation_std_rad[2] > good.registration.rotation_std_rad[2]


@pytest.mark.slow
def test_exchanged_names_are_told_and_the_corrected_result_stands_beside():
    """P2 and P3 of one pull exchanged hide every stiffness: name, place and corrected values."""
    plan = revised(Plan(name="swapped", seed=5), {"hidden": {"effects": [SWAPPED]}})

    answer = told(simulate(plan).files)

    assert answer.diagnosis.verdict == "bad_data"
    assert answer.diagnosis.causes[0].name == "label_swap"
    assert answer.diagnosis.causes[0].where == "pose03_rep1_loaded"
    right = [entry.value for entry in answer.stiffness]
    assert right[1:4] == pytest.approx(TABLE_III[1:4], rel=0.02)


@pytest.mark.whole
def test_what_the_undeformed_robot_leaves_out_biases_no_stiffness():
    """A machine in true equilibrium, without scatter: c = B x alone is off by a sigma."""
    rules = Rules(scale_n=0.0, tool_m=0.0)
    robot = load("kr500_rail")
    plan = replace(drawn(robot, np.random.default_rng(2), rules), scatter=0.0)
    game = play(robot, plan, [], np.random.default_rng(12), rules)
    case = ingested(in_memory(game.files))
    fitted = fit(case, bring(case))
    data = replace(fitted.data, bends=False)
    _, without = identify(fitted.case.cell, data, robot.nominal_compliance)

    def off(estimate):
        return np.abs(estimate.value - 1 / np.array(game.truth["stiffness"])) / estimate.std

    assert off(fitted.estimate).max() < 0.3
    assert off(without).max() > 1
