"""The model that is handed over: others read it, its intervals hold, its offsets correct a path.

Truth here is Pinocchio's: springs of the true stiffness turn the joints until they carry the force
where the robot then is.
"""

import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from bending_robot import BendingRobot
from conftest import without_pages
from made_programs import Kuka
from test_programs import off, unstamped

from bench.as_pinocchio import model as pin_model
from pipeline.base.errors import InputError, UsageError
from pipeline.exchange.to_urdf import urdf
from pipeline.library import compensate, model_file
from pipeline.machine.cell import paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.prediction import model as handover
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path as JointPath
from pipeline.programs import joint_path
from pipeline.programs.on_disk import CorrectionOptions, program, write
from pipeline.reduction.effector import tool
from pipeline.run import run
from pipeline.simulate import parse, simulate
from pipeline.store.campaign import find, in_memory
from pipeline.system.estimate import identify

pytestmark = pytest.mark.whole

DATA = Path(__file__).parents[2] / "data"
DEMO_PATH = DATA / "paths" / "kr500_demo.csv"
DEMO_PLAN = (DATA / "plans" / "kr500_demo.toml").read_text("utf-8")
ROBOT = load("kr500_rail")
TIP = np.array([0.15, 0.0, 0.25])


def tip(model, q, frame="tip"):
    """Where the tip is, from Pinocchio [m]."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(frame)].translation.copy()


def loaded_tip(model, q, force, stiffness):
    """Where the tip is when every joint's spring carries its torque in the deflected robot."""
    data, frame, bent = model.createData(), model.getFrameId("tip"), q
    for _ in range(20):
        J = pin.computeFrameJacobian(model, data, bent, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        bent = q + J.T @ force / stiffness
    return tip(model, bent)


def errors(path, offsets, stiffness):
    """How far the loaded tip is from where the unloaded robot would have it, (m, 3) [m]."""
    model = pin_model(ROBOT, {"tip": TIP})
    return np.array(
        [
            loaded_tip(model, q + d, f, stiffness) - tip(model, q)
            for q, d, f in zip(path.q, offsets, path.force, strict=True)
        ]
    )


def handed(campaign, read_back):
    """The model identified from a simulated campaign, by the stages of a run."""
    raw = in_memory(campaign.files)
    cell = paper_cell(raw.robot, tool(raw.settings))
    _, estimate = identify(cell, read_back(campaign).data, raw.robot.nominal_compliance)
    return whole(cell, estimate)


def whole(cell, estimate):
    """A model that is certain: one hypothesis."""
    reason = {"model": "joint_springs", "data": "as_given", "reason": "adequate"}
    return IdentifiedModel("c", "adequate", reason, (handover.part(1.0, cell, estimate),))


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo campaign after its run; its root."""
    root = tmp_path_factory.mktemp("demo")
    shutil.copytree(DATA / "raw" / "kr500_demo", root / "data" / "raw" / "kr500_demo")
    with without_pages():
        run(find(root, "kr500_demo"))
    return root


@pytest.fixture(scope="module")
def path():
    return joint_path.read("path.csv", DEMO_PATH.read_bytes(), ROBOT)


@pytest.fixture(scope="module")
def true():
    """True stiffnesses of the demo [N/m] and [N m/rad]."""
    return np.array([entry["value"] for entry in simulate(parse(DEMO_PLAN)).truth["stiffness"]])


@pytest.fixture(scope="module")
def models(read_back):
    """What thirty campaigns of the demo, each with noise of its own, identify."""
    plan = parse(DEMO_PLAN)
    drawn = (simulate(plan, np.random.default_rng([1, seed])) for seed in range(30))
    return [handed(campaign, read_back) for campaign in drawn]


@pytest.mark.whole
def test_the_offsets_correct_the_path_to_the_stated_uncertainty(path, models, true):
    """Thirty noisy campaigns: what is left on the true robot scatters as stated, no more."""
    points = path_rows(path, slice(None, None, 10))
    raw = errors(points, np.zeros_like(points.q), true)
    left, squares = [], []
    for model in models:
        found = compensate.compensate(model, points)
        left.append(errors(points, found.joints, true))
        squares.append((left[-1] / found.std) ** 2)

    assert np.sqrt(np.mean(np.square(raw))) > 5e-4
    assert np.sqrt(np.mean(np.square(left))) < 2e-5
    assert np.mean(squares) == pytest.approx(1.0, abs=0.3)


@pytest.mark.whole
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))]
)
def test_a_corrected_program_is_where_it_was_taught_on_the_bending_robot(demo, true, seed):
    """By noisy readings alone: of the error that the force makes, four fifths go at every point."""
    bending, force = BendingRobot(ROBOT, true), np.array([-600.0, -900.0, -700.0])
    made = Kuka(seed, ROBOT, bending).make()
    for name in made.files:
        (demo / name).write_bytes(made.data(name))
    given = CorrectionOptions(force=",".join(map(str, force)), partial=True, **made.options)
    before, after = [], []
    for name in made.files:
        data, _ = program(demo, "kr500_demo", demo / name, given)
        data = unstamped(data)
        for k, texts in made.numbers(name, data).items():
            point, numbers = made.points[k], [float(text) for text in texts]
            before.append(off(bending, made, "abc", point, point.numbers, force)[0])
            after.append(off(bending, made, "abc", point, numbers, force)[0])

    assert len(after) == len(made.points)
    assert min(before) > 4e-4
    assert (np.array(after) < 0.2 * np.array(before)).all()


def path_rows(path, rows):
    return JointPath(path.pose[rows], path.q[rows], path.force[rows], path.controller)


@pytest.mark.whole
def test_measurements_are_never_written_beside(demo):
    """A path that lies in data/raw is answered in the campaign's reports, and nowhere in there."""
    raw = demo / "data" / "raw"
    path = raw / "kr500_demo" / "part.csv"
    path.write_bytes(DEMO_PATH.read_bytes())
    before = sorted(raw.rglob("*"))
    written, _ = write(demo, "kr500_demo", path)

    assert written == demo / "reports" / "kr500_demo" / "part-compensation.csv"
    with pytest.raises(UsageError, match="lies under data/raw"):
        write(demo, "kr500_demo", path, output=raw / "kr500_demo" / "out.csv")
    assert sorted(raw.rglob("*")) == before
    path.unlink()


@pytest.mark.whole
def test_beyond_the_hardest_pull_one_counts_on_less(demo, path):
    """Three times the force is three times the error at left-out poses, where that decides."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    hardest = np.linalg.norm(path.force, axis=1).max()
    harder = replace(path, force=path.force * 3 * model.pulled_n[1] / hardest)
    usual, beyond = (compensate.compensate(model, one) for one in (path, harder))
    count_on = [float(re.search("count on ±(.*) mm", one.summary)[1]) for one in (usual, beyond)]

    assert usual.remarks == [usual.summary]
    assert "the campaign pulled with" in beyond.remarks[1]
    assert count_on[1] == pytest.approx(3 * count_on[0], rel=0.02)


def test_compensate_writes_the_offsets_that_the_demo_path_needs(demo, path, true, tmp_path):
    """From the command's file: millimetres of deflection fall to within the stated 95 %."""
    written, _ = write(demo, "kr500_demo", DEMO_PATH, output=tmp_path / "offsets.csv")
    table = np.genfromtxt(written, delimiter=",", names=True)
    joints = np.column_stack(
        [table["d_r1_m"], *(np.deg2rad(table[f"d_theta{j}_deg"]) for j in range(2, 8))]
    )
    before, after = (errors(path, d, true) for d in (np.zeros_like(joints), joints))
    stated = np.column_stack([table[f"std_{axis}_mm"] for axis in "xyz"]) * 1e-3
    shift = np.column_stack([table[f"d{axis}_mm"] for axis in "xyz"]) * 1e-3

    assert np.linalg.norm(before, axis=1).min() > 3e-4
    assert (np.abs(after) < 3 * stated).all()
    assert shift == pytest.approx(-before, abs=5e-5)
    assert table["left_mm"].max() < 1e-3


@pytest.mark.whole
def test_predicted_intervals_hold_in_the_whole_workspace(models, true):
    """Other poses, other forces, another tip: 95 % intervals of thirty campaigns hold the truth."""
    rng = np.random.default_rng(7)
    q = np.column_stack([rng.uniform(0, 18, 8), rng.uniform(-1, 1, (8, 6))])
    force, point = rng.normal(0, 800, (8, 3)), np.array([0.0, 0.05, 0.4])
    model = pin_model(ROBOT, {"tip": point})
    exact = [loaded_tip(model, a, f, true) - tip(model, a) for a, f in zip(q, force, strict=True)]
    predicted = [one.predict(q, force, point) for one in models]
    inside = [np.abs(p.displacement - exact) < 1.96 * p.std for p in predicted]

    assert np.mean(inside) == pytest.approx(0.95, abs=0.05)


def test_the_file_holds_all_of_the_model(demo):
    """What is read back from model.toml is what was written, and stands in result.json."""
    path = demo / "reports" / "kr500_demo" / "model.toml"
    model, content = model_file.load(path), tomllib.loads(path.read_text("utf-8"))
    answer = find(demo, "kr500_demo").result()

    assert model_file.dumps(model) == path.read_text("utf-8")
    for entry, said in zip(content["parameter"], answer["stiffness"], strict=True):
        assert (entry["stiffness"], entry["stiffness_std"]) == (said["value"], said["std"])
    assert model.std == pytest.approx([e["compliance_std"] for e in answer["stiffness"]])
    assert content["robot"]["joint"][1]["r_m"] == 1.048


def test_what_left_out_poses_showed_travels_and_is_counted_on(demo, path):
    """Their error, as in result.json, is what the sentence about a path counts on at least."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    said = find(demo, "kr500_demo").result()["validation"]["held_out_rms_mm"]
    found = compensate.compensate(model, path)
    own = 2e3 * found.std.max()

    assert 1e3 * model.held_out_m == pytest.approx(said, rel=1e-12)
    assert f"missed by {said:.3f} mm rms" in found.summary
    assert own < 2 * said
    assert f"±{own:.3f} mm per axis (95 %) by its own word" in found.summary
    assert f"count on ±{2 * said:.3f} mm" in found.summary
    alone = replace(found, held_out=None)
    assert "by its own word alone" in alone.summary
    assert "count on" not in alone.summary


def test_named_effects_travel_and_those_of_the_measurement_stay(demo):
    """Rail roll is part of the machine, the scale's gain is not; values stay with their names."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    known = {effect.label: effect for effect in catalogue(ROBOT)}
    cell = model.hypotheses[0].cell.with_effects(known["scale_gain"], known["rail_roll"])
    k = len(cell.parameters)
    value, cov = np.arange(1.0, k + 1), np.diag(np.arange(1.0, k + 1) ** 2)

    class Estimate:
        pass

    Estimate.value, Estimate.cov = value, cov
    (handed,) = model_file.parse(model_file.dumps(whole(cell, Estimate))).hypotheses

    assert [p.name for p in handed.cell.parameters][-1] == "c_roll"
    assert handed.value.tolist() == [1, 2, 3, 4, 5, 6, 7, 9]
    assert handed.std.tolist() == [1, 2, 3, 4, 5, 6, 7, 9]


def test_a_robot_on_the_ceiling_hangs_there_in_the_model_too():
    """What `[gravity]` says reaches the effects of the campaign and those of the model file."""
    files = dict(simulate(parse(DEMO_PLAN)).files)
    files["campaign.toml"] += b"\n[gravity]\ndirection = [0, 0, 2]\nm_s2 = 9.81\n"
    raw = in_memory(files)

    class Certain:
        value, cov = raw.robot.nominal_compliance, np.eye(raw.robot.n)

    made = whole(paper_cell(raw.robot, tool(raw.settings)), Certain)

    assert raw.robot.gravity.tolist() == [0, 0, 9.81]
    assert model_file.parse(model_file.dumps(made)).robot.gravity.tolist() == [0, 0, 9.81]


def test_an_undetermined_spring_makes_predictions_uncertain_where_it_acts(demo):
    """Infinite for a force that turns joint 7, finite for one through its axis."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    cov = model.cov.copy()
    cov[6, :] = cov[:, 6] = 0.0
    cov[6, 6] = np.inf
    (one,) = model.hypotheses
    unknown = replace(model, hypotheses=(replace(one, cov=cov),))
    blind = model_file.parse(model_file.dumps(unknown))
    q = np.deg2rad([0, 10, 40, 60, 30, 50, 20.0])

    assert np.isinf(blind.predict(q, [300.0, -500.0, 200.0]).std).any()
    assert np.isfinite(blind.predict(q, [300.0, -500.0, 200.0], [0.0, 0.0, 0.3]).std).all()


@pytest.mark.whole
def test_a_prediction_is_that_of_draws_over_the_hypotheses(demo):
    """Draw a hypothesis by its weight, then its parameters: mean and spread are what is stated."""
    (one,) = model_file.load(demo / "reports" / "kr500_demo" / "model.toml").hypotheses
    roll = next(e for e in catalogue(ROBOT) if e.label == "rail_roll")
    k = len(one.value)
    value = np.append(1.15 * one.value, 2e-8)
    cov = np.zeros((k + 1, k + 1))
    cov[:k, :k], cov[k, k] = one.cov, 1e-18
    other = handover.ModelHypothesis(0.3, one.cell.with_effects(roll), value, cov)
    model = IdentifiedModel(
        "c", "ambiguous", {"reason": "rivals"}, (replace(one, weight=0.7), other)
    )
    q, force = np.array([5.0, *np.deg2rad([-10, 40, 30, 50, 20, 10])]), np.array([300, -500, 200.0])
    rng, drawn = np.random.default_rng(4), []
    for draw in range(2000):
        mine = model.hypotheses[int(draw % 10 < 3)]
        size = np.sqrt(np.diag(mine.cov))
        x = mine.value + size * rng.multivariate_normal(
            np.zeros(len(size)), mine.cov / np.outer(size, size)
        )
        certain = replace(model, hypotheses=(replace(mine, weight=1.0, value=x),))
        drawn.append(certain.predict(q, force).displacement[0])
    moved = np.array(drawn)
    read = model_file.parse(model_file.dumps(model))

    said = model.predict(q, force)
    assert said.displacement[0] == pytest.approx(moved.mean(axis=0), abs=5e-7)
    assert said.std[0] == pytest.approx(moved.std(axis=0), rel=0.05)
    np.testing.assert_array_equal(read.predict(q, force).displacement, said.displacement)


def test_a_joint_that_the_answer_does_not_state_has_no_stiffness(demo):
    """Known to a finite uncertainty and yet not determined: neither file gives it a stiffness."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    unstated = replace(model, stated=np.arange(7) != 5)
    content = tomllib.loads(model_file.dumps(unstated))
    read = ElementTree.fromstring(urdf(unstated))

    assert ["stiffness" in entry for entry in content["parameter"]] == [j != 5 for j in range(7)]
    assert len(list(read.iter("elasticity"))) == 6
    read = model_file.parse(model_file.dumps(unstated))
    assert [read.stiffness(j) is not None for j in range(7)] == [j != 5 for j in range(7)]


def test_a_model_of_an_older_format_is_refused_with_the_way_out(demo):
    """What an older version wrote had one hypothesis and no word of the rest."""
    text = (demo / "reports" / "kr500_demo" / "model.toml").read_text("utf-8")

    with pytest.raises(InputError, match="write it anew with `pipeline run`"):
        model_file.parse(text.replace("format = 2", "format = 1", 1))


def test_other_programs_read_the_urdf(demo):
    """Pinocchio's own URDF reader builds the same robot, whatever way its frames are turned."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    rng = np.random.default_rng(3)
    turned = replace(
        ROBOT, placement=np.array([pin.exp6(a).homogeneous for a in rng.normal(0, 1, (7, 6))])
    )
    for robot in (ROBOT, turned):
        (one,) = model.hypotheses
        there = replace(one, cell=replace(one.cell, robot=robot))
        written = urdf(replace(model, hypotheses=(there,))).decode()
        theirs = pin.buildModelFromXML(written)
        q = rng.uniform(theirs.lowerPositionLimit, theirs.upperPositionLimit)

        assert tip(theirs, q, "load_point") == pytest.approx(
            tip(pin_model(robot, {"tip": TIP}), q), abs=1e-9
        )


def test_the_joints_of_the_urdf_carry_their_stiffness(demo):
    """Value, standard uncertainty and unit as in result.json."""
    found = ElementTree.parse(demo / "reports" / "kr500_demo" / "model.urdf").iter("elasticity")
    said = find(demo, "kr500_demo").result()["stiffness"]

    assert [(float(e.get("stiffness")), float(e.get("std")), e.get("unit")) for e in found] == [
        (entry["value"], entry["std"], entry["unit"]) for entry in said
    ]


def test_a_path_with_a_hole_is_refused():
    """A row that cannot be read stops the command with file and line."""
    lines = DEMO_PATH.read_text("utf-8").splitlines()
    lines[4] = lines[4].replace(",", ",x", 1)

    with pytest.raises(InputError, match=r"path\.csv:5: "):
        joint_path.read("path.csv", "\n".join(lines).encode(), ROBOT)


def test_a_path_in_controller_axes_gets_offsets_in_controller_axes(demo):
    """A1..A6 in, offsets of A1..A6 out: they correct as those of the joints do."""
    model = model_file.load(demo / "reports" / "kr500_demo" / "model.toml")
    own = joint_path.read("path.csv", DEMO_PATH.read_bytes(), ROBOT)
    axes = (own.q - ROBOT.controller_offset) @ np.linalg.inv(ROBOT.controller_matrix).T
    head = "pose,E1_m," + ",".join(f"A{j}_deg" for j in range(1, 7)) + ",fx_n,fy_n,fz_n"
    rows = [
        f"{pose},{a[0]!r}," + ",".join(repr(float(v)) for v in (*np.rad2deg(a[1:]), *f))
        for pose, a, f in zip(own.pose, axes.tolist(), own.force, strict=True)
    ]
    path = joint_path.read("path.csv", "\n".join([head, *rows]).encode(), ROBOT)
    found = compensate.compensate(model, path)
    written = joint_path.table(ROBOT, path, found).decode().splitlines()
    first = dict(zip(written[0].split(","), map(float, written[1].split(",")), strict=True))

    assert path.q == pytest.approx(own.q, abs=1e-12)
    assert first["d_A1_deg"] == pytest.approx(-np.rad2deg(found.joints[0, 1]), abs=1e-7)
    assert first["d_A3_deg"] == pytest.approx(-np.rad2deg(found.joints[0, 3]), abs=1e-7)
