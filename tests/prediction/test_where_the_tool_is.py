"""A delivered model has the tool points as estimated from the data."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import PLAN

from pipeline.library.model_file import dumps, parse
from pipeline.machine.cell import paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import configure
from pipeline.prediction.model import IdentifiedModel, part
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify

FORMS = ("load point", "measuring point", "both")


@pytest.fixture(scope="module", params=FORMS)
def handed(request):
    """The model of a campaign in which a tool point is off by centimetres, in each form."""
    hidden = {"hidden": {"effects": ["load_point_offset=6x"]}, "poses": {"count": 12}}
    made = simulate(revised(PLAN, hidden), np.random.default_rng(5))
    case = ingested(in_memory(made.files), plausible=False)
    form = request.param
    effect = next(
        e for e in catalogue(case.robot) if (e.name, e.form) == ("load_point_offset", form)
    )
    cell = paper_cell(case.robot, case.cell.tool).with_effects(effect)
    at = np.append(case.robot.nominal_compliance, np.zeros(3))
    estimate = identify(cell, bring(case).data, at)[1]
    one = part(1.0, cell, estimate)
    return IdentifiedModel("c", "explained", {}, (one,)), estimate, case, form


def test_points_are_moved_by_what_was_found(handed):
    model, estimate, case, form = handed
    d, stated = estimate.value[-3:], case.cell.tool

    assert np.linalg.norm(d) > 0.005
    moved = model.tool.load_point - stated.load_point, model.tool.points - stated.points
    assert moved[0] == pytest.approx(d if form != "measuring point" else 0 * d, abs=1e-12)
    assert moved[1] == pytest.approx(
        np.tile(d if form != "load point" else 0 * d, (3, 1)), abs=1e-12
    )
    assert len(model.hypotheses[0].value) == case.robot.n


def test_a_point_that_is_asked_for_is_not_moved(handed):
    """The deflection at a stated tip is J_p x J_p' f by hand, whatever the campaign's tool."""
    model, *_ = handed
    tip, rng = np.array([0.1, 0.05, 0.3]), np.random.default_rng(6)
    q = rng.uniform(model.robot.lower, model.robot.upper, (5, 7))
    force = rng.normal(0, 500, (5, 3))

    told = model.predict(q, force, tip).displacement

    J = np.stack([_jacobian(model.robot, one, tip) for one in q])
    by_hand = np.einsum("mik,k,mjk,mj->mi", J, model.value, J, force)
    assert np.abs(told - by_hand).max() < 1e-6 * np.abs(by_hand).max()


def _jacobian(robot, q, tip, step=1e-6):
    """Motion of the tip per motion of each joint, by differences, shape (3, n)."""
    ends = [
        configure(robot, (q + sign * one)[None]).points(tip[None])[0, 0]
        for one in step * np.eye(robot.n)
        for sign in (1, -1)
    ]
    return (np.array(ends[::2]) - np.array(ends[1::2])).T / (2 * step)


def test_the_file_keeps_the_tool_of_each_hypothesis(handed):
    """And which stiffnesses are stated."""
    model, *_ = handed
    other, stated = model.hypotheses[0], np.arange(model.robot.n) != 3
    apart = IdentifiedModel(
        "c", "ambiguous", {}, (_shifted(other, 0.01, 0.4), _shifted(other, 0.0, 0.6)), stated
    )

    back = parse(dumps(apart))

    assert np.array_equal(back.stated, stated)
    for mine, theirs in zip(apart.hypotheses, back.hypotheses, strict=True):
        assert np.array_equal(mine.cell.tool.load_point, theirs.cell.tool.load_point)
        assert np.array_equal(mine.cell.tool.points, theirs.cell.tool.points)


def _shifted(one, by, weight):
    tool = replace(one.cell.tool, load_point=one.cell.tool.load_point + by)
    return replace(one, weight=weight, cell=replace(one.cell, tool=tool))
