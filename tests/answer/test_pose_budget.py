"""The budget of the deflection at the test pose sums to what the model states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import report_sample

from pipeline.answer.pose_budget import HELD_OUT, pose_budget
from pipeline.answer.recommended import ModelValues, joint_springs
from pipeline.prediction import model as handover
from pipeline.prediction.tolerance import HeldOutError, tip
from pipeline.reduction.bring import bring
from pipeline.report.model import compose
from pipeline.run import ingested
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.store import campaign
from pipeline.system.fit import fit

FORCE = np.array([400.0, -900.0, 300.0])
NOTHING = HeldOutError(None, 3000.0)


@pytest.fixture(scope="module")
def springs():
    """Joint springs of a small campaign."""
    plan = Plan(poses={"count": 6}, pulls={"steps_n": [1500, 3000]})
    raw = campaign.in_memory(simulate(plan, np.random.default_rng(5)).files)
    case = ingested(raw)
    return joint_springs(fit(case, bring(case)))


def handed(values):
    """The model delivered for some values."""
    parts = [
        handover.part(one.weight, one.cell, one.estimate, one.system, one.ratio)
        for one in values.hypotheses
    ]
    return handover.IdentifiedModel("", "", {}, tuple(parts))


def mixed(springs):
    """Two hypotheses of unequal weight whose springs differ by a tenth."""
    (one,) = springs.hypotheses
    softer = replace(one.estimate, value=1.1 * one.estimate.value)
    pair = (replace(one, weight=0.7), replace(one, weight=0.3, estimate=softer))
    return ModelValues(springs.fitted, pair, springs.left_out_m)


@pytest.mark.parametrize("make", [lambda one: one, mixed], ids=["one", "two"])
def test_the_lines_add_up_to_what_the_model_states(springs, make):
    """In quadrature, sources and difference of hypotheses; the covariance is complete."""
    values = make(springs)
    model, q = handed(values), springs.fitted.data.pulls.q[0]
    at = tip(model, q[None], FORCE[None], NOTHING)
    lines = {part.source: part.std_mm for part in pose_budget(values, model, q, FORCE, at)}

    assert HELD_OUT not in lines
    assert ("which_cause" in lines) == (len(values.hypotheses) == 2)
    assert np.sqrt(sum(one**2 for one in lines.values())) == pytest.approx(
        1e3 * at.std[0], rel=1e-6
    )
    assert min(lines["tracker"], lines["zero"], lines["second_order"]) > 0


def test_the_difference_between_hypotheses_is_a_line(springs):
    """A tenth of the deflection at weights 0.7 and 0.3: its standard deviation."""
    values = mixed(springs)
    model, q = handed(values), springs.fitted.data.pulls.q[0]
    at = tip(model, q[None], FORCE[None], NOTHING)
    lines = {part.source: part.std_mm for part in pose_budget(values, model, q, FORCE, at)}

    own = 1e3 * at.size[0] / (0.7 + 0.3 * 1.1)
    assert lines["which_cause"] == pytest.approx(0.1 * own * np.sqrt(0.7 * 0.3), rel=1e-3)


def test_what_left_out_poses_show_beyond_the_model_is_a_line(springs):
    """If left-out poses were missed by more than the model states; the squares add up to it."""
    model, q = handed(springs), springs.fitted.data.pulls.q[0]
    stated = 1e3 * tip(model, q[None], FORCE[None], NOTHING).std[0]
    at = tip(model, q[None], FORCE[None], HeldOutError(2e-3 * stated, 3000.0))
    lines = {part.source: part.std_mm for part in pose_budget(springs, model, q, FORCE, at)}

    assert lines[HELD_OUT] == pytest.approx(np.sqrt(3) * stated, rel=1e-6)
    assert next(iter(lines)) == HELD_OUT


def test_the_report_shows_lines_that_a_reader_can_add():
    """The squares of the printed numbers give the printed u, and U is twice that."""
    answer = report_sample.answer()
    parts = ({"source": "tracker", "std_mm": 0.03}, {"source": "zero", "std_mm": 0.04},
             {"source": "geometry", "std_mm": 0.000001})  # fmt: skip
    pose = answer.test_pose.model_validate(
        answer.test_pose.model_dump() | {"std_mm": 0.05, "budget": parts}
    )
    report = compose(answer.model_copy(update={"test_pose": pose}), report_sample.tables())
    budget = next(one for one in report.sections if one.key == "budget")
    table = next(one for one in budget.blocks if getattr(one, "name", "") == "pose-budget")
    cells = [[cell.text for cell in row] for row in table.rows]

    assert [row[1] for row in cells] == [
        "0.03000",
        "0.04000",
        "below 0.00001",
        "0.05000",
        "0.10000",
    ]
    assert cells[-1][0] == "expanded uncertainty U (k = 2)"
    assert [row[2] for row in cells[:2]] == ["36", "64"]
