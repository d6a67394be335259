"""Combinations of joints that are determined, against fits of numpy on whole matrices."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse

from pipeline.app.outcome import outcome
from pipeline.design.parting import parting
from pipeline.diagnosis.average import Hypothesis, information, together
from pipeline.library import model_file
from pipeline.library.compensate import compensate
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.prediction.model import part
from pipeline.prediction.path import Path
from pipeline.reduction.bring import conformed
from pipeline.report.render import render
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import CampaignFolder, dump, in_memory
from pipeline.system.estimate import solve
from pipeline.system.system import Errors, RowIndex, System
from tests.made_system import any_system, dense

TOOL = {
    "load_point": (0.15, 0.0, 0.25),
    "P1": (0.20, 0.05, 0.12),
    "P2": (-0.12, 0.19, 0.10),
    "P3": (-0.10, -0.18, 0.22),
}
FANUC = load("fanuc_r2000ic")
X = FANUC.nominal_compliance


def few(poses, steps, targets):
    """A campaign of tracker readings with these numbers of poses, load steps and targets."""
    plan = Plan(name="few", poses={"count": poses}, pulls={"steps_n": [3000.0] * steps})
    plan = plan.model_copy(update={"tool": dict(list(plan.tool.items())[: 1 + targets])})
    return dict(simulate(plan).files)


def csv(head, rows):
    """A table as the bytes of a CSV file, with all digits."""
    lines = [head, *(",".join(str(cell) for cell in row) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def hung(q, force, sigma_m, tool=TOOL, seed=1):
    """A reduced campaign of the FANUC on the floor: joint values (m, 6) and forces (m, 3)."""
    rng = np.random.default_rng(seed)
    targets = [name for name in tool if name != "load_point"]
    moved = predict(paper_cell(FANUC, Tool.of(tool)), Pulls.at(q, force), X).displacement
    moved = moved + sigma_m * rng.standard_normal(moved.shape)
    toml = [
        'format = 1\nname = "hung"\nrobot = "fanuc_r2000ic"',
        f'[displacements]\nfile = "d.csv"\nforces = "f.csv"\nsigma_m = {sigma_m}',
        '[joints]\nfile = "j.csv"',
        "[naming]\nmeasured = [" + ", ".join(f'"{name}"' for name in targets) + "]",
        "[tool]\n" + "\n".join(f"{name} = {list(at)}" for name, at in tool.items()),
    ]
    number = range(1, len(q) + 1)
    joints = [[p, *map(float, np.rad2deg(row))] for p, row in zip(number, q, strict=True)]
    forces = [[p, 1, *map(float, row)] for p, row in zip(number, force, strict=True)]
    shifts = [
        [p, 1, name, *map(float, at)]
        for p, row in zip(number, moved, strict=True)
        for name, at in zip(targets, row, strict=True)
    ]
    return {
        "campaign.toml": "\n".join([*toml, ""]).encode(),
        "j.csv": csv("pose," + ",".join(f"theta{k}_deg" for k in range(1, 7)), joints),
        "f.csv": csv("pose,repeat,fx_n,fy_n,fz_n", forces),
        "d.csv": csv("pose,repeat,target,dx_m,dy_m,dz_m", shifts),
    }


def of_two_joints(poses=197, sigma_m=2e-4):
    """Weights hung below the last axis, only first and last joint vary: effectively one pose."""
    rng = np.random.default_rng(7)
    q = np.tile([0.0, 0.3, -0.2, 0.4, -1.1, 0.2], (poses, 1))
    q[:, [0, 5]] = rng.uniform(-2.0, 2.0, (poses, 2))
    tool = {"load_point": (0.0, 0.0, 0.25), "P1": (0.0, 0.0, 0.25)}
    return hung(q, np.tile([0.0, 0.0, -600.0], (poses, 1)), sigma_m, tool)


def never_loaded():
    """Weights hung at poses of every joint: none has a lever about the vertical first axis."""
    rng = np.random.default_rng(5)
    q = rng.uniform(np.maximum(FANUC.lower, -1.5), np.minimum(FANUC.upper, 1.5), (12, 6))
    return hung(q, np.tile([0.0, 0.0, -1500.0], (12, 1)), 3e-5)


WORLDS = {
    "one pull": lambda: few(1, 1, 3),
    "one pull of one reflector": lambda: few(1, 1, 1),
    "two pulls of one reflector": lambda: few(2, 1, 1),
    "three poses": lambda: few(3, 1, 3),
    "a joint never loaded": never_loaded,
    "197 poses of two joints": of_two_joints,
}
TOGETHER = {"one pull": 5, "one pull of one reflector": 2, "two pulls of one reflector": 5}
TOGETHER |= {"three poses": 0, "a joint never loaded": 0, "197 poses of two joints": 3}


@pytest.fixture(scope="module")
def told():
    """Answer and tables of the run for each world."""
    done = {}

    def of(world):
        if world not in done:
            raw, kept = in_memory(WORLDS[world]()), {}

            def keep(name, table, promise):
                return kept.setdefault(name, conformed(name, table, promise))

            done[world] = (raw, campaign_answer(world, raw, keep), kept)
        return done[world]

    return of


def turned(robot, q, points):
    """Points (t, 3) of the flange frame in F_b at joint values (n,), shape (t, 3)."""
    return configure(robot, q[None]).points(points)[0]


def by_differences(robot, q, points):
    """Motion of points by each joint, by finite differences, shape (t, 3, n)."""
    steps = 1e-5 * np.eye(len(q))
    ends = [turned(robot, q + s, points) - turned(robot, q - s, points) for s in steps]
    return np.stack(ends, axis=-1) / 2e-5


def whitened(raw, kept):
    """B and c of the campaign, from its tables and finite differences, whitened by the whole V."""
    robot, names = raw.robot, raw.settings.measured
    at = np.array([raw.settings.tool[name] for name in ("load_point", *names)])
    columns = [f"{j.name}_{'m' if j.prismatic else 'rad'}" for j in robot.joints]
    joints = kept["12_joints"].set_index("pose")[columns]
    forces = kept["22_forces"].set_index(["pose", "repeat"])
    shifts = kept["23_displacements"].set_index(["pose", "repeat", "target"])
    system, errors = kept["30_system"], kept["31_errors"]
    rows = []
    for pose, repeat, target, axis in system[["pose", "repeat", "target", "axis"]].itertuples(
        index=False
    ):
        J = by_differences(robot, joints.loc[pose].to_numpy(float), at)
        force = forces.loc[pose, repeat][["fx_n", "fy_n", "fz_n"]].to_numpy(float)
        here = J[1 + list(names).index(target)]["xyz".index(axis)]
        moved = shifts.loc[pose, repeat, target][f"d{axis}_m"]
        rows.append([*(here * (J[0].T @ force)), moved])
    G = np.zeros((len(system), errors["error"].max() + 1))
    G[errors["row"], errors["error"]] = errors["value_m"]
    L = np.linalg.cholesky(G @ G.T)
    both = np.linalg.solve(L, np.array(rows, float))
    return both[:, :-1], both[:, -1]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("world", list(WORLDS))
def test_what_is_known_is_what_numpy_finds(world, told):
    """Values, uncertainties and undetermined directions: least squares by numpy."""
    raw, found, kept = told(world)
    names = [f"k_{joint.name}" for joint in raw.robot.joints]
    A, y = whitened(raw, kept)
    size = 1 / np.array([joint.typical_stiffness for joint in raw.robot.joints])
    U, s, Vt = np.linalg.svd(A * size)
    rank = int(np.sum(s > 1e-7 * s[0]))
    x = size * (Vt[:rank].T @ ((U.T @ y)[:rank] / s[:rank]))
    half = size[:, None] * Vt[:rank].T / s[:rank]

    assert len(found.answer.combinations) == TOGETHER[world]
    for one in found.answer.combinations:
        w = np.zeros(len(names))
        w[[names.index(name) for name in one.of]] = one.weights
        assert np.abs(w * size @ Vt[rank:].T).max(initial=0) < 1e-6 * np.linalg.norm(w * size)
        assert one.value == pytest.approx(w @ x, rel=1e-6)
        assert one.std == pytest.approx(np.linalg.norm(w @ half), rel=1e-6)
        assert one.ci95[1] - one.value == pytest.approx(1.959964 * one.std, rel=1e-6)
    for k, joint in enumerate(found.answer.stiffness):
        if joint.identifiable:
            assert joint.compliance == pytest.approx(x[k], rel=1e-6)
            assert joint.compliance_std == pytest.approx(np.linalg.norm(half[k]), rel=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("world", list(WORLDS))
def test_undetermined_is_no_rejection(world, told, tmp_path):
    """Exit code 0, with --strict a doubt; JSON, page, PDF and model state what is determined."""
    _, found, _ = told(world)
    done = outcome(
        CampaignFolder(tmp_path, tmp_path / world.replace(" ", "-")), lambda _: found.answer
    )
    pages = render(found.answer, found.shown, 1.0, None)

    assert done.exit_code == 0
    assert done.misfit
    assert b"NaN" not in dump(found.answer.as_json())
    assert {"index.html", "report.pdf"} <= {*pages}
    for one in found.answer.combinations:
        assert one.formula in done.text
        assert one.needs in pages["index.html"].decode()


@pytest.mark.slow
def test_where_it_was_measured_it_is_predicted_and_elsewhere_not(told):
    """One combination suffices for the pose it comes from, also from the delivered file."""
    raw, found, kept = told("197 poses of two joints")
    point = np.array([0.0, 0.0, 0.25])
    q = np.array([0.7, 0.3, -0.2, 0.4, -1.1, 1.3])
    force = np.array([0.0, 0.0, -600.0])
    load_point = np.array(raw.settings.tool["load_point"])
    A, y = whitened(raw, kept)
    x, cov = np.linalg.pinv(A * X, rcond=1e-7) @ y * X, np.linalg.pinv((A * X).T @ (A * X), 1e-13)
    J = by_differences(raw.robot, q, np.array([load_point, point]))
    rows = J[1] * (J[0].T @ force)

    for model in (found.model, model_file.parse(model_file.dumps(found.model))):
        moved, std = model.deflection(q, force)
        assert moved[0] == pytest.approx(rows @ x, abs=2e-6)  # in addition the deflected geometry
        own = np.sqrt(np.diag(rows * X @ cov @ (rows * X).T))
        assert std[0] == pytest.approx(own, abs=2e-6)
        bent = q + np.array([0, 0.5, 0.5, 0, 0.5, 0])
        assert np.isinf(model.deflection(bent, force)[1]).any()
    assert None not in found.answer.test_pose_deflection[0].std_mm


@pytest.mark.whole
def test_a_path_says_where_it_rests_on_what_is_not_known(told):
    """Offsets for two points, one of them where the robot was measured."""
    model = told("197 poses of two joints")[1].model
    q = np.array([[0.7, 0.3, -0.2, 0.4, -1.1, 1.3], [0.7, 0.8, 0.3, 0.4, -0.6, 1.3]])
    path = Path(np.array([1, 2]), q, np.tile([0.0, 0.0, -600.0], (2, 1)), False)

    offsets = compensate(model, path)

    assert np.isfinite(offsets.std).all(axis=1).tolist() == [True, False]
    assert "at 1 of them a stiffness acts" in offsets.summary
    assert "inf" not in offsets.summary


@pytest.mark.sampled(2)
@pytest.mark.parametrize("world", list(WORLDS))
def test_a_combination_is_as_the_contract_says(world, told):
    """One unit, the largest weight 1, no joint with its own value, at least two joints."""
    _, found, _ = told(world)
    stiffness = {joint.name: joint for joint in found.answer.stiffness}
    for one in found.answer.combinations:
        assert max(one.weights, key=abs) == 1
        assert len(one.of) > 1
        assert {stiffness[name].compliance_unit for name in one.of} == {one.unit}
        assert not any(stiffness[name].identifiable for name in one.of)
        assert all(other in stiffness[one.of[0]].finding for other in one.of[1:])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("world", list(WORLDS))
def test_a_model_that_nothing_tests_is_not_said_to_explain(world, told):
    """As many directions as coordinates: the first line claims nothing."""
    answer = told(world)[1].answer

    assert ("leave nothing to test" in answer.verdict_sentence[0]) == (answer.fit.dof == 0)
    assert answer.fit.dof == 0 or world != "one pull of one reflector"


@pytest.mark.whole
def test_a_joint_never_loaded_is_said_to_be_so(told):
    """No weight loads a vertical joint; all others have their value."""
    _, found, _ = told("a joint never loaded")

    first, *others = found.answer.stiffness
    assert "no pull of the campaign puts a torque on the joint" in first.finding
    assert all(joint.identifiable for joint in others)


@pytest.mark.whole
def test_no_reading_that_says_anything_is_no_rejection_either():
    """Noise a thousand times the deflection: nothing is determined, which is the answer."""
    found = campaign_answer("noise", in_memory(of_two_joints(3, 1.0)))

    assert not found.answer.combinations
    assert not any(joint.identifiable for joint in found.answer.stiffness)
    assert "no stiffness and no combination" in " ".join(found.answer.verdict_sentence)


@pytest.mark.whole
def test_one_displacement_has_a_report():
    """All arrows start at one point, which gives a figure no extent."""
    q = np.array([[0.3, 0.2, -0.1, 0.5, -1.0, 0.3]])
    tool = {name: TOOL[name] for name in ("load_point", "P1")}
    found = campaign_answer("one", in_memory(hung(q, np.array([[0.0, 300.0, -900.0]]), 1e-5, tool)))

    assert {"index.html", "report.pdf"} <= {*render(found.answer, found.shown, 1.0, None)}


def hypothesis(system, weight):
    """The solution of a system as one of several that may be true."""
    cell = paper_cell(FANUC, Tool.of(TOOL))
    return Hypothesis(weight, (), cell, system, solve(system, system.typical))


@pytest.mark.parametrize("ratio", [1.0, 2.5])
def test_what_the_rows_determine_is_as_uncertain_in_the_model(ratio):
    """Every row that was measured, by the pseudoinverse; times what the residuals say; none else.

    Parameters by themselves are undetermined: six from rows of three directions.
    """
    system = any_system(np.random.default_rng(8), 6, 3)
    estimate = solve(system, system.typical)
    wider = replace(estimate, cov=estimate.cov * ratio**2)
    cell = paper_cell(FANUC, Tool.of(TOOL))
    W = np.linalg.inv(np.linalg.cholesky(dense(system)))
    A = W @ system.B * system.typical
    cov = np.linalg.pinv(A.T @ A, rcond=1e-12) * np.outer(system.typical, system.typical)

    one = part(1.0, cell, wider, system, ratio)

    rows = system.B[:, None]
    expected = np.einsum("mjk,kl,mil->mji", rows, cov, rows)
    np.testing.assert_allclose(one.through(rows), ratio**2 * expected, rtol=1e-6)
    assert np.isinf(one.through(0.1 * np.diag(1 / system.typical)[:, None])).all()


def test_over_hypotheses_a_mix_is_their_mixture_and_known_to_each():
    """Mean and variance over both; a direction that one of them leaves open is not stated."""
    rng = np.random.default_rng(3)
    one = any_system(rng, 6, 3)
    other = replace(one, c=one.c + 1e-4 * rng.standard_normal(40))
    B = one.B - np.outer(one.B @ (v := rng.standard_normal(6) * one.typical), v / (v @ v))
    less = replace(one, B=np.ascontiguousarray(B))
    alone = np.zeros(6, bool)

    def of(*systems):
        both = [hypothesis(s, w) for s, w in zip(systems, (0.7, 0.3), strict=False)]
        return both, together(both, information(both), alone)

    both, mixed = of(one, other)
    narrower, fewer = of(one, less)

    assert len(mixed) == 3
    for mix in mixed:
        x = np.array([h.estimate.value[mix.of] @ mix.weights for h in both])
        own = dense(one)
        A = np.linalg.inv(np.linalg.cholesky(own)) @ one.B * one.typical
        w = np.zeros(6)
        w[mix.of] = mix.weights
        w = w * one.typical
        variance = w @ np.linalg.pinv(A.T @ A, rcond=1e-12) @ w
        mean = 0.7 * x[0] + 0.3 * x[1]
        assert mix.value == pytest.approx(mean, rel=1e-6)
        spread = 0.7 * (x[0] - mean) ** 2 + 0.3 * (x[1] - mean) ** 2
        assert mix.std == pytest.approx(np.sqrt(variance + spread), rel=1e-5)
        assert mix.low <= x.min() - 1.95 * np.sqrt(variance)
        assert mix.high >= x.max() + 1.95 * np.sqrt(variance)
    free = np.linalg.svd(less.B * less.typical)[2][3:].T
    N = information(narrower)
    assert np.abs(N @ free).max() < 1e-6 * np.abs(N).max()
    assert len(fewer) == 2
    for mix in fewer:
        w = np.zeros(6)
        w[mix.of] = mix.weights * one.typical[mix.of]
        assert np.abs(w @ free).max() < 1e-6 * np.linalg.norm(w)


@pytest.mark.whole
def test_the_motion_told_parts_the_members_best():
    """By finite differences: none of 300 drawn motions of a joint separates the two better."""
    robot, rng = FANUC, np.random.default_rng(11)
    points = np.array(list(TOOL.values()))
    cell = paper_cell(robot, Tool.of(TOOL))
    pulls = Pulls.at(np.array([0.3, 0.2, -0.1, 0.5, -1.0, 0.3]), np.array([200.0, 500.0, -900.0]))
    of = np.array([1, 2])

    def moved(q):
        J = by_differences(robot, q, points)
        return (J[1:] * (J[0].T @ pulls.force[0])).reshape(-1, 6) * X

    A = moved(pulls.q[0]) / 3e-5
    rows = RowIndex(
        *[np.zeros(9, int)] * 2, np.repeat(["P1"], 9), np.zeros(9, int), np.zeros(9, int)
    )
    noise = Errors(scipy.sparse.csr_array(3e-5 * np.eye(9)), np.full(9, "tracker"), [False] * 9)
    system = System(cell.parameters, rows, A * 3e-5 / X, np.zeros(9), noise, True)
    rest = np.delete(np.arange(6), of)
    N = A.T @ A
    known = (
        N[np.ix_(of, of)]
        - N[np.ix_(of, rest)]
        @ np.linalg.pinv(N[np.ix_(rest, rest)], rcond=1e-10)
        @ N[np.ix_(rest, of)]
    )

    def learnt(joint, to):
        q = pulls.q[0].copy()
        q[joint] = to
        B = moved(q)[:, of] / 3e-5
        return np.linalg.slogdet(np.eye(2) + known + B.T @ B)[1]

    best = parting(cell, system, pulls, N, of)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    drawn = [(j, rng.uniform(low[j], high[j])) for j in rng.integers(0, 6, 300)]

    assert robot.lower[best.joint] <= best.to <= robot.upper[best.joint]
    assert best.low == best.high == pulls.q[0, best.joint]
    most = max(learnt(*one) for one in drawn)
    assert learnt(best.joint, best.to) > most - 0.05  # tried in steps of ten degrees
