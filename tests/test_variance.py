"""The noise that the data have, found without believing any model of the robot."""

import numpy as np
import pandas as pd
import pytest
import scipy.sparse

from pipeline import covariance
from pipeline.campaign import in_memory
from pipeline.cell import paper_cell
from pipeline.results import Errors, Parameter, Rows, System
from pipeline.run import reduce, tool
from pipeline.settings import parse
from pipeline.simulate import Plan, revised, simulate
from pipeline.stages.estimate import identify
from pipeline.stages.variance import noise, repeated_zeros, variance_components
from pipeline.tables import conform

PLAN = Plan(name="noise", seed=5)


def found(plan):
    """The noise components of a simulated campaign."""
    raw = in_memory(simulate(plan).files)
    kept = {}

    def keep(name, table, promise):
        kept[name] = conform(table, promise).to_pandas()
        return kept[name]

    data = reduce(raw, keep).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    system, estimate = identify(cell, data, raw.robot.nominal_compliance)
    return noise(raw.settings, cell, kept["21_placed"], data, system, estimate)


def test_components_of_a_balanced_table_are_those_of_the_analysis_of_variance():
    """Restricted likelihood equals the mean squares within and between groups."""
    rng = np.random.default_rng(3)
    groups, each = 12, 5
    y = 0.4 + 2.0 * rng.standard_normal((groups, 1)) + rng.standard_normal((groups, each))
    within = y.var(axis=1, ddof=1).mean()
    between = (each * y.mean(axis=1).var(ddof=1) - within) / each
    own = scipy.sparse.eye_array(groups * each)
    shared = scipy.sparse.block_diag([np.ones((each, 1))] * groups)
    source = np.array(["tracker"] * (groups * each) + ["force_reading"] * groups, dtype=object)
    number = np.repeat(np.arange(groups), each)
    system = System(
        parameters=(Parameter("mean", "m", 1.0),),
        rows=Rows(number, number, np.full(len(number), "P", object), number * 0, number),
        B=np.ones((groups * each, 1)),
        c=y.ravel(),
        errors=Errors(
            scipy.sparse.csr_array(scipy.sparse.hstack([own, shared])),
            source,
            np.zeros(len(source), bool),
        ),
        noise_stated=True,
    )

    result = variance_components(system)

    assert result.of("tracker") ** 2 == pytest.approx(within, rel=1e-4)
    assert result.of("force_reading") ** 2 == pytest.approx(between, rel=1e-4)
    assert result.std[0] == pytest.approx(1 / np.sqrt(2 * groups * (each - 1)), rel=0.3)


def test_a_noisier_tracker_is_found():
    """1.3 times the stated noise stands out, and its size comes back."""
    result = found(revised(PLAN, {"tracker": {"noise_scale": 1.3}}))

    assert result.larger[0]
    assert abs(result.of("tracker") - 1.3) < 4 * 1.3 * result.std[0]


def test_what_the_robot_does_is_no_noise():
    """Backlash, lost motion, hysteresis and a rolling rail leave the found noise as it is."""
    wrong = {
        "effects": ["rail_backlash", "joint_lost_motion:3", "joint_hysteresis:4", "rail_roll=3x"]
    }
    clean, dirty = found(PLAN), found(revised(PLAN, {"hidden": wrong}))

    assert not clean.larger.any()
    assert dirty.of("tracker") == pytest.approx(clean.of("tracker"), rel=0.02)


def test_scatter_of_repeated_pulls_is_the_scales():
    """The same pull eight times: the scale scatters three times as much as it says."""
    plan = revised(
        PLAN,
        {
            "poses": {"count": 8},
            "pulls": {"steps_n": [3000.0], "repeats": 8},
            "tracker": {"sigma_m": 1e-5},
            "scale": {"sigma_n": 10.0, "noise_scale": 3.0},
        },
    )
    result = found(plan)

    assert list(result.larger) == [False, True]
    assert abs(result.of("force_reading") - 3.0) < 4 * 3.0 * result.std[1]


def test_noise_that_nobody_states_is_found_in_metres():
    """Without [tracker] sigma_m the scale of the tracker is its standard uncertainty."""
    result = found(revised(PLAN, {"tracker": {"stated": False}}))

    assert result.of("tracker") == pytest.approx(3e-5, rel=4 * result.std[0])
    assert np.isinf(result.std[1])


def test_differences_of_zeros_are_independent_of_their_mean():
    """Three zeros give two differences, with the covariances of the second and third."""
    settings = parse(
        'format = 1\nname = "t"\nrobot = "kr500_rail"\n[tracker]\nfiles = ["t.csv"]\n'
        '[scale]\n[tool]\nload_point = [0, 0, 0.2]\nP1 = [0.2, 0, 0]\n[naming]\nmeasured = ["P1"]'
    )
    points = np.array([[1.0, 2.0, 3.0], [1.1, 2.0, 3.0], [1.2, 2.3, 2.7]])
    C = np.array([np.eye(3), 4 * np.eye(3), 9 * np.eye(3)])
    placed = pd.DataFrame(
        {
            "pose": 1,
            "state": "unloaded",
            "target": "P1",
            "time": pd.to_datetime(["2026-01-01", "2026-01-02", "2026-01-03"]),
            **dict(zip(["x_m", "y_m", "z_m"], points.T, strict=True)),
            **dict(zip(covariance.columns(), covariance.flat(C).T, strict=True)),
        }
    )

    zeros = repeated_zeros(settings, placed)

    assert zeros.delta == pytest.approx(np.array([[0.1, 0, 0], [0.15, 0.3, -0.3]]))
    assert zeros.cov == pytest.approx(np.array([5 * np.eye(3), (9 + 5 / 4) * np.eye(3)]))
