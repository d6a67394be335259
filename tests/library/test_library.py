"""`import pipeline`: the numbers of the commands, checked arguments, K(q) by Pinocchio."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from conftest import without_pages

import pipeline
from bench.as_pinocchio import model as pin_model
from pipeline.app import cli
from pipeline.base.files import sha256
from pipeline.library.compensate import compensate
from pipeline.library.joints import joint_values
from pipeline.library.model_file import dumps
from pipeline.machine.effects import catalogue
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path as JointPath
from pipeline.report.render import render
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import dump

ROOT = Path(__file__).parents[2]
Q_LOG = [8.5, -10.0, 35.0, 39.0, 81.0, 22.0, -10.0]
FORCE_N = np.array([-124.5, -175.4, -209.1])
HEAVY = "numpy", "pandas", "scipy", "pyarrow", "pinocchio", "prefect", "matplotlib"


@pytest.fixture(scope="module")
def ran(tmp_path_factory, small_campaign):
    """The small campaign after `pipeline run`: its project, and the output of --json."""
    root = tmp_path_factory.mktemp("ran")
    folder = root / "data" / "raw" / small_campaign.name
    folder.mkdir(parents=True)
    for name, data in small_campaign.files.items():
        (folder / name).write_bytes(data)
    words = ["run", "small", "--engine", "local", "--root", str(root)]
    with without_pages(), pytest.raises(SystemExit) as end:
        cli.main(words)
    assert end.value.code == 0
    return root


@pytest.fixture(scope="module")
def result(ran):
    """The same campaign from Python, in memory."""
    return pipeline.identify(pipeline.load_campaign(ran / "data" / "raw" / "small"))


@pytest.fixture(scope="module")
def q(result):
    """The test pose of the demo [m] or [rad]."""
    return np.where([True, *[False] * 6], Q_LOG, np.radians(Q_LOG))


def test_the_import_is_quick_and_brings_nothing():
    """Less than 50 ms of processor time, and no numerical library, until a name is used."""
    code = (
        "import sys, time; t = time.process_time(); import pipeline; t = time.process_time() - t\n"
        f"print(t, [n for n in {HEAVY!r} if n in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    seconds, heavy = said.stdout.split(" ", 1)

    assert float(seconds) < 0.05
    assert heavy.strip() == "[]"


def test_every_public_name_is_there_and_documented():
    """Every name in `__all__` can be imported and is documented, and nothing else is lazy."""
    lazy = {name for names in pipeline._FROM.values() for name in names}

    assert set(pipeline.__all__) == lazy
    for name in pipeline.__all__:
        assert getattr(pipeline, name).__doc__, name
        assert name in dir(pipeline)
    with pytest.raises(AttributeError, match="identity"):
        _ = pipeline.identity


def test_the_package_says_that_it_is_typed():
    """py.typed is in the package and in the wheel."""
    packed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]

    assert (ROOT / "pipeline" / "py.typed").is_file()
    assert "py.typed" in packed["package-data"]["pipeline"]


@pytest.mark.whole
def test_a_notebook_shows_a_screen_and_no_bytes(ran, result):
    """A campaign and a result are shown in few lines; stiffnesses are found by name."""
    campaign = pipeline.load_campaign(ran / "data" / "raw" / "small")
    shown = repr(campaign), repr(result), repr(result.stiffness)
    first = result.stiffness[0]

    assert all(len(one) < 2000 and one.count("\n") < 20 for one in shown)
    assert campaign.name in shown[0]
    assert result.verdict in shown[1]
    for name in filter(None, (first.axis, first.joint_name, first.name)):
        assert result.stiffness[name] == first
    with pytest.raises(pipeline.InputError, match='there is no stiffness "A9"; use one of'):
        result.stiffness["A9"]
    table = result.to_frame()
    assert table["value"].tolist() == [one.value for one in result.stiffness]
    assert table["joint"].tolist() == [one.joint_name for one in result.stiffness]
    assert not [name for name in dir(pipeline) if name.startswith("_") and name != "__version__"]
    assert "Any" not in dir(pipeline)


def test_a_force_that_no_robot_holds_is_refused(result, q):
    """Newtons times a thousand: refused as by the commands, for deflection and stiffness."""
    for asked in (result.model.predict, result.model.compensate):
        with pytest.raises(pipeline.InputError, match="forces are in N"):
            asked(q, [0.0, 0.0, -8e5])
    with pytest.raises(pipeline.InputError, match="forces are in N"):
        result.model.cartesian_stiffness(q, force_n=[0.0, 0.0, -8e5])


def test_in_memory_is_the_command_byte_by_byte(ran, result):
    """The answer from Python is result.json, the model is model.toml."""
    reports = ran / "reports" / "small"

    assert dump(result.answer.as_json()) == (reports / "result.json").read_bytes()
    assert dumps(result.model.identified).encode() == (reports / "model.toml").read_bytes()
    said = json.loads((reports / "result.json").read_bytes())
    assert [joint.value for joint in result.stiffness] == [k["value"] for k in said["stiffness"]]
    assert result.verdict == said["diagnosis"]["verdict"]
    assert result.positions is None


def test_a_run_from_python_finds_what_the_command_left(ran, result, q):
    """`run_campaign` computes nothing twice; its model predicts like the one in memory."""
    found = pipeline.run_campaign("small", root=ran)

    assert found.answer == result.answer
    assert "residuals" in found.tables
    ours, theirs = (one.model.predict(q, FORCE_N) for one in (found, result))
    assert np.allclose(ours.displacement_m, theirs.displacement_m, rtol=1e-12)
    assert np.allclose(ours.std_m, theirs.std_m, rtol=1e-9)


def test_the_prediction_is_that_of_the_answer(result, q):
    """Displacement J diag(x) J' f of the load point, doubled by twice the force."""
    point = np.array([0.15, 0.0, 0.25])
    found = result.model.predict(q, [FORCE_N, 2 * FORCE_N], point)
    one = pin_jacobian(result.model.robot, q, point)
    x = result.model.compliance

    assert found.displacement_m[0] == pytest.approx(one[:3] @ (x * (one[:3].T @ FORCE_N)))
    assert found.displacement_m[1] == pytest.approx(2 * found.displacement_m[0])
    assert (found.expanded_m == 2 * found.std_m).all()
    assert found.left_out_rms_m * 1e3 == pytest.approx(result.answer.validation.held_out_rms_mm)


def test_one_pose_has_no_axis_of_poses(result, q):
    """Requests for m poses give m results; each equals that of its pose alone."""
    one = result.model.predict(q, FORCE_N)
    two = result.model.predict([q, q + 0.1], FORCE_N)
    alone, rows = result.model.cartesian_stiffness(q), result.model.cartesian_stiffness([q])

    assert (one.displacement_m.shape, one.std_m.shape, one.cov_m2.shape) == ((3,), (3,), (3, 3))
    assert (two.displacement_m.shape, two.expanded_m.shape) == ((2, 3), (2, 3))
    assert one.displacement_m == pytest.approx(two.displacement_m[0], rel=1e-9)
    assert one.std_m == pytest.approx(two.std_m[0], rel=1e-9)
    assert (alone.stiffness.shape, rows.stiffness.shape) == ((6, 6), (1, 6, 6))
    assert result.model.predict(q, [FORCE_N]).displacement_m.shape == (1, 3)


@pytest.mark.whole
def test_a_result_draws_the_figures_of_its_report(result, tmp_path):
    """Byte by byte; a notebook displays them, and an unknown name is refused with a list."""
    pages = render(result.answer, result.tables)
    for name in ("stiffness", "prediction"):
        picture = result.plot(name)
        assert picture._repr_svg_().encode() == pages[f"figures/{name}.svg"]
        assert picture.save(tmp_path / "one.svg").read_bytes() == pages[f"figures/{name}.svg"]
        assert len(repr(picture)) < 600
    with pytest.raises(pipeline.InputError, match=r'no figure "nothing"; use one of .*stiffness'):
        result.plot("nothing")


def test_an_answer_is_not_written_to(result):
    """The message says what to change instead."""
    with pytest.raises(AttributeError, match="value stays; change a copy"):
        result.stiffness[0].value = 1.0
    with pytest.raises(AttributeError):
        result.verdict = "adequate"
    with pytest.raises(pipeline.UsageError, match="load_campaign"):
        pipeline.identify("small")


@pytest.mark.parametrize("given", [[1.0, 2.0], "home", [[["a"]]], np.zeros((2, 2, 7)), 3.0])
def test_what_is_no_row_of_axes_is_refused(given):
    """The message names the expected axes."""
    robot = pipeline.load_robot("kr500_rail")
    with pytest.raises(pipeline.InputError, match=r"give a number for each of r1, theta2"):
        robot.from_degrees(given)
    with pytest.raises(pipeline.InputError, match=r"give a number for each of .*A1, A2"):
        robot.from_controller(given)


def test_a_wrong_word_is_refused_in_our_words():
    """Not in the words of the validation library."""
    with pytest.raises(pipeline.InputError, match='"three" should be a whole number; correct'):
        pipeline.simulate_campaign(poses="three")


def pin_jacobian(robot, q, point):
    """Motions of a point of the flange per unit of each joint, by Pinocchio, shape (6, n)."""
    made = pin_model(robot, {"tip": point})
    return pin.computeFrameJacobian(
        made, made.createData(), q, made.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
    )


def test_the_cartesian_stiffness_is_that_of_pinocchio(result, q):
    """Joint springs alone: C = J diag(x) J', at any point of the tool; K is its inverse."""
    point = np.array([0.3, -0.2, 0.4])
    found = result.model.cartesian_stiffness([q, q + 0.1], point)
    for k, pose in enumerate((q, q + 0.1)):
        J = pin_jacobian(result.model.robot, pose, point)
        C = J @ np.diag(result.model.compliance) @ J.T

        assert found.compliance[k] == pytest.approx(C, rel=1e-9, abs=1e-9 * np.abs(C).max())
        assert found.stiffness[k] @ C == pytest.approx(np.eye(6), abs=1e-6)
        assert found.translational[k] @ C[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)


def test_the_uncertainty_of_the_stiffness_is_that_of_draws(result, q):
    """Compliances drawn from their covariance scatter K as stated."""
    found = result.model.cartesian_stiffness(q)
    J = pin_jacobian(result.model.robot, q, result.model.identified.tool.load_point)
    x, cov = result.model.compliance, result.model.compliance_cov
    draws = np.random.default_rng(20261123).multivariate_normal(x, cov, 4000)
    C = (J * draws[:, None, :]) @ J.T

    assert np.linalg.inv(C).std(axis=0) == pytest.approx(found.stiffness_std, rel=0.06)
    translational = np.linalg.inv(C[:, :3, :3]).std(axis=0)
    assert translational == pytest.approx(found.translational_std, rel=0.06)


@pytest.fixture(scope="module")
def doubtful(result):
    """A model that hardens at joint 3 or tilts at joint 2, undecided."""
    (known,) = result.model.identified.hypotheses
    parts = []
    for label, weight in (("joint_hardening:3", 0.7), ("joint_tilt:2", 0.3)):
        more = next(one for one in catalogue(known.cell.robot) if one.label == label)
        sizes = [p.typical for p in more.parameters]
        value, k = np.append(known.value, sizes), len(known.value)
        cov = np.diag(np.square(0.1 * value))
        cov[:k, :k] = known.cov
        cell = known.cell.with_effects(more)
        parts.append(replace(known, weight=weight, cell=cell, value=value, cov=cov))
    said = result.model.identified
    return pipeline.Model(
        IdentifiedModel(said.campaign, said.verdict, said.recommended, tuple(parts))
    )


def test_the_stiffness_of_a_model_with_causes_is_its_slope(doubtful, q):
    """With nonlinear laws and different rivals, C is the slope of predicted points by force."""
    points = np.array([0.15, 0.0, 0.25]) + np.vstack([np.zeros(3), np.eye(3)])
    force = 2000.0 * np.array([0.3, -0.8, 0.5])
    model = doubtful.identified
    ahead, behind = (
        model.positions(np.tile(q, (3, 1)), force + step * np.eye(3), points).loaded
        for step in (1.0, -1.0)
    )
    slope = (ahead - behind) / 2  # by the force, of the point, along the axis
    at = model.positions(q[None], force[None], points).unloaded[0]
    C = doubtful.cartesian_stiffness(q, points[0], force).compliance

    assert C[:3, :3] == pytest.approx(slope[:, 0].T, rel=1e-5, abs=1e-14)
    for k in range(3):
        turned = np.cross(C[3:, k], at[1:] - at[0])
        assert turned == pytest.approx(slope[k, 1:] - slope[k, 0], rel=1e-4, abs=1e-13)


def test_stiffness_and_prediction_are_equally_uncertain(doubtful, q):
    """For small forces, the covariance of C f is that of the predicted deflection."""
    force = np.array([0.3, -0.8, 0.5])
    found, said = doubtful.cartesian_stiffness(q), doubtful.predict(q, force)
    cov = found.compliance_cov.reshape(6, 6, 6, 6)[:3, :3, :3, :3]

    assert found.compliance[:3, :3] @ force == pytest.approx(said.displacement_m, rel=1e-5, abs=0)
    spread = np.einsum("iajb,a,b->ij", cov, force, force)
    assert spread == pytest.approx(said.cov_m2, rel=1e-4, abs=1e-6 * said.cov_m2.max())


def test_what_is_not_determined_has_no_stiffness(result, q):
    """A joint of infinite variance that acts makes the uncertainty of every entry infinite."""
    (known,) = result.model.identified.hypotheses
    cov = known.cov.copy()
    cov[1, 1] = np.inf
    open_ = replace(result.model.identified, hypotheses=(replace(known, cov=cov),))

    assert np.isinf(pipeline.Model(open_).cartesian_stiffness(q).stiffness_std).all()
    assert np.isinf(pipeline.Model(open_).predict(q, FORCE_N).std_m).any()


WRONG = [
    (lambda q: np.array(Q_LOG), r"joint 2 \(theta2\): -10 rad is beyond .*robot\.from_degrees"),
    (lambda q: q * [1000, *[1] * 6], r"joint 1 \(r1\): 8500 m is beyond 0\.\.18 m; .*1000"),
    (lambda q: q[:6], r"q has shape \(6,\), and kr500_rail has 7 joints: r1 \[m\], theta2 \[rad\]"),
    (
        lambda q: [q, [8, 0, np.pi * 200 / 180, 0, 0, 0, 0]],
        r"joint 3 \(theta3\) of row 2: 200 deg is beyond -20\.\.130 deg; ",
    ),
    (lambda q: [*q[:6], np.nan], r"q\[6\] is nan"),
    (lambda q: "home", "q is no array of numbers"),
    (lambda q: np.zeros((0, 7)), r"q has shape \(0, 7\)"),
]


@pytest.mark.parametrize(("spoil", "said"), WRONG)
@pytest.mark.parametrize("method", ["predict", "cartesian_stiffness", "compensate"])
def test_joint_values_are_checked(result, q, method, spoil, said):
    """Degrees, millimetres, a missing joint and a pose beyond a limit are refused by name."""
    more = () if method == "cartesian_stiffness" else (FORCE_N,)

    with pytest.raises(pipeline.InputError, match=said):
        getattr(result.model, method)(spoil(q), *more)


@pytest.mark.parametrize(
    ("force", "said"),
    [
        ([1.0, 2.0], r"force_n has shape \(2,\)"),
        (np.ones((3, 3)), "3 forces for 2 poses"),
        ([0, 0, np.inf], r"force_n\[2\] is inf"),
    ],
)
def test_forces_are_checked(result, q, force, said):
    """x, y, z in N, one for all poses or one for each."""
    with pytest.raises(pipeline.InputError, match=said):
        result.model.predict([q, q], force)


def test_points_in_millimetres_are_refused(result, q):
    """No effector reaches 150 m from its flange."""
    with pytest.raises(pipeline.InputError, match=r"point_m lies 250 m off the flange; .*1000"):
        result.model.predict(q, FORCE_N, [150, 0, 250])


def test_a_joint_without_limits_turns_twice_at_most():
    """More than two turns must be in degrees, also if the robot file has no limits."""
    table = pipeline.load_robot("ur10").text
    free = parse_robot(re.sub("(?m)^(lower|upper)_deg.*$", "", table), "free.toml")
    turns = joint_values(free, np.full(6, 3 * np.pi))

    assert turns.shape == (1, 6)
    with pytest.raises(pipeline.InputError, match=r"-70 rad is beyond two turns; .*degrees"):
        joint_values(free, [0, -70, 80, -100, -90, 20])


def test_degrees_become_joint_values():
    """Metres stay, degrees turn into radians."""
    robot = pipeline.load_robot("kr500_rail")

    assert robot.from_degrees(Q_LOG)[0] == 8.5
    assert robot.from_degrees([Q_LOG])[0, 1:] == pytest.approx(np.radians(Q_LOG[1:]))


def test_a_virtual_campaign_is_that_of_the_command(tmp_path):
    """Plan, options and seed give the same bytes from Python and from the shell."""
    words = "simulate --name twin --poses 3 --step 1500 --effect rail_roll=2x --seed 7 --spread 0.2"
    with pytest.raises(SystemExit) as end:
        cli.main([*words.split(), "--root", str(tmp_path)])
    made = pipeline.simulate_campaign(
        name="twin", poses=3, steps_n=[1500.0], effects=["rail_roll=2x"], seed=7,
        stiffness_spread=0.2,
    )  # fmt: skip
    folder = tmp_path / "data" / "raw" / "twin"

    assert end.value.code == 0
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == made.campaign.files
    sealed = (tmp_path / "data" / "processed" / "twin.truth.json").read_bytes()
    digests = {name: sha256(data) for name, data in made.campaign.files.items()}
    assert dump({**made.truth, "files": digests}) == sealed
    with pytest.raises(pipeline.UsageError, match="is there already"):
        made.campaign.save(tmp_path)
    kept = pipeline.load_campaign(made.campaign.save(tmp_path / "other"))
    assert kept.files == made.campaign.files
    assert kept.name == "twin"


def test_a_campaign_in_memory_says_what_is_missing():
    """A name without a folder, or files without campaign.toml."""
    files = dict(simulate(Plan(poses={"count": 2})).files)
    with pytest.raises(pipeline.InputError, match="begins with a dot"):
        pipeline.load_campaign(files, name=".hidden")
    del files["campaign.toml"]
    with pytest.raises(pipeline.InputError, match=r"no campaign\.toml"):
        pipeline.load_campaign(files)
    with pytest.raises(pipeline.InputError, match='no campaign "nowhere"'):
        pipeline.load_campaign("nowhere")


def test_the_offsets_are_those_of_a_path(result, q):
    """With the joint offsets the loaded tip is at its unloaded position, to a micrometre."""
    found = result.model.compensate(q, FORCE_N)
    moved = result.model.predict(q + found.joints[0], FORCE_N)
    tip = result.model.identified.tool.load_point
    robot = result.model.robot
    before, after = (placed(robot, at, tip) for at in (q, q + found.joints[0]))

    assert np.linalg.norm(found.shift[0]) > 5e-4
    assert after + moved.displacement_m == pytest.approx(before, abs=1e-6)


def test_joints_that_are_held_take_no_part_in_the_offsets(result, q):
    """A held one stays; the six others still bring the tip to where it would be unloaded."""
    model = result.model.identified
    held = np.arange(model.robot.n) == 3
    path = JointPath(np.array([1]), q[None], FORCE_N[None], controller=False)
    free, some = compensate(model, path), compensate(model, path, held=held)

    assert np.all(free.joints != 0.0)
    assert np.all(some.joints[:, held] == 0.0)
    assert np.all(some.joints[:, ~held] != 0.0)
    assert some.left[0] < 1e-6 < some.deflection[0]


def placed(robot, q, point):
    """Position of a point of the flange, by Pinocchio [m]."""
    made = pin_model(robot, {"tip": point})
    data = made.createData()
    pin.framesForwardKinematics(made, data, q)
    return data.oMf[made.getFrameId("tip")].translation


@pytest.mark.slow
def test_a_design_is_that_of_the_command(tmp_path, capsys):
    """Poses, figure and bound are what `pipeline design --json` prints."""
    words = "design paper_reference --poses 3 --readings 3 --rounds 1 --seed 3 --json"
    with pytest.raises(SystemExit):
        cli.main([*words.split(), "--root", str(tmp_path)])
    said = json.loads(capsys.readouterr().out)
    found = pipeline.design_poses(poses=3, readings=3, rounds=1, seed=3)

    degrees = np.where([True, *[False] * 6], found.q, np.degrees(found.q))
    assert degrees == pytest.approx(np.array(said["poses"]), abs=1e-6)
    assert found.figure * 1e3 == pytest.approx(said["epsilon_mm"], rel=1e-12)
    assert found.bound * 1e3 == pytest.approx(said["bound_mm"], rel=1e-12)
    assert "[poses]" in found.plan


@pytest.mark.slow
def test_positions_are_those_of_the_command(tmp_path, capsys):
    """Positions of a UR10: `pipeline predict` and Python give the same numbers."""
    shutil.copytree(ROOT / "data" / "raw" / "ur10_ipa", tmp_path / "data" / "raw" / "ur10_ipa")
    found = pipeline.run_campaign("ur10_ipa", root=tmp_path)
    asked = tmp_path / "poses.csv"
    asked.write_text("theta1_deg,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg\n"
                     "10,-70,80,-100,-90,20\n")  # fmt: skip
    with pytest.raises(SystemExit):
        cli.main(["predict", "ur10_ipa", str(asked), "--root", str(tmp_path)])
    head, row, *_ = capsys.readouterr().out.splitlines()
    said = dict(zip(head.split(","), row.split(","), strict=True))
    made = found.positions.predict(np.radians([10, -70, 80, -100, -90, 20]))

    for k, axis in enumerate("xyz"):
        assert made.position_m[0, k] == pytest.approx(float(said[f"{axis}_m"]), abs=1e-9)
        assert made.std_m[0, k] == pytest.approx(float(said[f"std_{axis}_m"]), abs=1e-9)
    with pytest.raises(pipeline.InputError, match='payload "anvil" is not known'):
        found.positions.predict(np.zeros(6), payload="anvil")
