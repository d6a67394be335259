"""The real pulls on the FANUC R-2000iC.

The model is incomplete, and one physical cause explains it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.reduced import reduce
from pipeline.diagnosis.diagnose import diagnose, search_task
from pipeline.diagnosis.verdict import verdict
from pipeline.machine.cell import paper_cell, sensitivity
from pipeline.reduction.effector import tool
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.store.campaign import find
from pipeline.system.detect import threshold
from pipeline.system.estimate import identify

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def fanuc():
    """Cell, measurements, system and estimate of the joint-only model."""
    raw = find(ROOT, "fanuc_r2000ic").read()
    data = reduce(raw, lambda name, table, promise: frame(table)).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    return cell, data, *identify(cell, data, raw.robot.nominal_compliance)


def frame(table):
    """A table as pandas has it."""
    return table.to_pandas() if hasattr(table, "to_pandas") else table


@pytest.fixture(scope="module")
def found(fanuc):
    """The diagnosis."""
    cell, data, _, estimate = fanuc
    where = place_of_interest(None, cell.robot, data.pulls)
    return diagnose(cell, data, estimate, where, np.random.default_rng(1))


@pytest.mark.whole
def test_a_physical_cause_predicts_left_out_poses_better(found):
    """Without the tilt, and with the offset of the load point, 0.1846 mm remain at poses held out.

    With springs alone it is 0.2339 mm. No spring has a negative compliance.
    """
    worth = found.causes[0].gain

    assert worth.rms_before_m == pytest.approx(0.1846e-3, abs=0.05e-6)
    assert worth.reduction > 0.15
    assert 1 - worth.rms_after_m / 0.2339e-3 > 0.2  # of what springs alone leave, by all causes
    assert worth.ci95[0] > 0
    assert (found.estimate.value[:6] > 0).all()


@pytest.mark.whole
def test_what_else_could_stand_there_is_said(found):
    """The tilting bearing has the bending forearm as a rival; the tool points are suspected."""
    first = found.causes[0]
    said = {c.effect.name for c in found.causes} | {r.effect.name for r in first.rivals}

    assert first.effect.label == "joint_tilt:3"
    assert "link_bending" in {r.effect.name for r in first.rivals}
    assert "load_point_offset" in said
    assert verdict(found.facts) in ("ambiguous", "explained")


@pytest.mark.whole
def test_a_turned_effector_does_as_well_as_an_offset_of_the_load_point(found):
    """It is unnamed, and competes with the named cause."""
    offset = next(c for c in found.causes if c.effect.name == "load_point_offset")

    assert "effector_turned" in [one.effect.name for one in offset.as_good]


@pytest.mark.whole
def test_noise_that_nobody_stated_is_what_the_causes_leave(found):
    """Residuals of 0.22 mm without causes, 0.12 mm with them: intervals are based on the latter."""
    left = found.estimate.residual
    whitened = np.sqrt(found.estimate.chi2 / found.estimate.dof)

    assert np.sqrt(np.mean(left**2)) < 0.13e-3
    assert whitened == pytest.approx(1)


def by_hand(fanuc, effect):
    """Fraction of the cross-validation rms removed by one elastic cause, by plain least squares."""
    cell, data, system, estimate = fanuc
    Z = sensitivity(cell, data.pulls, estimate.value, [effect])[data.pull, data.target]
    wide = np.column_stack([system.B, Z.reshape(len(system.B), -1)])
    wide = wide / np.linalg.norm(wide, axis=0)
    short = np.zeros((2, len(system.c)))
    for pose in np.unique(system.rows.pose):
        out = system.rows.pose == pose
        for k, X in enumerate((system.B / np.linalg.norm(system.B, axis=0), wide)):
            x = np.linalg.lstsq(X[~out], system.c[~out], rcond=None)[0]
            short[k, out] = system.c[out] - X[out] @ x
    return 1 - np.linalg.norm(short[1]) / np.linalg.norm(short[0])


@pytest.mark.whole
def test_one_cause_alone_does_it_and_the_others_are_told_beside_it(fanuc, found):
    """The tilting bearing alone removes a fifth; forearm and a wrong point follow, less likely."""
    first, *others = found.alone

    assert first.effect.label == "joint_tilt:3"
    assert first.reduction == pytest.approx(by_hand(fanuc, first.effect), abs=2e-3)
    assert first.reduction > 0.2
    assert first.ci95[0] > 0
    assert first.probability > 0.5
    assert {"link_bending", "load_point_offset"} <= {one.effect.name for one in others}
    assert sum(one.probability for one in found.alone) <= 1.0


@pytest.mark.whole
def test_joint_only_pulls_raise_no_alarm(fanuc):
    """Pulls of a robot with joint springs only, with this scatter: at most 1 % alarms."""
    cell, data, system, estimate = fanuc
    rng = np.random.default_rng(99)
    case, _ = search_task(cell, data, estimate)
    seen = case.linearised(case.model((), estimate.value))
    view = case.whitened(seen)
    limit = threshold(view, view.base, view.rows_left, rng)
    truth, size = system.B @ np.abs(estimate.value), estimate.residual_std_m
    alarms = 0
    for _ in range(500):
        y = np.round(truth + rng.normal(0, size, len(truth)), 6)
        drawn = case.whitened(replace(seen, y=y))
        alarms += bool(drawn.beside(drawn.base).p().min() < limit.p)

    assert alarms <= 5


def named(fanuc, draws, rng):
    """How often a cause is named in pulls of joint springs with rotated residuals."""
    cell, data, system, estimate = fanuc
    left = estimate.residual.reshape(-1, 3)
    where, count = place_of_interest(None, cell.robot, data.pulls), 0
    for k in range(draws):
        turned = left * rng.choice([-1, 1], (len(left), 1))
        if k % 2:
            turned = left[rng.permutation(len(left))]
        c = system.c - estimate.residual + turned.ravel()
        drawn = replace(data, delta=c.reshape(data.delta.shape))
        _, again = identify(cell, drawn, cell.robot.nominal_compliance)
        count += bool(diagnose(cell, drawn, again, where, np.random.default_rng(1)).causes)
    return count


@pytest.mark.whole
def test_turned_residuals_name_no_cause(fanuc):
    """In the third a tilt has p = 4e-8, without a significant gain at left-out poses."""
    assert named(fanuc, 3, np.random.default_rng(7)) == 0


@pytest.mark.slow
def test_turned_and_permuted_residuals_hardly_ever_name_a_cause(fanuc):
    """At most two of 200: one in a hundred."""
    assert named(fanuc, 200, np.random.default_rng(7)) <= 2
