"""The paper's numbers, with their tolerance, and what cannot be reproduced."""

import json

import numpy as np
import pytest

from bench.paper import reproduction
from bench.paper import tables as paper
from bench.paper.__main__ import command
from pipeline.app import cli
from pipeline.design.curves import ByAnchor, BySize
from pipeline.design.information import station
from pipeline.machine.robot import load

SEED = 3


@pytest.fixture(scope="module", params=["kr500_rail", "kr500_rail_kuka"])
def problem(request):
    return paper.reference(load(request.param))


@pytest.fixture(scope="module")
def published(problem):
    return paper.published_plan(problem, paper.printed())


@pytest.fixture(scope="module")
def draws(problem, published):
    rng = np.random.default_rng(SEED)
    return {k: paper.repeat(problem, published, rng, 200) for k in ("published", "better")}


def entries(rows):
    return {one.what: one for one in rows}


def test_table_ii_within_two_per_cent_as_printed():
    """Rows n = 3, 6, 12 of m_0 = 3 for Table I as printed; other plans are not published."""
    made = paper.reference(load("kr500_rail"))
    plan = paper.published_plan(made, paper.printed())
    sizes = BySize(np.array([3, 4, 6, 12]), np.array([3, 4, 6, 12]), np.full((4, 4), np.nan))
    found = entries(paper.table_ii(paper.printed(), plan, sizes))

    assert len(found) == 8
    for n in (3, 6, 12):
        assert found[f"n = {n}, m_0 = 3"].ratio == pytest.approx(1.0, abs=0.02)
    assert found["n = 12, m_0 = 12"].ours is None
    assert "not published" in found["n = 12, m_0 = 12"].note


def test_the_real_arm_changes_table_ii_by_eight_per_cent():
    """With d_5 = -55 mm the published plan gives 0.927e-2 mm instead of 1.008e-2."""
    figures = [
        paper.published_plan(paper.reference(load(name)), paper.printed()).figure
        for name in ("kr500_rail", "kr500_rail_kuka")
    ]

    assert figures[1] / figures[0] == pytest.approx(0.920, abs=0.001)


def test_repetitions_scatter_as_the_law_of_errors_says(problem, published):
    """4000 repetitions of Eq. (21): covariance of the compliances by propagation of Eq. (18)."""
    made = paper.repeat(problem, published, np.random.default_rng(1), 4000)
    at = station(problem.experiment, published.q, published.anchor)
    B = 950 * np.tile(
        np.concatenate([at.A[..., k].transpose(0, 2, 1).reshape(9, 7) for k in range(3)]), (4, 1)
    )
    P = np.linalg.pinv(B)
    V = 9e-10 * np.diag(np.tile([0.25, 0.25, 0.5], len(B) // 3))
    expected = np.sqrt(np.diag(P @ V @ P.T))
    relative = made.compliance / problem.experiment.scale

    assert relative.std(axis=0) == pytest.approx(expected, rel=0.04)
    assert relative.mean(axis=0) == pytest.approx(1.0, abs=5 * expected.max() / np.sqrt(4000))


def test_table_iv_orders_the_arm_s_joints_and_gives_up_on_the_rail(problem, draws):
    """Joints 5 and 7 are worst, 2 is best, as printed; k_r1 is beyond 950 N and says so."""
    found = entries(paper.table_iv(paper.printed(), problem, draws))
    std = {j: found[f"std of k_theta{j}"].ours for j in range(2, 8)}

    assert set(sorted(std, key=std.get)[-2:]) == {5, 7}
    assert sorted(std, key=std.get)[:3] == [2, 3, 4]
    assert found["std of k_r1"].ours is None
    assert "would take some" in found["std of k_r1"].note
    assert found["std of k_theta5"].ratio == pytest.approx(1.1, abs=0.3)


def test_table_v_from_table_iv_as_printed(problem, draws):
    """With the printed deviations drawn one by one, the workspace comes out within 15 %."""
    rng = np.random.default_rng(2)
    found = entries(paper.table_v(paper.printed(), problem, draws, rng, 600))

    for point in (1, 2, 3):
        one = found[f"global, P{point}, Table IV as printed, independent draws"]
        assert one.ratio == pytest.approx(1.08, abs=0.12)


def test_independent_draws_hide_what_the_plan_was_chosen_for(problem, draws):
    """Correlations make the test pose better than Eq. (23) lets it look."""
    rng = np.random.default_rng(2)
    found = entries(paper.table_v(paper.printed(), problem, draws, rng, 600))

    for point in (1, 2, 3):
        whole, alone = (
            found[f"test_pose, P{point}, {kind} draws"].ours
            for kind in ("covariance", "independent")
        )
        assert alone > 1.5 * whole


def test_the_minimum_of_fig_6_is_where_the_curve_is_lowest():
    """Places where a plan breaks its limits do not count."""
    at = np.array([1.0, 2.0, 3.0])
    curve = ByAnchor(0, at, np.array([3.0, np.nan, 1.0]), np.array([2.0, 1.5, np.nan]))
    (one,) = paper.figure_6(paper.printed(), curve)

    assert (one.paper, one.ours, one.better) == (5.04, 2.0, 3.0)


@pytest.mark.slow
def test_the_command_prints_every_entry(capsys, monkeypatch, tmp_path):
    """Both robots, paper, ours and ratio, assumptions and misprints; page and PDF are written."""
    small = paper.Effort(first=0, rounds=1, poses=48, settled=6, exchanged=1)
    monkeypatch.setattr(paper, "Effort", lambda **_: small)
    four, curve = np.array([3, 4, 6, 12]), np.linspace(3e-6, 4e-6, paper.PLACES)
    sizes = BySize(four, four, np.full((4, 4), 3e-6))
    monkeypatch.setattr(paper, "by_size", lambda *_: sizes)
    monkeypatch.setattr(paper, "by_anchor", lambda p, plan, at, seed: ByAnchor(0, at, curve, curve))
    arguments = ["--repetitions", "40", "--poses", "40", "--root", str(tmp_path)]
    assert cli._exit_code([*arguments, "--json", "--write"], command) == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[0])

    assert list(printed["robots"]) == list(reproduction.ROBOTS)
    for rows in printed["robots"].values():
        assert {row["table"] for row in rows} == {"II", "IV", "V", "Fig. 6"}
        for row in rows:
            assert row["note"] or row["ours"] is not None
            if row["ours"] is not None:
                assert row["ratio"] == pytest.approx(row["ours"] / row["paper"])
    assert any("Eq. (8)" in line for line in printed["misprints"])
    assert (tmp_path / "reports" / "paper" / "report.pdf").read_bytes().startswith(b"%PDF")
    assert "Table II" in (tmp_path / "reports" / "paper" / "index.html").read_text()
