"""A tolerance is decided by ISO 14253-1, at the test pose and along a path, and stated first."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.check.report import check
from pipeline.library import holds
from pipeline.library.compensate import against_pulls
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.mdh import parse as robot_of
from pipeline.prediction.decision import Decision, decide
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path
from pipeline.prediction.tolerance import (
    HeldOutError,
    TipDeflection,
    judge,
    nominal,
    path_of,
    stretches,
    table,
    tip,
)
from pipeline.reduction.effector import tool
from pipeline.reduction.settings import parse
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import CampaignFolder, in_memory

PLAN = Plan(name="part", seed=5, poses={"count": 9}, pulls={"steps_n": [1500.0, 3000.0]})
HEAD = "pose,r1_m,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg,theta7_deg,fx_n,fy_n,fz_n"
AT = "8.5,-10,35,39,81,22,-10"


def path(*forces):
    """A path at one pose under these forces along -z [N]."""
    return "\n".join([HEAD, *(f"{k},{AT},0,0,{-f}" for k, f in enumerate(forces, 11))]).encode()


@pytest.fixture(scope="module")
def files():
    """A campaign with a test pose, without a tolerance."""
    made = dict(simulate(PLAN).files)
    text = made["campaign.toml"].decode()
    pose = f"\n[test_pose]\nq = [{AT}]\nforce_n = [0.0, 0.0, -1000.0]\n"
    return made | {"campaign.toml": (text + pose).encode()}


def asked(files, said, **more):
    """The same with more in campaign.toml, and more files."""
    text = files["campaign.toml"] + f"\n[tolerance]\n{said}\n".encode()
    return files | {"campaign.toml": text} | more


@pytest.fixture(scope="module")
def found(files):
    """The answer, with a path of increasing load."""
    forces = (50, 1000, 1010, 2900, 100)
    case = simulate(PLAN)  # whose stiffnesses are nominal
    settings = parse(case.files["campaign.toml"].decode())
    known = nominal(load("kr500_rail"), tool(settings))
    mm = 1e3 * float(np.linalg.norm(known.at_load_point(*_pose(1000.0)).displacement))
    said = f'deflection_mm = {mm:.4f}\npath = "part.csv"'
    return campaign_answer("part", in_memory(asked(files, said, **{"part.csv": path(*forces)}))), mm


def _pose(newton):
    q = np.array([8.5, *np.deg2rad([-10, 35, 39, 81, 22, -10])])
    return q, np.array([0.0, 0.0, -newton])


@pytest.mark.parametrize(
    ("d", "u", "said"),
    [
        (0.70, 0.18, "pass"),
        (0.70, 0.19, "undecided"),
        (1.00, 0.0, "pass"),
        (1.33, 0.2, "undecided"),
        (1.34, 0.2, "fail"),
        (9.99, np.inf, "undecided"),
    ],
)
def test_what_is_close_to_the_limit_is_undecided(d, u, said):
    """With T = 1: 0.70 + 1.65 x 0.18 = 0.997 passes, 1.34 - 1.65 x 0.2 = 1.01 fails."""
    assert decide(d, u, 1.0) == said


def test_nothing_is_decided_by_a_model_that_does_not_explain_the_readings():
    """Half the readings dead: 1.7 mm predicted, 3.8 mm allowed, and still no PASS."""
    model = nominal(load("kr500_rail"), tool(parse(simulate(PLAN).files["campaign.toml"].decode())))
    q, force = _pose(1000.0)
    by = [
        tip(model, q[None], force[None], HeldOutError(1e-5, 3e3, holds)) for holds in (True, False)
    ]

    assert [one.decisions(1.0) for one in by] == [[Decision.PASS], [Decision.UNDECIDED]]
    assert [one.decisions(1e-6) for one in by] == [[Decision.FAIL], [Decision.UNDECIDED]]
    rows = table(model, Path(np.array([1]), q[None], force[None]), by[1], 1.0)
    assert rows["decision"].tolist() == ["undecided"]


@cache
def _nominal():
    return nominal(load("kr500_rail"), tool(parse(simulate(PLAN).files["campaign.toml"].decode())))


def by_hand(*hypotheses):
    """The plan's robot with its nominal stiffnesses, or these hypotheses."""
    model = _nominal()
    return replace(model, hypotheses=hypotheses) if hypotheses else model


def test_the_nominal_robot_is_certain_of_its_springs():
    """A pull along the rail moves every point along it by F / k of the drive, without more."""
    model = by_hand()
    robot = model.robot
    q, _ = _pose(1.0)
    ahead = (
        configure(robot, q[None] + np.eye(7)[0]).flange_origin
        - configure(robot, q[None]).flange_origin
    )
    rail = ahead[0] / np.linalg.norm(ahead)
    found = model.predict(q, 500.0 * rail)

    assert found.displacement[0] @ rail > 500.0 / robot.joints[0].typical_stiffness
    assert model.value == pytest.approx([1 / k for k in _typical(robot)])
    assert not found.cov.any()
    assert (model.campaign, model.verdict, dict(model.recommended)) == ("", "", {})


def _typical(robot):
    return [joint.typical_stiffness for joint in robot.joints]


def test_the_uncertainty_of_a_deflection_is_the_one_along_it():
    """By draws of two compliances that compensate each other or add up; never across."""
    one = by_hand().hypotheses[0]
    rng, u = np.random.default_rng(4), 0.1 * one.value
    q, force = _pose(1000.0)
    for sign in (1, -1):
        cov = np.diag(u**2)
        cov[1, 2] = cov[2, 1] = 0.99 * sign * u[1] * u[2]
        found = tip(by_hand(replace(one, cov=cov)), q[None], force[None], HeldOutError(None, 1.0))
        drawn = rng.multivariate_normal(one.value, cov, 4000)
        J = np.stack(
            [
                by_hand(replace(one, value=x)).predict(q, force).displacement[0]
                for x in np.diag(one.value)
            ],
            axis=1,
        )
        size = np.linalg.norm(drawn / one.value @ J.T, axis=1)
        bent = by_hand().at_load_point(q, force).std[0] @ np.abs(found.moved[0]) / found.size[0]
        assert abs(found.std[0] - np.std(size)) < 0.03 * np.std(size) + bent
        assert found.size[0] == pytest.approx(np.linalg.norm(J.sum(axis=1)))


def test_the_floor_grows_with_the_force_beyond_the_hardest_pull_only():
    """3 um to 2 kN, then in proportion: 4 kN give 6 um; none if no pose was left out."""
    force = np.array([[0.0, 0.0, -500.0], [1200.0, 0.0, 1600.0], [0.0, -4000.0, 0.0]])

    assert HeldOutError(3e-6, 2000.0).floor(force) == pytest.approx([3e-6, 3e-6, 6e-6])
    assert HeldOutError(None, 2000.0).floor(force).tolist() == [0.0, 0.0, 0.0]


def test_hypotheses_that_may_be_true_are_each_alone_and_others_are_not_asked():
    """Of 0.5, 0.45 and 0.05 the last does not count; a single one has no rivals."""
    one = by_hand().hypotheses[0]
    q, force = _pose(1000.0)
    shown = HeldOutError(1e-6, 3e3)
    many = by_hand(
        *(replace(one, weight=w, value=k * one.value) for w, k in ((0.5, 1), (0.45, 2), (0.05, 9)))
    )
    found = tip(many, q[None], force[None], shown)
    single = tip(by_hand(one), q[None], force[None], shown)

    assert [each.size[0] / single.size[0] for each in found.each] == pytest.approx([1.0, 2.0])
    assert found.size[0] / single.size[0] == pytest.approx(0.5 + 0.9 + 0.45)
    assert single.each == ()


def test_the_table_of_a_path_has_places_forces_and_deflections_by_point():
    """Each column from its own source, in SI."""
    model = by_hand()
    q, force = _pose(1000.0)
    path = Path(np.array([11, 30]), np.stack([q, q - 0.1]), np.stack([force, [90.0, -80.0, 70.0]]))
    std = np.array([1e-6, 2e-6])
    moved = np.array([[1e-3, 2e-3, -2e-3], [0.0, 3e-4, 4e-4]])
    found = TipDeflection(moved, np.array([3e-3, 5e-4]), std)
    rows = table(model, path, found, 1e-3)

    at = configure(model.robot, path.q).points(model.tool.load_point[None])[:, 0]
    np.testing.assert_allclose(rows[["x_m", "y_m", "z_m"]], at, atol=1e-12)
    np.testing.assert_array_equal(rows[["fx_n", "fy_n", "fz_n"]], path.force)
    np.testing.assert_array_equal(rows[["dx_m", "dy_m", "dz_m"]], moved)
    assert rows["point"].tolist() == [1, 2]
    assert rows["pose"].tolist() == [11, 30]
    assert rows["deflection_m"].tolist() == [3e-3, 5e-4]
    assert rows["std_m"].tolist() == std.tolist()
    assert rows["decision"].tolist() == ["fail", "pass"]


def test_a_tolerance_is_judged_at_the_pose_and_along_the_path():
    """As `tip` by itself, for each; without a path no table."""
    model = by_hand()
    q, force = _pose(1000.0)
    shown = HeldOutError(1e-5, 3e3, False)
    path = Path(np.array([4, 5]), np.stack([q, q]), np.stack([2 * force, 3 * force]))
    both, alone = (judge(model, q, force, shown, one, 1e-3) for one in (path, None))

    own = tip(model, path.q, path.force, shown)
    assert both.at.moved.shape == (1, 3)
    np.testing.assert_array_equal(both.at.moved, tip(model, q[None], force[None], shown).moved)
    np.testing.assert_array_equal(both.path["deflection_m"], own.size)
    assert both.path["decision"].tolist() == ["undecided", "undecided"]
    assert not both.at.holds
    assert alone.path is None
    assert path_of(None, {}, model.robot, model.tool) is None


@pytest.mark.parametrize(
    ("said", "runs"),
    [("p", [("p", 0, 0)]), ("ppf", [("p", 0, 1), ("f", 2, 2)]), ("pfup", None)],
)
def test_stretches_cover_a_path_without_gap_or_overlap(said, runs):
    """Rows, both ends included."""
    word = {"p": "pass", "f": "fail", "u": "undecided"}
    found = list(stretches(np.array([word[one] for one in said], dtype=object)))

    if runs is None:
        runs = [(one, k, k) for k, one in enumerate(said)]
    assert found == [
        type(one)(Decision(word[w]), a, b) for one, (w, a, b) in zip(found, runs, strict=True)
    ]


def test_forces_beside_the_pulls_are_told_with_both_ranges():
    """Of several forces the largest counts; without known pulls nothing is told."""
    force = np.array([30.0, 3500.0, 800.0])

    (said,) = against_pulls(force, (1000.0, 3000.0))
    assert said.startswith(
        "The forces reach 3500 N; the campaign pulled with 1000 to 3000 N: beyond"
    )
    assert against_pulls(force[:1], (1000.0, 3000.0))[0].endswith(
        "1000 to 3000 N: check their unit."
    )
    assert against_pulls(force, None) == against_pulls(force, (1000.0, 3500.0)) == []


@pytest.mark.parametrize(("weight", "said"), [(0.06, "undecided"), (0.04, "pass")])
def test_possible_hypotheses_must_decide_alike(weight, said):
    """One of two is four times as soft; the average of both would pass with either weight."""
    model = nominal(load("kr500_rail"), tool(parse(simulate(PLAN).files["campaign.toml"].decode())))
    one = model.hypotheses[0]
    soft = replace(one, weight=weight, value=4 * one.value)
    both = replace(model, hypotheses=(replace(one, weight=1 - weight), soft))
    q, force = _pose(1000.0)
    shown = HeldOutError(1e-6, 3e3)
    d = tip(model, q[None], force[None], shown).size[0]

    assert tip(both, q[None], force[None], shown).decisions(3 * d) == [said]
    assert tip(both, q[None], force[None], shown).decisions(5 * d) == ["pass"]


@pytest.mark.whole
def test_a_path_passes_and_fails_by_stretches(found):
    """Five points, light loads first and last: pass, undecided, fail, pass.

    Poses as in the file.
    """
    answer, mm = found[0].answer, found[1]
    judged = answer.tolerance.path

    assert answer.tolerance.test_pose is Decision.UNDECIDED
    assert [(one.decision.value, one.first, one.last) for one in judged.stretches] == [
        ("pass", 11, 11),
        ("undecided", 12, 13),
        ("fail", 14, 14),
        ("pass", 15, 15),
    ]
    assert judged.decision is Decision.FAIL
    worst = judged.stretches[2]
    assert worst.deflection_mm == pytest.approx(2.9 * mm, rel=0.02)


@pytest.mark.whole
def test_u_is_never_below_what_left_out_poses_were_missed_by(found):
    """The model's own uncertainty is far smaller here: the error at left-out poses decides."""
    answer, model = found[0].answer, found[0].model
    q, force = _pose(1000.0)
    shown = HeldOutError(model.held_out_m, 3000.0)
    beyond = tip(model, q[None], 3 * force[None], HeldOutError(model.held_out_m, 1500.0))

    assert model.predict(q, force).std.max() < 0.5 * model.held_out_m
    assert answer.test_pose.std_mm == pytest.approx(answer.validation.held_out_rms_mm)
    assert tip(model, q[None], force[None], shown).std[0] == model.held_out_m
    assert beyond.std[0] == pytest.approx(2 * model.held_out_m)


def test_without_left_out_poses_the_model_is_taken_at_its_word(found):
    """Standard uncertainty along the deflection, from 120 draws of the stiffnesses."""
    model = found[0].model
    q, force = _pose(1000.0)
    here = tip(model, q[None], force[None], HeldOutError(None, 3000.0))
    one = model.hypotheses[0]
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(one.value, one.cov, 120)
    moved = [np.linalg.norm(_with(model, x).predict(q, force).displacement) for x in drawn]

    assert here.std[0] == pytest.approx(np.std(moved), rel=0.2)


def _with(model, value):
    one = replace(model.hypotheses[0], value=value)
    return IdentifiedModel(model.campaign, model.verdict, model.recommended, (one,))


def test_a_stiffness_that_nobody_knows_leaves_it_undecided(found):
    """However large the tolerance is."""
    model = found[0].model
    cov = model.hypotheses[0].cov.copy()
    cov[1, 1] = np.inf
    lost = IdentifiedModel("", "", {}, (replace(model.hypotheses[0], cov=cov),))
    q, force = _pose(1000.0)
    sideways = force[[2, 0, 1]]

    here = tip(lost, q[None], sideways[None], HeldOutError(1e-5, 3000.0))
    assert here.decisions(1e3) == [Decision.UNDECIDED]
    rows = table(lost, Path(np.array([1]), q[None], sideways[None]), here, 1.0)
    assert [one.decision for one in stretches(rows["decision"].to_numpy(object))] == ["undecided"]


def test_a_cartesian_path_is_judged_as_its_joint_values_are(files, found):
    """The same point as x, y, z and KUKA's angles of the load point."""
    from pipeline.programs.path_file import read

    model = found[0].model
    q, force = _pose(1000.0)
    here = configure(model.robot, q[None])
    x, y, z = 1e3 * here.points(model.tool.load_point[None])[0, 0]
    R = here.flange_axes[0]
    a, b = np.arctan2(R[1, 0], R[0, 0]), np.arcsin(-R[2, 0])
    c = np.arctan2(R[2, 1], R[2, 2])
    A, B, C = np.rad2deg([a, b, c])
    text = (
        "pose,E1_m,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg,x_mm,y_mm,z_mm,A_deg,B_deg,C_deg,"
        f"fx_n,fy_n,fz_n\n1,8.5,10,-35,51,-81,-22,10,{x:.6f},{y:.6f},{z:.6f},{A:.8f},{B:.8f},"
        f"{C:.8f},0,0,-1000\n"
    )

    got = read("part.csv", text.encode(), model)
    np.testing.assert_allclose(got.q[0], q, atol=1e-6)
    np.testing.assert_array_equal(got.force[0], force)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("deflection_mm = 0", "tolerance.deflection_mm"),
        ('path = "part.csv"', "tolerance.deflection_mm"),
        ("deflection_mm = 1\nlimit = 2", "tolerance.limit"),
        ('deflection_mm = 1\npath = "../part.csv"', "tolerance.path"),
    ],
)
def test_a_tolerance_that_makes_no_sense_is_refused_in_its_line(files, said, why):
    """The error names the key."""
    with pytest.raises(InputError, match=re.escape(why)) as refused:
        parse(asked(files, said)["campaign.toml"].decode())
    assert refused.value.line


def test_a_tolerance_needs_a_place(files):
    """Neither test pose nor path: there is no place to apply it."""
    text = files["campaign.toml"].decode().split("\n[test_pose]")[0]
    with pytest.raises(InputError, match="no place to apply it"):
        parse(text + "\n[tolerance]\ndeflection_mm = 1.0\n")


@pytest.mark.whole
def test_check_reads_the_path(files, tmp_path):
    """A faulty row is reported with its line before computation; a good path is counted."""
    folder = tmp_path / "data" / "raw" / "part"
    folder.mkdir(parents=True)
    good = asked(files, 'deflection_mm = 1.0\npath = "part.csv"', **{"part.csv": path(100, 200)})
    for name, data in good.items():
        (folder / name).write_bytes(data)

    assert check(CampaignFolder(tmp_path, folder)).content["tolerance"] == {
        "deflection_mm": 1.0,
        "file": "part.csv",
        "points": 2,
        "force_range_n": [100.0, 200.0],
    }
    (folder / "part.csv").write_bytes(path(100).replace(b"-100", b"x"))
    with pytest.raises(InputError) as refused:
        check(CampaignFolder(tmp_path, folder))
    assert (refused.value.file, refused.value.line) == ("part.csv", 2)


def test_the_first_screen_says_it(found):
    """T, the decision at the test pose and along the path, d and U in the digits of U."""
    lines = {line.about: line.text for line in found[0].answer.first_screen}
    said, pose = lines["tolerance"], lines["test_pose"]
    u = 2 * found[0].answer.test_pose.std_mm

    assert f"a deflection of {found[1]:.4f}".rstrip("0") in said
    assert "ISO 14253-1" in said
    assert "Test pose: undecided with " in said
    assert "fail at pose 14" in said
    assert "A1 10.00°" in pose
    assert re.search(r"deflects by \d\.\d{3} mm, U = 0\.\d{3} mm \(k = 2\)", pose)
    assert f"U = {u:.3f} mm" in pose
    json.dumps(found[0].answer.as_json(), allow_nan=False)


def test_a_force_that_no_robot_holds_is_refused_with_its_line(files):
    """Force a thousand times too large: the KR500 carries 480 kg, three times that is 14.1 kN."""
    said = 'deflection_mm = 1.0\npath = "part.csv"'
    raw = in_memory(asked(files, said, **{"part.csv": path(50, 14000, 15000, 9e5)}))

    with pytest.raises(InputError, match=r"^part.csv:4: a force of 15000 N .* about 14100 N"):
        campaign_answer("part", raw)


@pytest.mark.slow
def test_forces_unlike_the_pulls_are_said(files):
    """Pulled with 1.5 and 3 kN: 3.5 kN is beyond, 1.2 N may be kilonewtons, 2 kN is fine."""
    said = 'deflection_mm = 1.0\npath = "part.csv"'
    about = {
        force: campaign_answer(
            "part", in_memory(asked(files, said, **{"part.csv": path(1, force)}))
        )
        for force in (1.2, 2000, 3500)
    }
    told = {
        force: [one for one in found.answer.findings if "The forces reach" in one]
        for force, found in about.items()
    }

    assert told[2000] == []
    assert "1.20 N; the campaign pulled with" in told[1.2][0]
    assert told[1.2][0].endswith("check their unit.")
    assert "3500 N" in told[3500][0]
    assert about[3500].model.pulled_n == pytest.approx((1500, 3000), rel=0.03)


def test_a_robot_of_unknown_payload_is_held_by_its_joints():
    """10 mrad of the softest lever: 3.8 MN m/rad, turned by a force at 2 m or so, 10 to 40 kN."""
    text = load("kr500_rail").text
    silent = robot_of(re.sub(r"(?m)^payload_kg.*$", "", text), "arm.toml")
    q, force = _pose(1000.0)
    point = np.array([0.15, 0.0, 0.25])

    holds.refuse_unheld(silent, q[None], 5 * force[None], point, "part.csv", [2])
    with pytest.raises(InputError, match=r"^part.csv:2: .* by more than 10 mrad"):
        holds.refuse_unheld(silent, q[None], 100 * force[None], point, "part.csv", [2])
