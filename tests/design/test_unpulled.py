"""Poses without a pull: chosen for the robot's table, rehearsed, and what they then tell.

What a choice is worth is computed here from a chain multiplied up in test_unloaded, differentiated
by differences, and one dense normal vector.
"""

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from rail_chain import LETTERS, stands

from pipeline.base.errors import InputError
from pipeline.design.library import problem_of
from pipeline.design.planfile import plan_text
from pipeline.design.propose import propose
from pipeline.design.search import Effort
from pipeline.design.spec import validated
from pipeline.design.unpulled import _Told, unpulled
from pipeline.machine.robot import load
from pipeline.run import campaign_answer
from pipeline.simulate import parse, simulate
from pipeline.store.campaign import in_memory

KR500 = load("kr500_rail")
LENGTH, ANGLE = 2e-4, 2e-4
"""Standard deviations of a table as delivered [m], [rad], where nobody states them."""
JOINTS = np.array([5e-5, *[1e-4] * 6])
"""What each joint errs by at each pose [m], [rad]."""
STEP = 1e-6
QUICK = Effort(first=0, rounds=1, poses=96, settled=12, exchanged=3, bounds=1, directions=8)


def poses(count, seed):
    return np.random.default_rng(seed).uniform(KR500.lower, KR500.upper, (count, 7))


def derivatives(q, points):
    """Of the reflectors by table, place and turn of the robot, and tool, shape (p, 9, unknowns)."""
    table = [
        (stands(q, {x.label: STEP}, points) - stands(q, {x.label: -STEP}, points)) / (2 * STEP)
        for x in LETTERS
    ]
    at = stands(q, None, points)
    place = [np.broadcast_to(axis, at.shape) for axis in np.eye(3)]
    turn = [np.cross(axis, at) for axis in np.eye(3)]
    tool = []
    for k, axis in itertools.product(range(3), np.eye(3)):
        moved = points.copy()
        moved[k] += axis * STEP
        tool.append((stands(q, None, moved) - at) / STEP)
    return np.stack([*table, *place, *turn, *tool], axis=-1).reshape(len(q), 9, -1)


def by_joints(q, points):
    """Of the reflectors by the joints, shape (p, 9, 7)."""
    out = []
    for j in range(7):
        more, less = q.copy(), q.copy()
        more[:, j], less[:, j] = q[:, j] + STEP, q[:, j] - STEP
        out.append((stands(more, None, points) - stands(less, None, points)) / (2 * STEP))
    return np.stack(out, axis=-1).reshape(len(q), 9, 7)


def worth(q, points, variance):
    """Standard uncertainty of the table's entries over that before, geometric mean."""
    k = len(LETTERS)
    prior = np.array([ANGLE if x.turns else LENGTH for x in LETTERS])
    prior = np.concatenate([prior, [10.0] * 3, [ANGLE] * 3, [5e-3] * 9])
    D, Z = derivatives(q, points), by_joints(q, points)
    noise = [np.eye(9) * variance + z @ np.diag(JOINTS**2) @ z.T for z in Z]
    D = D.reshape(-1, D.shape[-1]) * prior
    V = np.zeros((len(D), len(D)))
    for i, block in enumerate(noise):
        V[9 * i : 9 * i + 9, 9 * i : 9 * i + 9] = block
    after = np.eye(len(prior)) - D.T @ np.linalg.solve(D @ D.T + V, D)
    return float(np.exp(np.linalg.slogdet(after[:k, :k])[1] / 2 / k))


@pytest.fixture(scope="module")
def problem():
    return problem_of("paper_reference", {"plan": {"unloaded": 5}})


@pytest.fixture(scope="module")
def found(problem):
    return unpulled(problem, poses(3, 1), np.random.default_rng(2))


def test_what_a_choice_is_worth_is_that_of_one_long_normal_vector(problem, found):
    points, variance = problem.tool.points, float(problem.experiment.scatter.tracker[0, 0])
    pulled = poses(3, 1)

    assert found.without == pytest.approx(worth(pulled, points, variance), rel=2e-3)
    every = np.concatenate([pulled, found.q])
    assert found.figure == pytest.approx(worth(every, points, variance), rel=2e-3)
    at_random = worth(np.concatenate([pulled, poses(5, 3)]), points, variance)
    assert found.bound < found.figure < at_random < found.without


def test_no_choice_is_below_the_bound():
    """All 220 choices of three of twelve; the exchange finds the best or nearly so."""
    for seed in range(5):
        X = np.random.default_rng(seed).standard_normal((12, 3, 9))
        told = _Told(np.swapaxes(X, 1, 2) @ X, np.eye(9), slice(4, 9))
        every = [told.phi(told.sum(np.array(c))) for c in itertools.combinations(range(12), 3)]
        chosen = told.exchanged(told.greedy(3))
        assert told.bound(chosen) >= max(every)
        assert told.bound(chosen) < told.phi(told.sum(np.arange(12)))
        assert told.phi(told.sum(chosen)) > max(every) - 0.1


def test_poses_that_no_limit_allows_are_refused():
    high = {"effector_above_m": 50.0}
    with pytest.raises(InputError, match="without a pull"):
        unpulled(
            problem_of("paper_reference", {"plan": {"unloaded": 2}, "limits": high}),
            poses(3, 1),
            np.random.default_rng(2),
        )


def test_poses_without_a_pull_cost_minutes():
    """Two hours: what they take is missing for pulls."""
    timed = {"design": {"minutes": 120.0}, "plan": {"poses": 4}}
    text = problem_of("diagnosis_reference", {}).spec.model_dump(exclude_unset=True)
    text["plan"].pop("readings", None)
    without = validated(text | timed)
    with_them = validated(text | timed | {"plan": {"poses": 4, "unloaded": 12}})
    assert with_them.plan.readings < without.plan.readings


@pytest.fixture(scope="module")
def proposal():
    """Three poses with pulls and nine without, found in a hurry."""
    asked = problem_of("paper_reference", {"plan": {"unloaded": 9}, "name": "short"})
    *_, last = propose(asked, 3, QUICK)
    return last


@pytest.mark.whole
def test_poses_without_a_pull_find_what_three_poses_cannot(proposal):
    """The plan file is rehearsed by a robot whose forearm is 5 mm longer than its table says."""
    plan = parse(plan_text(proposal, "short.toml"))
    hidden = plan.hidden.model_copy(update={"effects": ["link_length:4=5e-3"]})
    files = simulate(plan.model_copy(update={"hidden": hidden})).files
    idle = tuple(f"pose{4 + k:02d}_" for k in range(9))
    lines = files["tracker.csv"].decode().splitlines()
    fewer = "\n".join(line for line in lines if not line.startswith(idle)) + "\n"

    whole = campaign_answer("short", in_memory(files)).answer
    alone = campaign_answer("short", in_memory(files | {"tracker.csv": fewer.encode()})).answer

    assert whole.identity.unloaded_only == 9
    assert whole.identity.poses == alone.identity.poses == 3
    assert [(one.name, one.where) for one in whole.diagnosis.causes] == [("link_length", 4)]
    assert whole.diagnosis.causes[0].parameters[0].value == pytest.approx(5e-3, abs=2e-4)
    assert not alone.diagnosis.causes


@pytest.mark.slow
def test_the_command_writes_them_into_plan_and_sheet(tmp_path):
    asked = ["design", "paper_reference", "--unloaded", "4", "--rounds", "1", "--root"]
    done = subprocess.run(
        [sys.executable, "-m", "pipeline", *asked, tmp_path], capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "reports" / "plans" / "paper_reference"
    page = (folder / "sheet.html").read_text("utf-8")
    assert "Unloaded poses" in page
    assert "pose07_rep0_unloaded" in page
    assert len(json.loads((folder / "design.json").read_text("utf-8"))["unloaded"]["poses"]) == 4
