"""The noise of the data, estimated without relying on a model of the robot."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import scipy.sparse
from made_system import TYPICAL, dense, made, restricted
from scipy import optimize, stats

from bench.reduced import reduce
from pipeline.base import covariance
from pipeline.base.arrays import Parameter
from pipeline.base.tails import at_most
from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.reduction.settings import parse
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.contrasts import repeated_zeros
from pipeline.system.estimate import identify
from pipeline.system.restricted import PaddedRows, maximum
from pipeline.system.system import Errors, RowIndex, System
from pipeline.system.variance import (
    Components,
    noise,
    rescaled,
    resting_on,
    variance_components,
)

PLAN = Plan(name="noise", seed=5)


def found(plan, files=None):
    """The noise components of a simulated campaign."""
    return reduced(plan, files)[0]


def reduced(plan, files=None):
    """Noise components, measurements, system and estimate of a simulated campaign."""
    raw = in_memory(files or simulate(plan).files)
    kept = {}

    def keep(name, table, promise):
        kept[name] = conformed(name, table, promise)
        return kept[name]

    data = reduce(raw, keep).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    system, estimate = identify(cell, data, raw.robot.nominal_compliance)
    result = noise(raw.settings, cell, kept["21_placed"], data, system, estimate)
    return result, data, system, estimate


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
        rows=RowIndex(number, number, np.full(len(number), "P", object), number * 0, number),
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
    """1.3 times the stated noise is detected, with its size."""
    result = found(revised(PLAN, {"tracker": {"noise_scale": 1.3}}))

    assert result.larger[0]
    assert abs(result.of("tracker") - 1.3) < 4 * 1.3 * result.std[0]


def test_what_the_robot_does_is_no_noise():
    """Backlash, lost motion, hysteresis and a rolling rail leave the estimated noise unchanged."""
    wrong = {
        "effects": ["rail_backlash", "joint_lost_motion:3", "joint_hysteresis:4", "rail_roll=3x"]
    }
    clean, dirty = found(PLAN), found(revised(PLAN, {"hidden": wrong}))

    assert not clean.larger.any()
    assert dirty.of("tracker") == pytest.approx(clean.of("tracker"), rel=0.02)


def without_branch(files):
    """The same campaign, with the log of loads without its column branch."""
    rows = files["loads.csv"].decode().splitlines()
    return {**files, "loads.csv": "\n".join(row.rpartition(",")[0] for row in rows).encode()}


def test_pulls_up_and_down_are_no_repeats_where_the_branch_is_not_written_down():
    """Hysteresis separates them, and the log does not say which is which."""
    there_and_back = {"steps_n": [1000.0, 2000.0, 3000.0, 2000.0, 1000.0], "repeats": 2}
    plan = revised(PLAN, {"pulls": there_and_back, "poses": {"count": 8}})
    dirty = revised(plan, {"hidden": {"effects": ["joint_hysteresis:3"]}})

    clean, result = (found(p, without_branch(simulate(p).files)) for p in (plan, dirty))

    assert not result.larger.any()
    assert result.of("tracker") == pytest.approx(clean.of("tracker"), rel=0.02)


def pulled_both_ways(effects):
    """Six poses, each with the chain to the floor on one side of the rail, then on the other."""
    drawn = simulate(revised(PLAN, {"poses": {"count": 6}})).files["joints.csv"].decode()
    q = [[float(v) for v in row.split(",")[1:-1]] for row in drawn.splitlines()[1:]]
    floor = [[side, pose[0], -0.891] for pose in q for side in (2.5, -2.5)]
    plan = Plan.model_validate(
        {
            "name": "both",
            "poses": {"q": [pose for pose in q for _ in range(2)], "approach": [1] * 12},
            "pulls": {"anchors": floor, "anchor": list(range(12))},
            "hidden": {"effects": effects},
        }
    )
    files = simulate(plan).files

    def first_pose(match):
        pose, repeat = int(match["pose"]), int(match["repeat"])
        both = (pose + 1) // 2, repeat + (1 - pose % 2) * 4
        return f"{match['before']}{both[0]}{match['between']}{both[1]}"

    group = r"(?P<before>pose)(?P<pose>\d+)(?P<between>_rep)(?P<repeat>\d+)"
    load = r"(?m)^(?P<before>)(?P<pose>\d+)(?P<between>,)(?P<repeat>\d+)(?=,)"
    head, *joints = files["joints.csv"].decode().splitlines()
    joints = [f"{k},{row.partition(',')[2]}" for k, row in enumerate(joints[::2], 1)]
    return {
        **files,
        "tracker.csv": re.sub(group, first_pose, files["tracker.csv"].decode()).encode(),
        "loads.csv": re.sub(load, first_pose, files["loads.csv"].decode()).encode(),
        "joints.csv": "\n".join([head, *joints]).encode(),
    }


def test_pulls_in_two_directions_are_no_repeats():
    """Equal forces, to the left and to the right of the rail, which rolls."""
    result = found(None, pulled_both_ways(["rail_roll=3x"]))

    assert not result.larger.any()


def test_a_ladder_of_small_steps_is_no_repeat():
    """Ten steps of 4 %: the additional roll of the rail at each of them is not scatter."""
    ladder = {"steps_n": [2000 * 1.04**k for k in range(10)], "setting_sd_n": 0.0}
    plan = revised(PLAN, {"pulls": ladder, "poses": {"count": 16}, "tracker": {"sigma_m": 1e-5}})

    result = found(revised(plan, {"hidden": {"effects": ["rail_roll=6x"]}}))

    assert not result.larger.any()


def test_scatter_of_repeated_pulls_is_the_scales():
    """The same pull eight times: the scale scatters three times as much as stated."""
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
    """Without [tracker] sigma_m, the scale of the tracker is its standard uncertainty."""
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


def test_what_is_stated_counts_where_the_trackers_noise_is_not():
    """One reflector, one zero, no repeats: gain and scale contribute to uncertainties as usual."""
    one = {
        "poses": {"count": 12},
        "tool": {"load_point": [0.15, 0.0, 0.25], "P1": [0.2, 0.05, 0.12]},
        "pulls": {"zero": "before"},
        "scale": {"sigma_n": 20.0, "gain_sigma": 0.03},
    }
    plan = Plan.model_validate({"name": "one", **one})
    _, _, _, known = reduced(plan)
    result, _, system, estimate = reduced(revised(plan, {"tracker": {"stated": False}}))

    assert not result.used
    assert estimate.noise_from == "residuals"
    assert system.found_m == pytest.approx(3e-5, rel=0.2)
    assert estimate.std == pytest.approx(known.std, rel=0.2)


@pytest.mark.parametrize(("sigma_n", "smaller"), [(2.0, False), (1000.0, True)])
def test_a_scale_without_repeats_is_contradicted_from_below_only(sigma_n, smaller):
    """Pulls read to 2 N: stated as 1 kN they would leave far more than they do."""
    plan = revised(PLAN, {"poses": {"count": 6}, "pulls": {"steps_n": [1500.0, 3000.0]},
                          "scale": {"sigma_n": 2.0}})  # fmt: skip
    files = dict(simulate(plan).files)
    text, count = re.subn(
        r"(?m)^sigma_n = .*$", f"sigma_n = {sigma_n}", files["campaign.toml"].decode()
    )
    assert count == 1

    result = found(plan, files | {"campaign.toml": text.encode()})

    k = result.name.tolist().index("force_reading")
    assert bool(result.smaller[k]) == smaller
    assert result.of("force_reading") == pytest.approx(1.0) or smaller
    assert 2.0 / sigma_n < result.scale[k] < 0.2 or not smaller  # an upper limit
    assert not result.smaller[1 - k]


def components(replaced, std):
    """A tracker and a scale with a tenth more noise than stated, one of them significantly."""
    p = [1e-9 if name == replaced else 0.4 for name in ("tracker", "force_reading")]
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array([1.1, 1.1]), np.array(std), np.array(p), 900, True, 80.0, 90)


@pytest.mark.parametrize(("replaced", "dof"), [("tracker", 200.0), ("force_reading", 8.0)])
def test_student_asks_the_component_that_was_replaced(replaced, dof):
    """A scale known to 5 % has 200 degrees of freedom, one known to 25 % has 8."""
    _, _, _, estimate = reduced(revised(PLAN, {"poses": {"count": 4}}))
    found = resting_on(estimate, components(replaced, [0.05, 0.25]))

    assert found.quantile == pytest.approx(stats.t.ppf(0.975, dof))
    assert found.p_value == pytest.approx(
        stats.f.sf((estimate.chi2 - 80) / (estimate.dof - 90), estimate.dof - 90, dof)
    )


def test_pure_error_is_the_scatter_of_repeats_about_their_means():
    """One reflector, one zero: contrasts and their sum of squares as in a one-way layout."""
    plan = Plan.model_validate(
        {
            "name": "one",
            "poses": {"count": 8},
            "tool": {"load_point": [0.15, 0.0, 0.25], "P1": [0.2, 0.05, 0.12]},
            "pulls": {
                "steps_n": [1500.0, 3000.0], "repeats": 4, "zero": "before", "setting_sd_n": 0.0,
            },
            "scale": {"sigma_n": 1e-6},
            "tracker": {"stated": False},
        }
    )  # fmt: skip
    result, data, _, estimate = reduced(plan)
    step = data.pulls.pose * 2 + (np.linalg.norm(data.pulls.force, axis=1) > 2000)
    table = pd.DataFrame(estimate.residual.reshape(-1, 3)).groupby(step)
    within = float((table.count() - 1).mul(table.var()).to_numpy().sum())

    assert result.chi2_dof == 8 * 2 * 3 * 3
    assert result.of("tracker") ** 2 == pytest.approx(within / result.chi2_dof, rel=0.01)
    assert result.chi2 == pytest.approx(result.chi2_dof, rel=0.01)


def test_a_noisier_tracker_places_the_base_worse_too():
    """Everything from the tracker's readings is scaled, and nothing from the scale."""
    found, data, _, _ = reduced(revised(PLAN, {"tracker": {"noise_scale": 1.3}}))
    louder = rescaled(data, found)
    square = found.of("tracker") ** 2

    assert found.larger[0]
    assert not data.rotation_found
    assert louder.rotation_cov == pytest.approx(square * data.rotation_cov, rel=1e-6, abs=0)
    assert louder.direction_cov == pytest.approx(square * data.direction_cov, rel=1e-6, abs=0)
    assert louder.reading_std == pytest.approx(data.reading_std)


def test_base_reflectors_that_have_told_their_scatter_are_not_asked_twice():
    """At four times the stated noise they show it themselves, and are not scaled again."""
    found, data, _, _ = reduced(revised(PLAN, {"tracker": {"noise_scale": 4.0}}))

    assert data.rotation_found
    assert rescaled(data, found).rotation_cov == pytest.approx(data.rotation_cov, rel=1e-6, abs=0)


@pytest.mark.slow
def test_clean_campaigns_have_any_p_value():
    """No noise stated, three repeats: the distribution of 60 p-values is compatible with chance."""
    plan = revised(
        PLAN,
        {
            "poses": {"count": 10},
            "pulls": {"steps_n": [1500.0, 3000.0], "repeats": 3},
            "tracker": {"stated": False},
            "scale": {"sigma_n": 15.0},
        },
    )
    raw = in_memory(simulate(plan).files)
    robot, effector, p = raw.robot, tool(raw.settings), []
    for seed in range(60):
        found, data, _, _ = reduced(revised(plan, {"seed": seed}))
        louder = rescaled(data, found)
        _, estimate = identify(paper_cell(robot, effector), louder, robot.nominal_compliance)
        p.append(resting_on(estimate, found).p_value)

    assert stats.kstest(p, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(("p", "most"), [(0.05, 0.711), (0.01, 0.889), (0.9, 0.5), (0.0, 1.0)])
def test_a_p_value_is_no_probability_of_the_cause(p, most):
    """Sellke, Bayarri and Berger: odds of at most 2.5 and 8 to one for p = 0.05 and 0.01."""
    assert at_most(p) == pytest.approx(most, abs=5e-4)


@pytest.mark.parametrize("p", [1e-12, 1e-4, 0.003, 0.05, 0.3])
def test_the_least_favourable_alternative_is_found_by_search(p):
    """Among p-values distributed as b p^(b-1), b <= 1, the b of greatest likelihood."""
    best = optimize.minimize_scalar(
        lambda log_b: -(log_b + (np.exp(log_b) - 1) * np.log(p)), bounds=(-8, 0), method="bounded"
    )
    odds = np.exp(-best.fun)

    assert at_most(p) == pytest.approx(odds / (1 + odds), rel=1e-4)
    assert at_most(p) < at_most(0.9 * p)


def named(scale, std, p, stated=True):
    """Both components with their estimates."""
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array(scale), np.array(std), np.array(p), 100, stated)


def test_a_component_replaces_what_was_stated_beyond_chance_or_what_was_not():
    """Below 3 in 1000; an unstated tracker noise, whenever the data determine it."""
    cases = [
        (named([1.2, 1.3], [0.1, 0.1], [0.0029, 0.0031]), [True, False], [True, False]),
        (named([1.2, 1.3], [0.1, 0.1], [0.5, 0.001]), [False, True], [False, True]),
        (named([3e-5, 1.3], [0.1, 0.1], [1.0, 0.5], False), [False, False], [True, False]),
        (named([3e-5, 1.0], [np.inf, np.inf], [1.0, 1.0], False), [False] * 2, [False] * 2),
        (named([1.0, 1.0], [0.1, 0.1], [0.5, 0.5]), [False] * 2, [False] * 2),
    ]
    for one, larger, replaced in cases:
        assert one.larger.tolist() == larger
        assert one.replaced.tolist() == replaced
        assert one.used is any(replaced)
    assert cases[0][0].of("tracker") == 1.2
    assert cases[0][0].of("force_reading") == 1.3


@pytest.fixture(scope="module")
def few():
    """Measurements and estimate of four poses."""
    _, data, _, estimate = reduced(
        Plan(name="few", seed=5, poses={"count": 4}, scale={"sigma_n": 5.0})
    )
    return data, estimate


NOISE = ("loaded_cov", "zero_cov", "direction_cov", "rotation_cov", "reading_std")


@pytest.mark.parametrize(
    ("found", "change", "factors"),
    [
        (named([1.5, 2.0], [0.1] * 2, [1e-5, 1e-5]), {}, [1.5**2] * 4 + [2.0]),
        (named([1.5, 2.0], [0.1] * 2, [1e-5, 0.4]), {}, [1.5**2] * 4 + [1.0]),
        (named([1.5, 2.0], [0.1] * 2, [0.4, 1e-5]), {}, [1.0] * 4 + [2.0]),
        (named([1.5, 1], [0.1] * 2, [1e-5, 1]), {"rotation_found": True}, [2.25] * 3 + [1, 1]),
        (named([4e-5, 1], [0.1] * 2, [1.0, 1], False), {}, [16e-10] * 3 + [1, 1]),
        (
            named([4e-5, 2], [0.1] * 2, [1.0, 1e-5], False),
            {"found_m": 2e-5},
            [4.0] * 3 + [1.0, 2.0],
        ),
    ],
    ids=["both", "tracker", "scale", "rotation told", "none stated", "found before"],
)
def test_noise_found_takes_the_place_of_the_stated(few, found, change, factors):
    """Variances by the square, that of the scale alone; components not found stay."""
    data = replace(few[0], noise_stated=found.stated, **change)
    louder = rescaled(data, found)

    for name, factor in zip(NOISE, factors, strict=True):
        assert getattr(louder, name) == pytest.approx(
            factor * getattr(data, name), rel=1e-12, abs=0
        )
    assert louder.noise_stated
    assert louder.found_m is None
    assert louder.scale == data.scale


def test_of_two_scales_the_less_certain_counts(few):
    """Degrees of freedom of the less certain one, 1 / (2 r^2), if both were replaced."""
    estimate = few[1]
    both = replace(named([1.1, 1.1], [0.05, 0.25], [1e-9, 1e-9]), chi2=10.0, chi2_dof=12)
    found = resting_on(estimate, both)

    assert found.quantile == pytest.approx(stats.t.ppf(0.975, 8.0))
    F = (estimate.chi2 - 10) / (estimate.dof - 12)
    assert found.p_value == pytest.approx(stats.f.sf(F, estimate.dof - 12, 8.0))
    assert found.noise_from == "replicates"
    assert (found.value == estimate.value).all()


def test_where_the_contrasts_are_all_there_is_nothing_tests_the_model(few):
    """No degree of freedom beyond them: no p-value; a misfit below theirs: nothing in excess."""
    estimate, one = few[1], named([1.1, 1.0], [0.1, np.inf], [1e-9, 1.0])

    assert resting_on(estimate, replace(one, chi2_dof=estimate.dof)).p_value is None
    less = replace(one, chi2=estimate.chi2 + 1, chi2_dof=estimate.dof - 1)
    assert resting_on(estimate, less).p_value == 1.0


def layout(rng, groups=14, each=4, tracker=1.0, force=2.0):
    """Readings in groups: own scatter, that of the group, and a mean."""
    number = rng.permutation(np.repeat(np.arange(groups), each))
    M = len(number)
    y = 3.0 + tracker * rng.standard_normal(M) + force * rng.standard_normal(groups)[number]
    shared = (number[:, None] == np.arange(groups)).astype(float)
    source = np.array(["tracker"] * M + ["force_reading"] * groups, object)
    errors = Errors(
        scipy.sparse.csr_array(np.hstack([np.eye(M), shared])), source, np.zeros(len(source), bool)
    )
    rows = RowIndex(number, number, np.full(M, "P", object), number * 0, number)
    return System((Parameter("mean", "m", 1.0),), rows, np.ones((M, 1)), y, errors, True)


def likelihood(system, scales):
    """Minus twice the restricted log likelihood on dense matrices, log|V|+log|X'WX|+y'Py."""
    G = system.errors.G.toarray()
    mine = system.errors.source == "tracker"
    V = scales[0] ** 2 * G[:, mine] @ G[:, mine].T + scales[1] ** 2 * G[:, ~mine] @ G[:, ~mine].T
    W, X, y = np.linalg.inv(V), system.B, system.c
    N = X.T @ W @ X
    left = y @ W @ y - (X.T @ W @ y) @ np.linalg.solve(N, X.T @ W @ y)
    return np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1] + left


@pytest.mark.parametrize("seed", range(3))
def test_scales_are_where_the_dense_likelihood_is_largest(seed):
    """Unbalanced groups, rows in any order: a search over the dense formula gives the same."""
    made = layout(np.random.default_rng(seed))
    kept = np.random.default_rng(seed).random(len(made.c)) < 0.8
    rows = RowIndex(*(getattr(made.rows, f)[kept] for f in vars(made.rows)))
    errors = replace(made.errors, G=made.errors.G[kept])
    made = replace(made, rows=rows, B=made.B[kept], c=made.c[kept], errors=errors)

    found = variance_components(made)

    best = optimize.minimize(
        lambda log: likelihood(made, np.exp(log)), [0, 0.5], method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-9},
    )  # fmt: skip
    assert found.scale == pytest.approx(np.exp(best.x), rel=1e-3)
    assert found.dof == int(kept.sum()) - 1
    step, H = 1e-2 * np.eye(2), np.empty((2, 2))
    for i, j in np.ndindex(2, 2):
        H[i, j] = sum(
            a * b * likelihood(made, np.exp(best.x + a * step[i] + b * step[j]))
            for a in (-1, 1)
            for b in (-1, 1)
        ) / (4 * 1e-4)  # fmt: skip
    information = np.sqrt(np.diag(2 * np.linalg.inv(H)))
    assert (found.std >= 0.99 * information).all()
    assert (found.std < 2 * information).all()
    worse = optimize.minimize_scalar(lambda t: likelihood(made, [np.exp(t), 1.0]))
    drop = worse.fun - best.fun
    assert found.p_value[1] >= 0.5 * stats.chi2.sf(drop, 1) * (1 - 1e-6)


def test_scales_follow_the_units_of_the_readings():
    """Readings and errors in millimetres: the same factors; doubled readings: doubled factors."""
    made = layout(np.random.default_rng(4))
    errors = replace(made.errors, G=made.errors.G * 1e3)
    one = variance_components(made)
    same = variance_components(replace(made, c=made.c * 1e3, errors=errors))
    twice = variance_components(replace(made, c=made.c * 2))

    assert same.scale == pytest.approx(one.scale, rel=1e-4)
    assert same.std == pytest.approx(one.std, rel=1e-3)
    assert twice.scale == pytest.approx(2 * one.scale, rel=1e-4)


def test_what_the_fixed_effects_explain_changes_nothing():
    """With any mean: scales, p-values and standard uncertainties are those without it."""
    made = layout(np.random.default_rng(2))
    one, far = (variance_components(replace(made, c=made.c + off)) for off in (-3.0, 20.0))

    assert far.scale == pytest.approx(one.scale, rel=1e-4)
    assert far.std == pytest.approx(one.std, rel=1e-3)
    assert far.p_value == pytest.approx(one.p_value, rel=1e-3)
    groups = 1 / np.sqrt(2 * 13)  # of 14 means, if they had no scatter of their own
    assert groups < one.std[1] < 1.6 * groups


def test_too_few_contrasts_determine_no_scale():
    """Eleven and a mean: both factors stay one, and nothing is larger than stated."""
    made = layout(np.random.default_rng(6), groups=4, each=3)
    found = variance_components(made)

    assert np.isinf(found.std).all()
    assert found.scale.tolist() == [1, 1]
    assert not found.used


LOUD = made(
    np.random.default_rng(41), pulls=(4,) * 8, force_m=9e-5, scales=(1.5, 2.5), common=False
)
"""A system with springs, whose tracker and scale scatter more than stated."""


def test_components_of_a_models_residuals_are_those_of_the_whole_matrix():
    """Large displacements that the springs explain do not hide the scatter."""
    result = variance_components(LOUD)

    def loss(log_scale):
        tracker, force = np.exp(log_scale)
        scale = {"tracker": tracker, "zero": tracker, "force_reading": force}
        return restricted(LOUD.B * TYPICAL, LOUD.c, dense(LOUD, scale))

    best = optimize.minimize(loss, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-5})
    assert result.name.tolist() == ["tracker", "force_reading"]
    assert result.scale == pytest.approx(np.exp(best.x), rel=1e-3)
    assert result.larger[1]
    assert (np.abs(np.log(result.scale / [1.5, 2.5])) < 4 * result.std).all()
    assert (result.std < 0.3).all()
    assert result.dof == len(LOUD.c) - 3


def test_other_fixed_effects_are_taken_in_place_of_the_springs():
    """Given columns: correspondingly fewer degrees of freedom, and their part is explained."""
    rng = np.random.default_rng(2)
    more = np.hstack([LOUD.B * TYPICAL, rng.normal(size=(len(LOUD.c), 2))])
    shifted = replace(LOUD, c=LOUD.c + more @ np.array([0.0, 0.0, 0.0, 3e-3, -5e-3]))
    plain, other = (variance_components(one, more) for one in (LOUD, shifted))

    assert plain.dof == other.dof == len(LOUD.c) - 5
    assert other.scale == pytest.approx(plain.scale, rel=1e-5)
    assert other.std == pytest.approx(plain.std, rel=1e-4)


def test_one_component_is_found_beside_the_other_as_stated():
    """Estimated alone, the scale takes all that the stated tracker noise does not explain."""
    result = variance_components(LOUD, names=("force_reading",))

    def loss(t):
        return restricted(LOUD.B * TYPICAL, LOUD.c, dense(LOUD, {"force_reading": np.exp(t)}))

    best = optimize.minimize_scalar(loss, bounds=(-1, 3)).x
    assert result.name.tolist() == ["force_reading"]
    assert result.of("force_reading") == pytest.approx(np.exp(best), rel=1e-3)


def without(source):
    """The same system without a stated uncertainty for one source."""
    factor = np.where(LOUD.errors.source == source, 0.0, 1.0)
    G = scipy.sparse.csr_array(LOUD.errors.G @ scipy.sparse.diags_array(factor))
    return replace(LOUD, errors=replace(LOUD.errors, G=G))


def test_a_source_that_states_nothing_is_no_component():
    """An uncertainty of zero cannot be scaled: scale 1, infinite uncertainty, p = 1."""
    result = variance_components(without("force_reading"))

    assert result.of("force_reading") == 1.0
    assert np.isinf(result.std[1])
    assert result.p_value[1] == 1.0
    assert np.isfinite(result.std[0])


def test_a_scale_that_is_known_to_a_half_only_is_not_told():
    """Force errors below the scatter of the tracker: as stated, since they are not determined."""
    weak = made(np.random.default_rng(0), (2,) * 8, 1.5e-5, common=False)
    blocks = PaddedRows.of(weak, weak.B * TYPICAL, [("tracker", "zero"), ("force_reading",)])
    _, std, _ = maximum(blocks, np.array([True, True]))
    result = variance_components(weak)

    assert 0.5 < std[1] < 5
    assert result.of("force_reading") == 1.0
    assert np.isinf(result.std[1])
    assert result.p_value[1] == 1.0


@pytest.mark.parametrize(("rows", "told"), [(15, True), (14, False)])
def test_fewer_than_twelve_contrasts_determine_nothing(rows, told):
    """Rows minus three springs."""
    first = np.arange(rows)
    taken = {name: value[first] for name, value in vars(LOUD.rows).items()}
    errors = replace(LOUD.errors, G=LOUD.errors.G[first])
    few = replace(
        LOUD, rows=RowIndex(**taken), B=LOUD.B[first], c=30 * LOUD.c[first], errors=errors
    )
    result = variance_components(few)

    assert np.isfinite(result.std).any() == told
    assert told or result.scale.tolist() == [1.0, 1.0]


def test_a_scale_in_metres_is_no_larger_than_a_noise_that_nobody_states():
    """Without a stated noise: in metres, no p-value, and the estimate is used.

    The rest as usual.
    """
    stated = variance_components(LOUD)
    result = variance_components(replace(LOUD, noise_stated=False, found_m=2e-5))

    assert result.scale == pytest.approx(stated.scale * [2e-5, 1.0])
    assert result.p_value[0] == 1.0
    assert result.p_value[1] == pytest.approx(stated.p_value[1])
    assert result.replaced.tolist() == [True, True]
    assert result.left == (1.0, result.std[0])


def told(p, std, stated=True):
    """A component of the tracker and one of the scale."""
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array([1.2, 1.4]), np.array(std), np.array(p), 99, stated)


@pytest.mark.parametrize(
    ("found", "replaced", "left"),
    [
        (told([0.5, 0.5], [0.1, 0.2]), [False, False], 1.2),
        (told([0.0031, 0.0029], [0.1, 0.2]), [False, True], 1.2),
        (told([0.0029, 0.5], [0.1, 0.2]), [True, False], 1.0),
        (told([1.0, 0.5], [0.1, 0.2], stated=False), [True, False], 1.0),
        (told([1.0, 0.5], [np.inf, 0.2], stated=False), [False, False], 1.0),
    ],
)
def test_what_is_larger_beyond_chance_or_not_stated_is_replaced(found, replaced, left):
    """At three in a thousand; the remaining factor of the tracker is then one."""
    assert found.replaced.tolist() == replaced
    assert found.used == any(replaced)
    assert found.left == (left, found.std[0])


def test_of_two_components_the_less_certain_counts():
    """Both replaced, known to 5 and 25 %: eight degrees of freedom."""
    _, _, _, estimate = reduced(revised(PLAN, {"poses": {"count": 4}}))
    both = replace(components("tracker", [0.05, 0.25]), p_value=np.array([1e-9, 1e-9]))

    assert resting_on(estimate, both).quantile == pytest.approx(stats.t.ppf(0.975, 8))
