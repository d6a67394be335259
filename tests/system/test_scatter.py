"""Scatter of the readings: found if present, and rounding is no evidence."""

import re
from dataclasses import replace

import numpy as np
import pytest

from bench.reduced import reduce
from pipeline.diagnosis.diagnose import search_task
from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.run import campaign_answer
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.store import campaign
from pipeline.system.contrasts import Zeros, pure_error
from pipeline.system.estimate import identify
from pipeline.system.scatter import scatter
from pipeline.system.variance import variance_components


def seen(seed, scale_noise=1.0, sigma_n=2.0):
    """A campaign with joint springs only and stated weights, and the noise of its contrasts."""
    plan = Plan(
        poses={"count": 20},
        pulls={"steps_n": [1000, 2000, 3000, 1500]},
        scale={"sigma_n": sigma_n, "noise_scale": scale_noise},
    )
    files = simulate(plan, np.random.default_rng(seed)).files
    raw = campaign.in_memory(files)
    data = reduce(raw, conformed).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    system, estimate = identify(cell, data, cell.robot.nominal_compliance)
    case, _ = search_task(cell, data, estimate)
    case = replace(case, noise=1.0, force_noise=1.0)
    sight = case.linearised(case.model((), estimate.value))
    found = variance_components(pure_error(system, estimate.residual, data, Zeros.none(), cell))
    return case.whitened(sight), sight.system, (float(found.scale[0]), float(found.std[0]))


def test_a_scale_that_scatters_more_than_stated_is_found_with_its_size():
    """15 N stated, 45 N true: the factor is within four standard uncertainties."""
    found = scatter(*seen(3, scale_noise=3.0, sigma_n=15.0))

    assert found.force_p < 1e-3
    assert 0 < found.force_std < 1.0
    assert found.force * found.tracker == pytest.approx(3.0, abs=4 * found.force_std)


def test_columns_that_are_nearly_alike_are_no_evidence_of_noise():
    """A direction at the limit of the rank does not appear and disappear with the scale."""
    view, system, found = seen(4)
    rng = np.random.default_rng(5)
    longest = int(np.argmax(np.linalg.norm(view.A[:, : view.springs], axis=0)))
    column = view.raw[:, longest] * view.typical[longest]
    away = rng.standard_normal(len(column)) * np.linalg.norm(column) / np.sqrt(len(column))
    for apart in 1e-10 * 2.0 ** np.arange(8):
        raw = np.column_stack([view.raw[:, :-1], column + apart * away, view.raw[:, -1]])
        doubled = replace(view, raw=raw, typical=np.append(view.typical, 1.0))
        assert scatter(doubled, system, found).force_p > 1e-3


@pytest.mark.slow  # test_one_answer has clean campaigns
@pytest.mark.parametrize("scale", [1.0, 1.12])
def test_scatter_that_no_repeat_shows_is_said_beside_the_verdict(scale):
    """The model is complete; readings slightly worse than stated are reported all the same."""
    plan = Plan(
        poses={"count": 20},
        pulls={"steps_n": [1000, 2000, 3000, 1500]},
        tracker={"noise_scale": scale},
    )
    files = simulate(plan, np.random.default_rng(8)).files

    answer = campaign_answer("here", campaign.in_memory(files)).answer

    assert answer.diagnosis.verdict == "adequate"
    noisy = any(cause.name == "tracker_noise" for cause in answer.diagnosis.causes)
    warned = re.search(r"scatter 1\.\d\d times as large", answer.verdict_sentence[0])
    assert bool(noisy or warned) == (scale > 1)
