"""From a design to what is done: plan file, rehearsal, folder, sheet, power to diagnose."""

import itertools
import json
import tomllib

import numpy as np
import pytest
import scipy.linalg

from bench.reduced import reduce
from pipeline import simulate as simulated
from pipeline.app import cli
from pipeline.base.errors import InputError, UsageError
from pipeline.design import problem
from pipeline.design import spec as specs
from pipeline.design.command import write
from pipeline.design.control import controls
from pipeline.design.curves import by_anchor
from pipeline.design.discriminate import SEPARATED, _covariance, cause_tests, detectabilities, rows
from pipeline.design.finished import FinishedDesign
from pipeline.design.information import information, station
from pipeline.design.library import added_to
from pipeline.design.measurement import Measurement, of_plan, seen_by
from pipeline.design.plan_sheet import SheetExtras, _log, expected, sheet
from pipeline.design.planfile import plan_content
from pipeline.design.prior_information import information_of
from pipeline.design.problem import with_steps
from pipeline.design.propose import BoundedPlan
from pipeline.design.schedule import crossed, pulls_at, starts
from pipeline.design.search import Plan, evaluate
from pipeline.design.trade import feasible_poses, products, trade
from pipeline.library.campaign import load_campaign
from pipeline.machine.cell import jacobian, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load
from pipeline.simulate import build, parse, simulate
from pipeline.store.campaign import find, in_memory
from pipeline.system.estimate import identify
from pipeline.tables import conform

pytestmark = pytest.mark.whole

SEED = 20261121


def changed(which, **changes):
    spec = specs.revised(specs.parse(specs.shipped(which)), changes)
    return problem.build(spec, load(spec.robot))


@pytest.fixture(scope="module")
def realistic():
    """Six poses, two load steps, a tracker and a scale with their whole budgets."""
    return changed(
        "diagnosis_reference",
        name="six",
        plan={"poses": 6, "readings": 12},
        pull={"steps_n": [4000.0, 1500.0]},
        diagnosis=None,
    )


@pytest.fixture(scope="module")
def proposal(realistic):
    """Random feasible poses: a plan need not be good to be carried out."""
    anchor = np.array([2.5, 6.0, -0.891])
    q = feasible_poses(realistic, anchor, np.random.default_rng(SEED), 6)
    slides = realistic.robot.prismatic
    q = np.where(slides, q.round(6), np.deg2rad(np.rad2deg(q).round(6)))
    return BoundedPlan(realistic, evaluate(realistic, q[None], anchor[None])[0], None, "by chance")


def reduced(files):
    raw = in_memory(files)
    return raw, reduce(raw, lambda _, table, promise: conform(table, promise).to_pandas()).data


def text_of(content):
    from pipeline.base import toml

    return toml.dumps(content)


def test_a_rehearsal_is_as_uncertain_as_the_design_says(proposal):
    """Simulated, read back and solved by the stages, the test pose's error is the plan's figure."""
    made = proposal.problem
    plan = parse(text_of(plan_content(proposal)))
    raw, data = reduced(simulate(plan).files)
    cell = paper_cell(raw.robot, made.tool)
    system, estimate = identify(cell, data, raw.robot.nominal_compliance)
    spec = made.spec.test_pose[0]
    q = np.where(raw.robot.prismatic, spec.q, np.deg2rad(spec.q))[None]
    none, number = np.zeros(1), np.arange(1)
    pulls = Pulls(number, number, q, np.array([spec.force_n]), none, none, none, none)
    A = jacobian(cell, pulls, estimate.value)[0, 0]
    figure = np.sqrt(np.trace(A @ estimate.cov @ A.T))

    assert figure == pytest.approx(proposal.figure, rel=0.03)
    known = information_of(system, estimate, made.experiment.scale)
    assert known == pytest.approx(
        proposal.plan.M, rel=0.1, abs=0.02 * np.abs(proposal.plan.M).max()
    )


def test_the_plan_file_is_the_measurement(proposal):
    """Poses, approach, anchor and steps reach the virtual cell unchanged."""
    measurement = proposal.measurement
    plan = parse(text_of(plan_content(proposal)))
    scene = build(plan, load(plan.robot), np.random.default_rng(0))
    first = scene.pulls.repeat == 1

    assert scene.pulls.q[first] == pytest.approx(measurement.q, abs=1e-9)
    assert np.array_equal(scene.pulls.approach[first], measurement.approach)
    assert scene.anchor == pytest.approx(np.tile(measurement.anchor, (6, 1)))
    assert np.linalg.norm(scene.pulls.force, axis=1) == pytest.approx(np.tile([4000, 1500], 6))
    assert np.array_equal(scene.pulls.branch, np.tile([1, -1], 6))
    rehearsed = scene.pulls.time - scene.pulls.time_zero
    made = pulls_at(
        proposal.problem.experiment,
        measurement.q,
        measurement.anchor,
        measurement.approach,
        measurement.steps[0],
        starts(np.full(6, 2)),
    )
    assert made.time - made.time_zero == pytest.approx(rehearsed)
    assert np.diff(made.time) == pytest.approx(np.diff(scene.pulls.time))


def test_poses_with_steps_of_their_own():
    """Each pose gets its pulls, branches and times; a minus sign is a step slackened to."""
    plan = parse(
        'name = "own"\n[poses]\ncount = 3\n[pulls]\n'
        "pose_steps_n = [[3000], [-2500], [1200, 3000, 900]]"
    )
    scene = build(plan, load("kr500_rail"), np.random.default_rng(1))
    pulls = scene.pulls

    assert pulls.pose.tolist() == [1, 2, 3, 3, 3]
    assert pulls.repeat.tolist() == [1, 1, 1, 2, 3]
    assert pulls.branch.tolist() == [1, -1, 1, 1, -1]
    assert np.linalg.norm(pulls.force, axis=1) == pytest.approx([3000, 2500, 1200, 3000, 900])
    assert (np.diff(pulls.time) > 60).all()
    assert (np.diff(pulls.time_zero) >= 0).all()
    groups = {
        line.split(",")[0] for line in simulate(plan).files["tracker.csv"].decode().splitlines()
    }
    assert {"pose01_rep2_unloaded", "pose03_rep4_unloaded", "pose03_rep3_loaded"} <= groups
    assert "pose01_rep4_unloaded" not in groups


@pytest.mark.parametrize("steps", ["[[3000], [2000]]", "[[], [], []]", "[[3000], [0], [1000]]"])
def test_steps_that_do_not_fit_the_poses_are_refused(steps):
    """One list per pose, not all of them empty, no step zero."""
    with pytest.raises(InputError, match="pose_steps_n"):
        parse(f"[poses]\ncount = 3\n[pulls]\npose_steps_n = {steps}")


def test_the_carriage_comes_both_ways_for_either_sign_of_the_pull():
    """Approach and pull along the rail are crossed as evenly as they can be."""
    rng = np.random.default_rng(SEED)
    direction = rng.normal(size=(14, 3))
    approach = crossed(direction, rng.uniform(size=14))

    for side in (direction[:, 1] >= 0, direction[:, 1] < 0):
        assert abs(approach[side].sum()) <= 1


def test_sizes_are_those_of_plain_least_squares(proposal):
    """At its smallest nameable size a cause is 4.6 sigmas from every rival, solved one by one."""
    made = proposal.problem
    view, measurement = cause_tests(made), proposal.measurement
    steps, start_s = measurement.steps[0], starts(np.full(6, 2))
    X = rows(view, measurement.q, measurement.anchor, measurement.approach, steps, start_s)
    X = X.reshape(-1, X.shape[-1])
    found = {sight.name: sight for sight in seen_by(view, measurement)}
    columns = {i: X[:, at[at >= 0]] for i, at in enumerate(view.at)}

    def left(of, *by):
        base = np.hstack([X[:, : view.springs], *by])
        base = base / np.maximum(np.linalg.norm(base, axis=0), 1e-300)
        U, s, _ = np.linalg.svd(base, full_matrices=False)
        U = U[:, s > 1e-6 * s[0]]
        rest = of - U @ (U.T @ of)
        return np.sqrt(np.sum(rest**2) / of.shape[1])  # each parameter at typical size by itself

    checked = 0
    for i in np.flatnonzero(view.main):
        name = view.names[view.group[i]]
        if " = " in name or not 0.05 < found[name].named_from < 20:
            continue
        rivals = [j for j in columns if view.group[j] != view.group[i]]
        apart = min(left(columns[i], columns[j]) for j in rivals)
        if found[name].named_from > found[name].detected_from * 1.0001:
            assert SEPARATED / apart == pytest.approx(found[name].named_from, rel=2e-3)
            checked += 1

    assert checked >= 15


def test_whitened_springs_are_the_information(proposal):
    """The columns of the diagnosis and the information of the search agree about the springs."""
    made, measurement = proposal.problem, proposal.measurement
    view = cause_tests(made)
    X = rows(
        view,
        measurement.q,
        measurement.anchor,
        measurement.approach,
        measurement.steps[0],
        np.zeros(6),
    )[..., : view.springs]
    at = station(made.experiment, measurement.q, measurement.anchor)

    assert np.swapaxes(X, 1, 2) @ X == pytest.approx(information(made.experiment, at), rel=1e-7)


def test_more_load_steps_never_hide_a_cause(proposal):
    """With a third step added at every pose, nothing is noticed or named later than before."""
    view, m = cause_tests(proposal.problem), proposal.measurement
    more = Measurement(m.q, m.anchor, m.approach, (np.array([4000.0, 1500.0, 600.0]),) * 6)
    before, after = ({s.name: s for s in seen_by(view, one)} for one in (m, more))

    assert all(after[k].detected_from <= before[k].detected_from * 1.001 for k in before)
    assert sum(s.named_from <= 1 for s in after.values()) >= sum(
        s.named_from <= 1 for s in before.values()
    )


def test_twins_are_one_cause_and_what_the_springs_hide_is_never_named(proposal):
    """Joint 5 and 6 tilt alike; yaw and gain hide in the stiffnesses."""
    found = {sight.name: sight for sight in proposal.sights()}

    assert "joint_tilt:5 = joint_tilt:6" in found
    assert found["rail_yaw"].named_from == np.inf
    assert found["scale_gain"].detected_from == np.inf
    assert found["scale_gain"].needs


@pytest.mark.slow
def test_an_exchange_names_more_within_what_is_allowed(proposal):
    """Poses, loads and approaches change, the readings and the criterion stay in bounds."""
    made = changed(
        "diagnosis_reference",
        plan={"poses": 8, "readings": 8},
        diagnosis={"poses": 6, "allowed": 1.6},
        limits={"max_relative_std": 2.0},
    )
    anchor = np.array([2.5, 6.0, -0.891])
    q = feasible_poses(made, anchor, np.random.default_rng(4), 8)
    plan = evaluate(made, q[None], anchor[None])[0]
    view, asked, rng = cause_tests(made), made.spec.diagnosis, np.random.default_rng(1)
    first, *_, last = trade(view, plan, asked, rng, sweeps=3, tried=24, pool=40, restarts=1)
    pulls = sum(len(visit.steps) for visit in last.visits)

    assert last.named > 0
    assert last.worth > first.worth
    assert last.figure <= 1.6 * plan.figure
    assert pulls == 8
    assert len(last.visits) == 6
    again = {s.name: s.named_from for s in detectabilities(view, products(last.visits))}
    assert last.named == sum(size <= 1 for size in again.values())


@pytest.mark.whole
def test_readings_that_cannot_be_shared_are_refused():
    """Nine poses with one or two pulls cannot make four readings."""
    made = changed("diagnosis_reference", plan={"poses": 4, "readings": 4}, diagnosis={"poses": 9})
    anchor = np.array([2.5, 6.0, -0.891])
    q = feasible_poses(made, anchor, np.random.default_rng(4), 4)
    plan = evaluate(made, q[None], anchor[None])[0]

    with pytest.raises(InputError, match="4 readings cannot be shared among 9 poses"):
        next(trade(cause_tests(made), plan, made.spec.diagnosis, np.random.default_rng(1), 1, 8))


def test_the_sheet_says_what_to_do_and_what_to_expect(proposal):
    """Every pose with its pulls, turns of the turnbuckle, tracker groups and expected motion."""
    report = sheet(proposal, SheetExtras(proposal.sights()), 1.0)
    words = json.dumps([block for s in report.sections for block in map(str, s.blocks)])
    moved = expected(proposal.problem, proposal.measurement)

    for pose, pull in itertools.product(range(1, 7), (1, 2)):
        assert f"pose{pose:02d}_rep{pull}_loaded" in words
    assert "slacken to" in words
    assert "tighten to" in words
    assert len(report.figures) == 7
    assert moved[0][1] == pytest.approx(moved[0][0] * 1500 / 4000)


def test_the_sheet_gives_the_axes_of_the_controller(proposal):
    """Axes of the sheet, mm and degrees, turn back into the joint values of the plan."""
    report = sheet(proposal, SheetExtras(proposal.sights()), 1.0)
    tables = {b.name: b for s in report.sections for b in s.blocks if hasattr(b, "rows")}
    robot = proposal.problem.robot
    rows = [row[1 : 1 + len(robot.controller)] for row in tables["axes"].rows]
    axes = np.array([[float(cell.text) for cell in row] for row in rows]) * [1e-3, *6 * [1.0]]
    turned = np.where(robot.prismatic, robot.controller_offset, np.rad2deg(robot.controller_offset))
    back = axes @ robot.controller_matrix.T + turned
    q = np.where(robot.prismatic, proposal.plan.q, np.rad2deg(proposal.plan.q))

    assert [c.title for c in tables["axes"].columns[1:3]] == ["E1 [mm]", "A1 [deg]"]
    digit = 0.5e-2 * np.array([1e-3, *6 * [1.0]])  # half of the last one that is shown
    assert (np.abs(back - q) <= 1.001 * np.abs(robot.controller_matrix) @ digit).all()


def test_each_pose_says_where_to_drive_and_how_to_pull(proposal):
    """Axes of the controller stand beside the picture; the same step again needs a release."""
    measurement = proposal.measurement
    twice = Measurement(
        measurement.q, measurement.anchor, measurement.approach, (np.array([3000.0, 3000.0]),) * 6
    )
    report = sheet(proposal, SheetExtras(proposal.sights()), 1.0)
    axes = next(
        block for s in report.sections for block in s.blocks if getattr(block, "name", "") == "axes"
    )
    for number, section in enumerate(s for s in report.sections if s.title.startswith("Pose ")):
        said = section.blocks[0].text
        assert all(cell.text in said for cell in axes.rows[number][1:8])
        way = "rising" if measurement.approach[number] > 0 else "falling"
        assert f"the carriage arrives with r {way}" in said
    moved = expected(proposal.problem, twice)
    turned = [row[1].text for row in _log(proposal.problem, 0, twice.steps[0], moved).rows]

    assert turned == ["tighten to", "release, tighten to"]


@pytest.fixture(scope="module")
def readings(proposal):
    """What the readings of the plan would tell of each other."""
    return controls(proposal.problem, proposal.measurement)


def test_a_plan_knows_which_readings_nobody_will_control(proposal, readings):
    """That of the scale is what g' W (I - H) g of the whole plan gives, in plain numpy."""
    view, measurement = cause_tests(proposal.problem), proposal.measurement
    steps, zero = measurement.steps[0], np.zeros(len(measurement.q))
    made = with_steps(proposal.problem, steps)
    V = _covariance(made, measurement.q, measurement.anchor)
    X = rows(view, measurement.q, measurement.anchor, measurement.approach, steps, zero)
    B = np.linalg.cholesky(V) @ X[:, :, : view.springs]
    force = next(one for one in readings if one.source == "force_reading")
    size = made.scatter.force_std[force.pull - 1]
    g = np.zeros((len(V), len(steps), B.shape[1] // len(steps)))
    moved = B.sum(axis=2).reshape(g.shape) / np.abs(steps)[:, None]
    g[force.pose - 1, force.pull - 1] = size * moved[force.pose - 1, force.pull - 1]
    W, B, g = np.linalg.inv(scipy.linalg.block_diag(*V)), np.concatenate(B), g.ravel()
    r = g @ (W - W @ B @ np.linalg.pinv(B.T @ W @ B) @ B.T @ W) @ g

    assert force.r == pytest.approx(r, rel=1e-6)
    assert force.visible == pytest.approx(4.1321 * size / np.sqrt(r), rel=1e-4)
    assert {one.source for one in readings} == {"tracker", "zero", "force_reading"}


def test_the_sheet_says_which_readings_nobody_controls(proposal, readings):
    """Ten of them, the least controlled first, and the one that does most harm unseen."""
    report = sheet(proposal, SheetExtras(proposal.sights(), controls=readings), 1.0)
    section = next(s for s in report.sections if s.key == "control")
    worst = max(readings, key=lambda one: one.moves)

    assert len(section.blocks[1].rows) == 10
    assert [one.r for one in readings] == sorted(one.r for one in readings)
    assert f"pose {worst.pose}" in section.blocks[0].text


@pytest.mark.whole
def test_each_place_of_the_anchor_is_searched_as_if_alone(proposal):
    """All are searched together; the anchor stays where it is, and poses anew are no worse."""
    both, alone = (
        by_anchor(proposal.problem, proposal.plan, np.array(at), 1, starts=1)
        for at in ([1.5, 3.0], [1.5])
    )

    assert both.figure[0] == pytest.approx(alone.figure[0], rel=1e-6)
    assert both.fixed_poses[0] == pytest.approx(alone.fixed_poses[0], rel=1e-12)
    assert (both.figure <= both.fixed_poses * 1.001).all()


@pytest.fixture(scope="module")
def written(proposal, tmp_path_factory):
    root = tmp_path_factory.mktemp("project")
    made = write(root, FinishedDesign(proposal, 1.0, False), seed=1)
    return root, made


@pytest.mark.xdist_group("plan")
def test_a_design_is_written_as_plan_and_sheet(written):
    """The plan is TOML that simulate reads; page and PDF stand beside its pictures."""
    root, made = written
    plan, page, paper, *driven, asked = made.written

    assert parse(plan.read_text()).poses.number == 6
    assert page.read_text().startswith("<!doctype html>")
    assert "sheet.pdf" in page.read_text()
    assert paper.read_bytes().startswith(b"%PDF")
    figures = {p.name for p in (root / "reports" / "plans" / "six" / "figures").iterdir()}
    assert {"pose-1.svg", "pose-6.svg", "sights.svg", "anchor.svg"} <= figures
    assert "pipeline design data/plans/six.problem.toml" in plan.read_text().splitlines()[0]
    assert specs.parse(asked.read_text()).model_dump() == made.proposal.problem.spec.model_dump()
    assert str(plan) in made.as_text()
    assert {one.suffix for one in driven} <= {".src", ".dat", ".xlsx"}


def test_a_plan_written_by_hand_is_not_overwritten(proposal, tmp_path):
    """Only a plan that was designed gives way to a new design."""
    path = tmp_path / "data" / "plans" / "six.toml"
    path.parent.mkdir(parents=True)
    path.write_text("# my own\n")
    with pytest.raises(UsageError, match="by hand"):
        write(tmp_path, FinishedDesign(proposal, 1.0, False), seed=1)

    assert path.read_text() == "# my own\n"


@pytest.mark.xdist_group("plan")
def test_init_prepares_the_folder_from_the_plan(written, capsys):
    """Poses, pulls and tool are filled in; forces, export and base reflectors are left to fill."""
    root, made = written
    plan = str(made.written[0])
    assert cli._exit_code(["init", "cell_a", "--plan", plan, "--root", str(root)]) == 0
    folder = root / "data" / "raw" / "cell_a"
    settings = tomllib.loads((folder / "campaign.toml").read_text())

    assert capsys.readouterr().out.strip() == str(folder)
    assert settings["name"] == "cell_a"
    assert settings["tool"]["load_point"] == [0.15, 0.0, 0.25]
    assert settings["base_frame"] == {}
    assert (folder / "loads.csv").read_text().splitlines()[1:3] == ["1,1,,up", "1,2,,down"]
    assert len((folder / "joints.csv").read_text().splitlines()) == 7
    assert not (folder / "tracker.csv").exists()
    assert cli._exit_code(["init", "cell_a", "--plan", plan, "--root", str(root)]) == 2


@pytest.mark.xdist_group("plan")
def test_simulate_rehearses_the_plan(written):
    """The option --plan does what the argument does."""
    root, made = written
    plan = str(made.written[0])
    code = cli._exit_code(["simulate", "--plan", plan, "--name", "reh", "--root", str(root)])

    assert code == 0
    assert find(root, "reh").read().settings.tool["P1"] == (0.15, 0.0, 0.1)


@pytest.mark.slow
@pytest.mark.xdist_group("plan")
def test_further_poses_build_on_what_is_known(written, realistic):
    """Two more pulls: the new plan is better than the campaign alone and uses its tool."""
    root, made = written
    plan = str(made.written[0])
    assert cli._exit_code(["simulate", "--plan", plan, "--name", "old", "--root", str(root)]) == 0
    base = changed(
        "diagnosis_reference",
        plan={"poses": 3, "readings": 3},
        limits={"max_relative_std": 9.0},
        diagnosis=None,
    )
    further = added_to(base, load_campaign("old", root=root))
    known = further.known
    from pipeline.design.propose import propose
    from pipeline.design.search import Effort

    quick = Effort(first=0, rounds=1, poses=96, settled=8, exchanged=2, bounds=3, directions=24)
    *_, last = propose(further, 3, quick)
    alone = further.criterion.figure(known[None])[0]

    assert further.spec.name == "old_next"
    assert last.figure < alone
    assert last.certificate.figure < last.figure
    at = station(further.experiment, last.plan.q, last.plan.anchor)
    gained = information(further.experiment, at).sum(axis=0)
    assert np.abs(last.plan.M - known - gained).max() < 1e-9 * np.abs(known).max()


@pytest.mark.whole
def test_a_campaign_noisier_than_stated_is_known_less_of(tmp_path):
    """Three times the scatter of the tracker: nearly a ninth of the information, not all of it."""
    base = changed(
        "diagnosis_reference",
        plan={"poses": 3, "readings": 3},
        limits={"max_relative_std": 9.0},
        diagnosis=None,
    )
    traces = []
    for scatter in (1.0, 3.0):
        plan = simulated.Plan(
            name=f"s{scatter:g}", tracker={"noise_scale": scatter}, scale={"gain_sigma": 0.0}
        )
        folder = tmp_path / "data" / "raw" / plan.name
        folder.mkdir(parents=True)
        for file, content in simulate(plan).files.items():
            (folder / file).write_bytes(content)
        known = added_to(base, load_campaign(plan.name, root=tmp_path)).known
        traces.append(np.trace(known[1:, 1:]))

    assert 4 < traces[0] / traces[1] < 10


def test_an_ordinary_plan_crosses_its_approaches(realistic, proposal):
    """`up` and `down` fix the way the carriage comes; otherwise both occur."""
    up = changed("diagnosis_reference", limits={"approach": "up"})
    plan = Plan(proposal.plan.q, proposal.plan.anchor, proposal.plan.M, 1.0, np.ones(7), True)

    assert set(of_plan(up, plan).approach) == {1.0}
    assert set(of_plan(realistic, plan).approach) == {1.0, -1.0}


@pytest.mark.parametrize(
    "said",
    [
        "tracker]\nsigma_m = 1e160",
        "tracker]\nposition = [1e160, 0, 0]",
        "pulls]\nsteps_n = [1e-320]",
        "hidden]\nstiffness = [1e300]",
        "clock]\npull_s = 1e12",
        "scale]\ngain_error = -2",
    ],
)
def test_a_plan_with_numbers_of_no_hall_is_refused(said):
    """The word is named; what could be simulated from it could not be read again."""
    word = said.replace("]\n", ".").split(" =")[0]
    with pytest.raises(InputError, match=rf"{word}.*(should be|good as zero)"):
        parse("[" + said)
