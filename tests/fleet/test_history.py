from __future__ import annotations

import json

import numpy as np
import pytest
import report_sample
from conftest import without_drawings
from scipy import stats

from pipeline.answer.contract import PositionStep, Reason, Unit
from pipeline.fleet.history import changes, finished, ordered, previous
from pipeline.fleet.overview import comparison, overview, render_overview
from pipeline.fleet.trends import robots, together, trends
from pipeline.report.model import compose
from pipeline.report.record import Figure, ReportTable
from pipeline.report.render import render

SAMPLE = report_sample.answer()
REVOLUTE = SAMPLE.stiffness[1]


def joint(name, compliance, std, **more):
    """The stiffness of a revolute joint."""
    value = 1 / compliance if compliance > 0 else None
    bounds = (1 / (compliance + 2 * std), 1 / (compliance - 2 * std))
    own = {
        "name": name,
        "value": value,
        "std": std * value**2 if value else None,
        "ci95": bounds if value else (None, None),
        "compliance": compliance,
        "compliance_std": std,
    }
    return REVOLUTE.model_copy(update=own | more)


def campaign(name, compliances, std=1e-9, measured=None, robot="kr500_rail"):
    """An answer with as many joints as compliances."""
    stiffness = tuple(joint(f"k_{k}", c, std) for k, c in enumerate(compliances))
    own = {"campaign": name, "robot": robot, "measured": measured, "stiffness": stiffness}
    return SAMPLE.model_copy(update=own)


def years(rng, drift, n=6, joints=7, std=1e-9):
    """Campaigns half a year apart; the first joint's compliance grows by `drift` a year."""
    true = 2e-7 * np.ones(joints)
    out = []
    for k in range(n):
        now = true + np.eye(joints)[0] * drift * k / 2
        day = f"20{20 + k // 2}-{1 + 6 * (k % 2):02d}-01"
        out.append(campaign(f"c{k}", now + std * rng.standard_normal(joints), std, day))
    return out


@pytest.mark.whole
def test_campaigns_of_a_steady_robot_are_rarely_flagged():
    """Over 1000 histories of seven joints that do not change, at most about 1 % are flagged."""
    rng = np.random.default_rng(11)
    flagged = sum(any(d.sure for d in trends(years(rng, 0.0))) for _ in range(1000))

    assert flagged <= 20  # 1 % of 1000 and 3 standard deviations


def test_a_step_without_a_trend_is_flagged_too():
    """One campaign that stands apart is seen, dated or not."""
    rng = np.random.default_rng(4)
    results = [campaign(f"c{k}", 2e-7 + 1e-9 * rng.standard_normal(3)) for k in range(5)]
    first, _, third = results[2].stiffness
    apart = (first, joint("k_1", 2.1e-7, 1e-9), third)
    results[2] = results[2].model_copy(update={"stiffness": apart})

    found = trends(results)

    assert [d.sure for d in found] == [False, True, False]


def test_two_campaigns_differ_with_the_stated_frequency():
    """Where nothing changed, 1 % of the comparisons of seven joints are flagged at all."""
    rng = np.random.default_rng(8)
    flagged = 0
    for _ in range(2000):
        a, b = (campaign("x", 2e-7 + 1e-9 * rng.standard_normal(7)) for _ in range(2))
        flagged += any(c.sure for c in changes(a.stiffness, b.stiffness))

    assert 5 <= flagged <= 38  # 20 expected


def test_a_change_has_the_uncertainty_of_both():
    """The spread of the change in percent over repetitions is what is stated."""
    rng = np.random.default_rng(9)
    found = []
    for _ in range(1500):
        a = [joint("k", 2e-7 + 3e-9 * rng.standard_normal(), 3e-9)]
        b = [joint("k", 1.6e-7 + 2e-9 * rng.standard_normal(), 2e-9)]
        found.append(changes(a, b)[0])

    assert np.mean([c.percent for c in found]) == pytest.approx(25, abs=0.3)
    assert np.std([c.percent for c in found]) == pytest.approx(
        np.mean([c.percent_std for c in found]), rel=0.06
    )
    assert all(c.sure for c in found)


def test_all_joints_together_use_the_correlations():
    """The joint chi-square is distributed as one, and not when correlations are left out."""
    rng = np.random.default_rng(10)
    half = 1e-9 * (0.2 * rng.standard_normal((4, 4)) + 1.0)
    cov = half @ half.T
    with_, without = [], []
    for _ in range(1500):
        a, b = (
            [joint(f"k{k}", 2e-7 + e, float(np.sqrt(cov[k, k]))) for k, e in enumerate(half @ z)]
            for z in rng.standard_normal((2, 4))
        )
        with_.append(together(a, b, cov, cov)[0])
        without.append(together(a, b, np.diag(np.diag(cov)), np.diag(np.diag(cov)))[0])

    assert stats.kstest(with_, stats.chi2(4).cdf).pvalue > 1e-3
    assert stats.kstest(without, stats.chi2(4).cdf).pvalue < 1e-6


def test_what_is_not_determined_is_not_compared():
    """A joint without a value in one campaign has no change and raises no alarm."""
    a = [joint("k", 2e-7, 1e-9), joint("l", 2e-7, 1e-9)]
    b = [joint("k", 3e-7, 1e-9, identifiable=False, value=None), joint("l", -1e-9, 1e-9)]

    first, second = changes(a, b)

    assert (first.percent, first.sigmas, first.sure) == (None, None, False)
    assert second.percent is None
    assert second.sure  # its compliance has changed for certain, though it gives no stiffness


def test_the_previous_campaign_is_the_last_earlier_one_of_the_robot():
    """Later ones, other robots and undated ones are never taken for the previous one."""
    now = campaign("now", [2e-7], measured="2026-05-01T08:00:00")
    others = [
        campaign("old", [2e-7], measured="2025-01-01"),
        campaign("last", [2e-7], measured="2026-04-30T23:00:00"),
        campaign("later", [2e-7], measured="2026-05-02"),
        campaign("other", [2e-7], measured="2026-04-30T23:30:00", robot="fanuc"),
        campaign("undated", [2e-7]),
        now,
    ]

    assert previous(now, others).campaign == "last"
    assert previous(campaign("undated", [2e-7]), others) is None
    assert ordered(others)[0].campaign == "old"
    assert ordered(others)[-1].campaign == "undated"


def test_a_result_that_this_version_cannot_read_is_left_out_and_said(tmp_path):
    """Once, by the name of its campaign; the others are there."""
    for name, content in (("good", SAMPLE.as_json()), ("old", {"campaign": "old"})):
        reports, processed = tmp_path / "reports" / name, tmp_path / "data" / "processed" / name
        reports.mkdir(parents=True)
        processed.mkdir(parents=True)
        (reports / "result.json").write_text(json.dumps(content))
        (processed / "manifest.json").write_text(json.dumps({"key": "k", "outputs": {}}))
    told = []

    assert [one.campaign.name for one in finished(tmp_path, told.append)] == ["good"]
    assert [one.partition(" ")[0] for one in told] == ["old"]


def of_weight(answer):
    """The same from positions under the arm's own weight."""
    step = PositionStep(model="nominal table", between_mm=1.0, space_mm=1.0, series_mm=None)
    return answer.model_copy(update={"position_steps": (step,)})


def test_stiffnesses_from_weight_are_not_compared_with_those_from_pulls():
    """Neither by the report of the later one nor over the campaigns of a robot."""
    spring = campaign("spring", [2e-7], measured="2026-03-01")
    summer = of_weight(campaign("summer", [4e-7], measured="2026-06-01"))
    autumn = campaign("autumn", [2e-7], measured="2026-09-01")

    assert previous(autumn, [spring, summer]).campaign == "spring"
    assert previous(summer, [spring]) is None
    (only,) = trends([spring, summer, autumn])
    assert (only.campaigns, only.sure) == (2, False)


def unit(serial):
    """A machine with a serial number."""
    return Unit(serial=serial, certificate=None, calibrated=None)


def not_explained(answer):
    """The same, its readings explained by no model."""
    said = answer.recommended.model_copy(update={"reason": Reason.UNEXPLAINED})
    return answer.model_copy(update={"recommended": said})


def test_two_machines_of_one_type_have_a_history_each():
    """Their stiffnesses differ by tens of per cent, which is no change of either."""
    first = [
        campaign(f"a{k}", [2e-7], measured=f"2026-0{k}-01").model_copy(
            update={"robot_unit": unit("17")}
        )
        for k in (1, 3)
    ]
    second = [
        campaign(f"b{k}", [3e-7], measured=f"2026-0{k}-01").model_copy(
            update={"robot_unit": unit("18")}
        )
        for k in (2, 4)
    ]
    report = overview([*first, *second])

    assert previous(second[1], [*first, *second]).campaign == "b2"
    assert previous(second[0], [*first, *second]) is None
    assert list(robots([*first, *second])) == [
        "kr500_rail, serial number 17",
        "kr500_rail, serial number 18",
    ]
    assert report.verdict == "No stiffness has changed"
    nameless = [one.model_copy(update={"robot_unit": None}) for one in (*first, *second)]
    assert overview(nameless).verdict == "A stiffness has changed"


def test_what_no_model_explains_neither_raises_nor_hides_an_alarm():
    """A value far off is drawn hollow and left out; the change between the others is still seen."""
    steady = [campaign(f"c{k}", [2e-7], measured=f"2026-0{k}-01") for k in (1, 3, 5)]
    odd = not_explained(campaign("odd", [4e-7], measured="2026-04-01"))
    softer = campaign("softer", [2.1e-7], measured="2026-06-01")

    (held,) = trends([*steady, odd])
    (found,) = trends([*steady, odd, softer])
    page = render_overview([*steady, odd]).decode()

    assert (held.sure, held.campaigns) == (False, 3)
    assert (found.sure, found.campaigns) == (True, 4)
    assert previous(softer, [*steady, odd]).campaign == "c5"
    assert "Hollow and not compared: odd." in page


# --- pages ---------------------------------------------------------------------------------


def test_a_campaign_says_what_changed_since_the_previous_one():
    """The stiffness table has the change with its uncertainty, and a certain one is a finding.

    A finding has the name of the controller's axis, where the robot file states it.
    """
    result, tables = report_sample.answer(), report_sample.tables()
    first, second, *others = result.stiffness
    stiffer = {
        "value": 1.5 * second.value,
        "compliance": second.compliance / 1.5,
        "compliance_std": second.compliance_std / 1.5,
    }
    joints = (first, second.model_copy(update=stiffer), *others)
    named = second.model_copy(update={"axis": "A1"})
    result = result.model_copy(update={"stiffness": (first, named, *others)})
    before = result.model_copy(update={"campaign": "kr500-spring", "stiffness": joints})

    report = compose(result, tables, previous=before)
    stiffness = next(one for one in report.sections if one.key == "stiffness")
    table = next(b for b in stiffness.blocks if isinstance(b, ReportTable))
    findings = [b.text for b in stiffness.blocks if getattr(b, "tone", "") == "finding"]

    assert table.columns[-1].title == "Change since kr500-spring [%]"
    assert [row[-1].text for row in table.rows][:2] == ["0.00 ± 0.58", "-33.33 ± 0.76"]
    assert sum("changed by" in text for text in findings) == 1
    assert "A1 (k_theta2) changed by (-33.33 ± 0.76)" in " ".join(findings).replace("\N{NBSP}", " ")
    with without_drawings():
        page = render(result, tables, previous=before)["index.html"]
    assert b"Change since kr500-spring" in page


def test_the_overview_lists_all_and_flags_the_one_that_changed():
    """Every campaign has a line with a link to its page; a drift is said first and drawn in red."""
    results = [*years(np.random.default_rng(1), 8e-9), campaign("solo <b>", [1e-7], robot="f")]
    report = overview(results)
    page = render_overview(results).decode()

    assert report.tone == "attention"
    assert "k_0 changed by more than chance explains" in report.first[-1].text
    assert len(report.sections[0].blocks[0].rows) == 7
    assert 'href="c3/index.html"' in page
    assert 'href="solo%20%3Cb%3E/index.html"' in page
    assert "<b>" not in page
    assert page.count('data-tip="') == 6 * 7
    assert "One campaign so far" in page
    assert [f.name for f in report.figures] == ["history-1"]


def test_the_overview_names_the_axes_of_the_controller():
    """Trend, finding, caption and first screen say A1 where the robot file says it."""
    results = [
        one.model_copy(
            update={"stiffness": tuple(j.model_copy(update={"axis": f"A{j.name[2:]}"})
                                       for j in one.stiffness)}
        )
        for one in years(np.random.default_rng(1), 8e-9)
    ]  # fmt: skip
    report = overview(results)
    finding, trend, figure = report.sections[1].blocks

    assert "A0 (k_0) changed by more" in report.first[-1].text
    assert finding.text.startswith("A0 (k_0) changed")
    assert [row[0].text for row in trend.rows][:2] == ["A0 (k_0)", "A1 (k_1)"]
    assert "Changed: A0 (k_0) in another colour" in figure.caption


def test_the_overview_is_the_same_every_time():
    """The same results, in whatever order they are found, give the same bytes."""
    results = years(np.random.default_rng(1), 0.0)

    assert render_overview(results) == render_overview(results[::-1])


def test_two_models_of_one_campaign_are_not_tested():
    """Models of the same readings share their errors: a difference is shown and not judged."""
    a, b = campaign("x", [2e-7, 1e-7]).stiffness, campaign("x", [3e-7, 1e-7]).stiffness

    report = comparison(("x", "x, extended"), a, b, None)
    table = next(x for s in report.sections for x in s.blocks if not isinstance(x, Figure))

    assert report.verdict == "Not tested"
    assert table.rows[0][4].text == "-33.3"
    assert [row[6].text for row in table.rows] == [table.rows[0][5].text] * 2
