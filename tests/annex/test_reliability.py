"""Reliability: what the readings tell of each other, and what each pull carries."""

from dataclasses import replace

import numpy as np
import pytest
from made_system import TYPICAL, dense, generalised, made
from small_case import PLAN, moved, small, where

from pipeline.annex.redundancy import CRITICAL, influence, reliability, solution
from pipeline.annex.reliability import control
from pipeline.answer.contract import Carried
from pipeline.answer.recommended import joint_springs
from pipeline.base.arrays import Parameter
from pipeline.check.findings import hangs_on
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.reduction.bring import bring
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.reduction.register import register
from pipeline.system.fit import fit

EYE = np.eye(3)


def mixed(system):
    """The same with a fourth parameter that is a mix of two, and a fifth that moves nothing."""
    B = np.column_stack([system.B, system.B @ [1.0, 0.5 * TYPICAL[0] / TYPICAL[1], 0.0]])
    B = np.column_stack([B, np.zeros(len(B))])
    more = tuple(Parameter(f"c{k}", "m/N", TYPICAL[0]) for k in (3, 4))
    return replace(system, B=B, parameters=system.parameters + more)


@pytest.mark.parametrize("common", [True, False])
@pytest.mark.parametrize("change", [lambda system: system, mixed], ids=["regular", "deficient"])
def test_redundancies_add_up_to_rows_minus_parameters(change, common):
    """To 1e-9, with errors common to all poses and parameters that nothing determines."""
    for seed in range(5):
        system = change(made(np.random.default_rng(seed), pulls=(3, 1, 4, 2), common=common))

        at = solution(system, np.eye(system.B.shape[1]))
        found = reliability(system, at)

        assert found.r.sum() == pytest.approx(len(system.rows) - 3, abs=1e-9)
        assert (found.r[found.r != 0] > 1e-11).all(), "rounding differs by kind of processor"
        assert (found.r <= 1 + 1e-12).all()


def test_each_is_that_of_the_textbook():
    """On whole matrices: r = g' W (I - H) g, w of the residuals, and (B' W B)^-1 B' W g d."""
    system = made(np.random.default_rng(5))
    V, G, B = dense(system), system.errors.G.toarray(), system.B
    x, cov, _ = generalised(B, system.c, V)
    W, K = np.linalg.inv(V), cov @ B.T @ np.linalg.inv(V)
    r = np.einsum("mj,mn,nj->j", G, W - W @ B @ K, G)
    seen = r > 1e-6

    found = reliability(system, solution(system, EYE, scale=2.0))

    assert seen.sum() == len(r) - 1, "the gain is a mix of the columns of B"
    assert found.r == pytest.approx(r, abs=1e-9)
    w = (G.T @ W @ (system.c - B @ x))[seen] / np.sqrt(r[seen])
    assert found.w[seen] == pytest.approx(w / 2, abs=1e-8)
    assert np.isinf(found.visible[~seen]).all()
    moves = np.abs(K @ G).T / np.sqrt(np.diag(cov))
    assert found.moves[seen] == pytest.approx(
        moves[seen] * (found.visible[seen] / 2)[:, None], rel=1e-6
    )


@pytest.fixture(scope="module")
def campaign():
    """A simulated campaign, its values and the tables of what controls what."""
    case = small(seed=8, poses={"count": 7}, pulls={"steps_n": [1500.0, 3000.0, 2000.0]})
    return case, *_controlled(case)


def _controlled(case):
    fitted = fit(case, bring(case))
    values = joint_springs(fitted)
    at = place_of_interest(case.settings.test_pose, case.robot, fitted.data.pulls)
    found = control(values, at)
    return values, found.readings, found.pulls


@pytest.mark.whole
def test_the_smallest_visible_error_is_found_in_four_of_five_cases(campaign):
    """10 000 blunders of that size in drawn errors, refitted by plain numpy: 80 +- 1.5 %."""
    system = campaign[1].first.system
    found = reliability(system, solution(system, np.eye(len(system.parameters))))
    rng = np.random.default_rng(11)
    G, M = system.errors.G.toarray(), len(system.c)
    L = np.linalg.cholesky(G @ G.T)
    A = np.linalg.solve(L, system.B / np.linalg.norm(system.B, axis=0))
    D = np.linalg.solve(L, G)
    off = rng.choice(np.flatnonzero(found.r > 1e-3), 10_000)
    e = rng.standard_normal((10_000, G.shape[1]))
    e[np.arange(len(off)), off] += found.visible[off] * rng.choice([-1, 1], len(off))
    y = e @ D.T
    left = y - y @ A @ np.linalg.pinv(A)  # rows are campaigns: y (I - H)
    D_left = D - A @ np.linalg.lstsq(A, D, rcond=None)[0]
    w = np.einsum("nm,mn->n", left, D[:, off]) / np.linalg.norm(D_left[:, off], axis=0)

    assert pytest.approx(found.r.sum(), abs=1e-9) == M - 7
    assert np.mean(np.abs(w) > 3.2905) == pytest.approx(0.80, abs=0.015)
    assert pytest.approx(3.2905, abs=1e-4) == CRITICAL


def test_a_reading_that_is_off_stands_out_where_it_stands(campaign):
    """Off by three smallest visible errors, it has the largest w, by file, line and name."""
    case, _, table, _ = campaign
    row = table[(table["source"] == "tracker") & (table["axis"] == "y")].iloc[20]
    group, target = row["reading"].split("/")
    step = np.array([0.0, 3 * row["smallest_visible"], 0.0])
    R = register(case.settings, case.readings).R

    worse = _controlled(moved(case, where(case, group, target), R.T @ step))[1]

    worst = worse.loc[worse["w"].abs().idxmax()]
    assert (worst["file"], worst["line"]) == (row["file"], row["line"])
    assert worst["reading"] == row["reading"]
    lines = case.readings.set_index("line")
    assert f"{lines.loc[row['line'], 'group']}/{lines.loc[row['line'], 'target']}" == row["reading"]


def test_sizes_are_those_that_were_stated(campaign):
    """A smallest visible error is sqrt(l / r) standard uncertainties, in m, N or rad."""
    _, values, table, _ = campaign
    alone = table["smallest_visible"] * np.sqrt(table["r"]) / (3.2905 + 0.8416)
    of = table.assign(std=alone).groupby("source")["std"]
    data = values.fitted.data
    far = np.sqrt(np.trace(data.direction_cov, axis1=1, axis2=2) / 2)

    assert of.get_group("tracker").to_numpy() == pytest.approx(3e-5, rel=1e-3)
    assert of.get_group("zero").to_numpy() == pytest.approx(3e-5 / np.sqrt(2), rel=1e-3)
    assert of.get_group("force_reading").to_numpy() == pytest.approx(PLAN.scale.sigma_n, rel=1e-3)
    assert sorted(of.get_group("direction")) == pytest.approx(sorted(np.repeat(far, 2)), rel=1e-3)
    assert of.get_group("base").to_numpy() == pytest.approx(3e-5, rel=1e-3)
    assert set(table["unit"][table["source"] == "direction"]) == {"rad"}


@pytest.mark.whole
def test_what_an_error_moves_is_what_the_next_run_finds(campaign):
    """The campaign fitted again with the error in its files: stiffnesses move as foretold."""
    case, values, table, _ = campaign
    R = register(case.settings, case.readings).R
    springs = table[table["moves_most"].str.startswith("k_")]
    for source in ("tracker", "base"):
        rows = springs[springs["source"] == source]
        row = rows.loc[rows["moves_sigmas"].idxmax()]
        k = [f"k_{joint.name}" for joint in case.robot.joints].index(row["moves_most"])
        step = R.T @ (np.eye(3)["xyz".index(row["axis"])] * 0.1 * row["smallest_visible"])

        off = moved(case, where(case, *row["reading"].split("/")), step)
        fitted = fit(off, bring(off))

        was = values.fitted.estimate
        went = abs(fitted.estimate.value[k] - was.value[k]) / was.std[k]
        assert went == pytest.approx(0.1 * row["moves_sigmas"], rel=0.02)


def test_base_readings_have_an_adjustment_of_their_own(campaign):
    """Their r add up to 3 n - 6; each is how much of a step in it its own residual shows."""
    case, _, table, _ = campaign
    base = table[table["source"] == "base"]
    first = base.iloc[4]
    axis = "xyz".index(first["axis"])
    group, target = first["reading"].split("/")
    before = register(case.settings, case.readings)
    step = before.R.T @ (np.eye(3)[axis] * 1e-6)
    off = moved(case, where(case, group, target), step)
    at = (before.table["group"] == group) & (before.table["target"] == target)
    column = f"d{first['axis']}_m"
    after = register(case.settings, off.readings)
    moves = (after.table[at][column] - before.table[at][column]).item()

    assert base["r"].sum() == pytest.approx(len(base) - 6, abs=1e-9)
    assert first["r"] == pytest.approx(moves / 1e-6, rel=1e-4)


def test_a_pull_moves_what_refitting_without_it_moves():
    """On whole matrices, the rows of the pull deleted."""
    system = made(np.random.default_rng(3), force_m=8e-5)
    V = dense(system)
    x, cov, _ = generalised(system.B, system.c, V)

    found = influence(system, solution(system, EYE))

    for pull in np.unique(system.rows.pull):
        kept = np.flatnonzero(system.rows.pull != pull)
        without, *_ = generalised(system.B[kept], system.c[kept], V[np.ix_(kept, kept)])
        assert found[pull] == pytest.approx(np.abs(without - x) / np.sqrt(np.diag(cov)), rel=1e-6)


def test_what_one_pull_alone_determines_is_lost_without_it():
    """A parameter that moves the rows of a single pull goes with it, the others stay."""
    system = made(np.random.default_rng(4))
    B = system.B.copy()
    B[system.rows.pull != 5, 1] = 0.0
    found = influence(system, at := solution(replace(system, B=B), EYE))

    assert np.isfinite(at.std).all()
    assert np.isinf(found[5, 1])
    assert np.isfinite(np.delete(found, 5, axis=0)).all()


def test_a_cause_that_rests_on_one_pull_is_said_to():
    """Beyond one of its standard uncertainties, and where nothing else determines it."""
    effect = next(one for one in catalogue(load("kr500_rail")) if one.name == "load_point_offset")

    def said(sigmas):
        most = Carried(
            what="dl_x", name=effect.name, where=None, pose=11, repeat=2, moves_sigmas=sigmas
        )
        return hangs_on(effect, most)

    assert said(0.99) is None
    assert said(1.23).startswith(
        "Offset of the load point or the targets depends on pull 2 of pose 11 alone"
    )
    assert "dl_x moves by 1.2 of its standard uncertainties" in said(1.23)
    assert "nothing determines dl_x" in said(None)
