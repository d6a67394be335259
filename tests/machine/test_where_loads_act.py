"""Where a load acts, which loads a scale measures, and what a tracker reads that drifts."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import HUNG, PULLED, Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

ROBOT = load("kr500_rail")
POINTS = {"load_point": [0.15, 0.0, 0.25], "P1": [0.2, 0.05, 0.12], "P2": [-0.12, 0.19, 0.1]}
CELL = paper_cell(ROBOT, Tool.of(POINTS))
COMPLIANCE = ROBOT.nominal_compliance
CENTRE = np.array([0.05, -0.11, 0.32])


def loads(m=5):
    """Random poses and forces; read at 600 s, the zeros at 90 s."""
    rng = np.random.default_rng(5)
    q = rng.uniform(ROBOT.lower, ROBOT.upper, (m, ROBOT.n))
    one = Pulls.at(q, rng.normal(0.0, 1500.0, (m, 3)))
    return replace(one, time=np.full(m, 600.0), time_zero=np.full(m, 90.0))


def test_a_load_with_a_place_of_its_own_acts_there():
    """As at the load point of an effector that has it there."""
    mounted = replace(loads(), acts_at=np.tile(CENTRE, (5, 1)))
    there = replace(CELL, tool=Tool.of({**POINTS, "load_point": CENTRE.tolist()}))

    found = predict(CELL, mounted, COMPLIANCE).displacement
    assert found == pytest.approx(predict(there, loads(), COMPLIANCE).displacement, abs=1e-15)
    assert np.abs(found - predict(CELL, loads(), COMPLIANCE).displacement).max() > 1e-5


def of(name, form=None):
    """An effect of the catalogue, and the cell with it."""
    found = next(one for one in catalogue(ROBOT) if one.name == name and form in (None, one.form))
    return CELL.with_effects(found)


@pytest.mark.parametrize("name", ["scale_gain", "scale_zero", "scale_curvature"])
def test_a_scale_errs_on_what_hangs_on_it_only(name):
    pulls, values = loads(), np.append(COMPLIANCE, 0.1)
    hung = replace(pulls, by=np.array([PULLED, HUNG, PULLED, HUNG, HUNG]))

    before = predict(CELL, hung, COMPLIANCE).displacement
    moved = np.abs(predict(of(name), hung, values).displacement - before).max(axis=(1, 2))
    assert (moved > 0).tolist() == [True, False, True, False, False]


def test_a_displacement_contains_the_drift_since_its_zero_only():
    """Both readings drift, at v t; their difference by v (600 s - 90 s)."""
    v = np.array([1e-8, -2e-8, 3e-8])
    found = predict(of("tracker_drift", "steady"), loads(), np.append(COMPLIANCE, v))

    still = predict(CELL, loads(), COMPLIANCE)
    assert found.displacement - still.displacement == pytest.approx(
        np.broadcast_to(510.0 * v, (5, 2, 3)), abs=1e-14
    )
    assert found.loaded - found.unloaded == pytest.approx(found.displacement, abs=1e-12)
