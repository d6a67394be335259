"""Next poses of a campaign in a cell: every one can be shot, and what is not checked is said."""

from dataclasses import replace

import numpy as np
import pytest
from cell_check import CELL, TOOL, Checked

from bench.reduced import reduce
from pipeline.check.findings import shot_findings
from pipeline.design.nextpose import PlaceQuestion, candidates, propose
from pipeline.diagnosis.diagnose import search_task
from pipeline.machine.cell import paper_cell
from pipeline.machine.robot.axes import from_log_units, in_log_units
from pipeline.reduction.bring import bring, conformed
from pipeline.reduction.effector import tool
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.store import campaign
from pipeline.system.estimate import identify

PLAN = {
    "poses": {"count": 6},
    "pulls": {"steps_n": [1500, 3000]},
    "hidden": {"effects": ["joint_tilt:3"]},
}
PAIRS = [
    ("joint_tilt:3", "link_bending:upper_arm"),
    ("joint_tilt:3", "joint_tilt:4"),
    ("joint_tilt:4", "rail_roll"),
]


def made(**changes):
    """The folder of a virtual campaign in the cell."""
    plan = Plan.model_validate({**PLAN, "cell": CELL, "tool": TOOL, **changes})
    return campaign.in_memory(simulate(plan, np.random.default_rng(12)).files)


@pytest.fixture(scope="module")
def asked():
    """A campaign of few poses with a tilting elbow, in the cell that its plan states."""
    raw = made()
    data = reduce(raw, conformed).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    _, estimate = identify(cell, data, raw.robot.nominal_compliance)
    case, _ = search_task(cell, data, estimate)
    view = case.whitened(case.linearised(case.model((), estimate.value)))
    return replace(case, surroundings=raw.settings), view


def question(view, labels):
    """These causes could stand in one place, alike likely."""
    labelled = [effect.label for effect in view.suspects]
    return PlaceQuestion(tuple(labelled.index(one) for one in labels), (0.5, 0.5), ())


def proposals(asked, seed):
    """What would part each of three pairs, among the candidates of one draw."""
    case, view = asked
    among = candidates(case, np.random.default_rng(seed))
    return [one for labels in PAIRS for one in propose(view, [question(view, labels)], among)]


def complaints(case, proposal):
    """What a proposed pose breaks as it is printed, by the independent check."""
    robot = case.cell.robot
    q = from_log_units(robot, np.round(in_log_units(robot, proposal.at.q), 4))
    return Checked(robot, CELL, TOOL).complaints(
        q, proposal.at.anchor.round(3), proposal.at.force_n
    )


@pytest.mark.whole
@pytest.mark.parametrize("draws", [1, pytest.param(24, marks=pytest.mark.slow)])
def test_every_next_pose_can_be_shot(asked, draws):
    """Nothing touches, every beam arrives within the acceptance; a hundred of them in all."""
    found = [one for seed in range(draws) for one in proposals(asked, seed)]

    assert len(found) >= 5 * draws
    assert [complaints(asked[0], one) for one in found] == [[]] * len(found)


def test_without_the_cell_some_next_pose_cannot_be_shot(asked):
    """The check does find fault: the same draws, chosen without a cell."""
    case, view = asked
    found = proposals((replace(case, surroundings=None), view), 0)

    assert any(complaints(case, one) for one in found)


def test_a_plan_hands_its_cell_to_the_campaign():
    """The same words in campaign.toml."""
    settings = made().settings

    assert settings.cell.model_dump() == CELL | {
        "tracker_m": tuple(CELL["tracker_m"]),
    }
    assert {n: one.half_angle_deg for n, one in settings.tool_acceptance.items()} == {
        "P1": 40.0,
        "P2": 50.0,
        "P3": 50.0,
    }
    assert settings.tool_capsules[0].radius == 0.09
    assert set(settings.tool) == {"load_point", "P1", "P2", "P3"}


def test_a_measured_pose_beyond_the_acceptance_is_a_fact():
    """Poses that were drawn without a thought of the tracker are used, and told."""
    raw = made()
    case = ingested(raw)
    pulls = bring(case).data.pulls
    checked = Checked(raw.robot, CELL, TOOL)
    _, first = np.unique(pulls.pose, return_index=True)
    beyond = {
        (name, int(pulls.pose[k]))
        for k in first
        for name in ("P1", "P2", "P3")
        if any(one.startswith(name) for one in checked._shots(pulls.q[k]))
    }
    said = shot_findings(case, pulls)

    assert beyond
    for name in ("P1", "P2", "P3"):
        poses = ", ".join(str(pose) for other, pose in sorted(beyond) if other == name)
        assert any(
            one.startswith(f"{name} was measured") and f"pose {poses}:" in one for one in said
        )
    free = raw.settings.model_copy(update={"cell": None})
    assert shot_findings(replace(case, settings=free), pulls) == []


@pytest.mark.slow
def test_the_answer_says_what_next_poses_keep_and_what_nobody_checked():
    """Under one key, which a campaign without a cell does not have."""
    found = campaign_answer("cell", made()).answer.diagnosis
    free = campaign_answer("free", made(cell=None)).answer.diagnosis

    assert "theta7 within -270 to 270 deg" in found.next_poses_in.kept
    assert "the arm clear of itself" in found.next_poses_in.kept
    assert found.next_poses_in.not_checked == (
        "theta5 against theta7: at the zero of all joints they touch",
    )
    assert "next_poses_in" not in free.model_dump()
