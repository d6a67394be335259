"""Robots over their campaigns: wear found by all joints together, and nothing else taken for it."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, datetime

import numpy as np
import pytest
from test_history import campaign, unit

from pipeline.base.quantities import typeset
from pipeline.fleet import wear_table
from pipeline.fleet.overview import comparison, overview, render_overview
from pipeline.fleet.sentences import alarm, fleet_sentences
from pipeline.fleet.wear.alarm import A_YEAR, ChangeKind, interim_tests
from pipeline.fleet.wear.hierarchy import hierarchy
from pipeline.fleet.wear.machine import Machine, Repair, Visit
from pipeline.fleet.wear.scatter import scatter
from pipeline.fleet.wear.state import fleet
from pipeline.fleet.wear.trend import trends

NEW = np.array([2e-7, 1.5e-7, 2.5e-7, 1.8e-6])


def robot(rng, lost=0.0, joint=0, years=6, own=0.01, error=0.005, mix=None, steps=()):
    """Visits twice a year of a robot that loses a part of one stiffness every year."""
    n, visits = len(NEW), []
    L = error * np.diag(NEW) @ (np.eye(n) if mix is None else mix)
    part = rng.lognormal(0, 0.1, n)
    for k in range(2 * years):
        year = 2000 + k / 2 + rng.uniform(0, 0.1)
        stiffness = part / NEW
        stiffness[joint] *= (1 - lost) ** (year - 2000)
        for at, which, by in steps:
            stiffness[which] *= by if year >= at else 1.0
        stiffness = stiffness * rng.lognormal(0, own, n)
        x = 1 / stiffness + L @ rng.standard_normal(n)
        visits.append(Visit(f"c{k}", year, x, L @ L.T))
    return visits


def robots(rng, count=6, **what):
    return [Machine.of(str(k), robot(rng, **what)) for k in range(count)]


def test_trends_are_those_of_all_rows_at_once():
    """Value and covariance are the generalised least squares of every row in one matrix."""
    rng = np.random.default_rng(1)
    mix = np.eye(4) + 0.6 * rng.standard_normal((4, 4))
    visits = robot(rng, 0.03, mix=mix)
    visits[3] = Visit("c3", visits[3].year, np.append(np.nan, visits[3].x[1:]), visits[3].cov)
    machine = Machine.of("", visits)
    found = scatter([machine])
    rows, design, block = [], [], []
    for visit in visits:
        use = np.flatnonzero(np.isfinite(visit.x))
        rows.append(visit.x[use] / machine.reference[use] - 1)
        eye = np.eye(4)[use]
        design.append(np.hstack([eye, eye * (visit.year - visits[0].year)]))
        relative = visit.cov / np.outer(machine.reference, machine.reference)
        daily = np.diag(found.variance[:4]) + found.variance[4]
        block.append((relative + daily)[np.ix_(use, use)])
    size = sum(map(len, rows))
    V, at = np.zeros((size, size)), 0
    for one in block:
        V[at : at + len(one), at : at + len(one)] = one
        at += len(one)
    X, y = np.vstack(design), np.concatenate(rows)
    cov = np.linalg.inv(X.T @ np.linalg.solve(V, X))
    expected = (cov @ X.T @ np.linalg.solve(V, y))[4:]

    got = trends(machine, found)

    assert np.allclose(got.value, expected, atol=2e-6)
    assert np.allclose(got.cov, cov[4:, 4:], rtol=1e-3, atol=1e-9)


def test_intervals_hold_the_wear_and_the_scatter_is_found():
    """95 % intervals of every joint cover it as often, with another scatter than the stated one."""
    rng, inside, scatters = np.random.default_rng(2), [], []
    for _ in range(6):
        machines = robots(rng, 8, lost=0.04, joint=1, own=0.02, years=4)
        found = scatter(machines)
        scatters.append(found.std[:4])
        for machine in machines:
            one = trends(machine, found)
            true = np.array([0.0, -np.log(0.96), 0.0, 0.0])
            # a compliance that grows by a part of itself grows by more of its mean
            bend = np.array([0.0, 0.002, 0.0, 0.0])
            inside.append(np.abs(one.value - true) < one.half + bend)

    assert 0.91 < np.mean(inside) < 0.985
    assert np.mean(scatters) == pytest.approx(0.02, abs=0.0025)


@pytest.mark.whole
def test_steady_robots_rarely_raise_an_alarm():
    """Less than one in a hundred robot-years, though each is looked at twice a year."""
    rng, raised, years = np.random.default_rng(3), 0, 0.0
    for _ in range(12):
        machines = robots(rng, 8)
        found = scatter(machines)
        for machine in machines:
            raised += any(look.alarm for look in interim_tests(machine, found))
            years += machine.t[-1]

    assert years > 500
    assert raised <= 12  # 5 are expected of 1 % a year, with a chance of 0.2 % for more than 12


def test_errors_that_joints_share_cancel():
    """What a joint loses shows although errors as large are common to it and another joint."""
    rng = np.random.default_rng(4)
    mix = np.array([[1, 0, 0, 0], [0.99, 0.1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    visits = robot(rng, 0.015, error=0.04, own=0.003, years=4, mix=mix)
    alone = [Visit(v.campaign, v.year, v.x, np.diag(np.diag(v.cov))) for v in visits]
    whole, apart = (Machine.of("", one) for one in (visits, alone))
    stated = scatter([whole], stated=0.003)

    assert interim_tests(whole, stated)[-1].alarm
    assert interim_tests(whole, stated)[-1].joints == (0,)
    assert (
        interim_tests(whole, stated)[-1].p_value < 1e-3 * interim_tests(apart, stated)[-1].p_value
    )


def test_a_repair_that_is_told_is_no_wear():
    """The joint begins anew; untold, the same is a step with the campaign after which it came."""
    rng = np.random.default_rng(5)
    visits = robot(rng, steps=[(2003.0, 2, 1.3)], years=5)
    knows = Machine.of("", visits, [Repair(2002.9, (2,))])
    knows_not = Machine.of("", visits)
    found = scatter(robots(rng, 3))
    steps = [look for look in interim_tests(knows_not, found) if look.alarm]

    assert not any(look.alarm for look in interim_tests(knows, found))
    assert len(interim_tests(knows, found)) == 4, "looks begin again with the repair"
    assert steps[0].campaign == "c6"
    assert (steps[0].kind, steps[0].after, steps[0].joints) == (ChangeKind.STEP, "c5", (2,))
    assert trends(knows, found).std[2] > 2 * trends(knows_not, found).std[2]


def test_campaigns_of_one_day_are_looked_at_once():
    """A false alarm is not drawn for twice where two campaigns are of one day."""
    visits = robot(np.random.default_rng(6), years=3)
    again = Visit("again", visits[-1].year, visits[-1].x, visits[-1].cov)

    seen = interim_tests(Machine.of("", [*visits, again]), scatter([Machine.of("", visits)]))

    assert len(seen) == len(visits) - 1
    # of the years since the campaign before, which may all be spent
    assert sum(look.allowed for look in seen) <= A_YEAR * (visits[-1].year - visits[0].year + 1e-9)


def test_a_type_says_how_its_robots_differ_and_wear():
    """Mean and spread of levels and trends come out, and pull in a robot that knows little."""
    rng = np.random.default_rng(7)
    machines = robots(rng, 30, lost=0.02, joint=3, years=4)
    short = Machine.of("short", robot(rng, lost=0.02, joint=3, years=1)[:2])
    found = hierarchy([*machines, short], scatter(machines))

    assert found.mean[4 + 3] == pytest.approx(-np.log(0.98), abs=0.003)
    assert np.abs(found.mean[4:7]).max() < 0.003
    assert np.sqrt(np.diag(found.between)[:4]) == pytest.approx(np.full(4, 0.1), abs=0.035)
    assert found.values[-1, 7] == pytest.approx(0.02, abs=0.015)
    assert np.sqrt(found.covs[-1, 7, 7]) < 0.02
    assert not found.guessed
    assert hierarchy(machines[:2], scatter(machines)).guessed


# --- from tables to words ------------------------------------------------------------------


def tables(serials=("1",), years=4, **what):
    """Rows of the tables that `wear` is made of."""
    rng = np.random.default_rng(8)
    campaigns, stiffness, covariance = [], [], []
    for serial in serials:
        lost = what if serial == serials[0] else {}
        for k, visit in enumerate(robot(rng, years=years, **lost)):
            name = f"r{serial}-{k}"
            day = datetime(2020 + k // 2, 1 + 6 * (k % 2), 3, 8)
            campaigns.append(
                {"campaign": name, "verdict": "adequate", "measured": day, "robot_serial": serial}
            )
            for j, x in enumerate(visit.x):
                about = {"campaign": name, "model": "recommended", "identifiable": True}
                about["axis"] = f"A{j}" if j else None
                stiffness.append(about | {"joint": j + 1, "name": f"k_{j}", "compliance": x})
                covariance += [
                    {"campaign": name, "parameter": f"c_{j}", "other": f"c_{i}", "covariance": c}
                    for i, c in enumerate(visit.cov[j])
                ]
    return wear_table.History(campaigns, stiffness, covariance, [])


def standing(history, scatter=None):
    return wear_table.robots("kr500_rail", wear_table.rows(history, scatter))


def test_a_worn_joint_is_told_in_one_sentence():
    """With its size; the table has every robot, the one that needs action first."""
    wear = standing(tables(("3", "7"), lost=0.05, joint=2))
    words = alarm(wear[0])
    answers = [
        campaign(f"r{one.serial}-{k}", [2e-7] * 4, measured=f"202{k}-01-01").model_copy(
            update={"robot_unit": unit(one.serial)}
        )
        for one in wear
        for k in range(3)
    ]
    report = overview(answers, wear)
    table = report.sections[0].blocks[0]

    assert words.startswith("A2 (k_2) grows softer by (5.")
    assert words.endswith(").")
    assert wear[1].alarm is None
    assert report.verdict == "A stiffness has changed"
    assert any(typeset(words) in one.text for one in report.first)
    assert [row[0].text for row in table.rows] == ["3", "7"]
    assert [row[1].text for row in table.rows] == ["inspect A2", "nothing"]
    assert [column.title for column in table.columns[6:8]] == ["k_0 [%/year]", "A1 [%/year]"]
    assert [row[0].text for row in report.sections[2].blocks[1].rows][:2] == ["k_0", "A1 (k_1)"]
    assert all(low < j.percent_a_year < high for j in wear[0].joints
               for low, high in [(j.low, j.high)])  # fmt: skip
    page = render_overview(answers, wear).decode()
    assert 'href="#robot-1"' in page
    assert words.replace("%", "%").split(" by ")[0] in page


def test_only_the_newest_campaign_tells_the_alarm():
    """Earlier ones say nothing of it; with too few campaigns each compares with the one before."""
    wear = standing(tables(lost=0.05, joint=2))
    history = tables(lost=0.05)
    few = standing(replace(history, campaigns=history.campaigns[:1]))
    serial = {"robot_unit": unit("1")}
    newest, earlier = (
        campaign(name, [2e-7] * 4).model_copy(update=serial) for name in ("r1-7", "r1-6")
    )

    assert fleet_sentences(newest, wear) == alarm(wear[0]) != ""
    assert fleet_sentences(earlier, wear) == ""
    assert fleet_sentences(campaign("r1-0", [2e-7]).model_copy(update=serial), few) is None
    assert fleet_sentences(newest, ()) is None


@pytest.mark.parametrize("verdict", ["bad_data", "unexplained"])
def test_what_is_not_trusted_does_not_count(verdict):
    """A campaign with bad data or without an explanation moves nothing."""
    history = tables()
    before = wear_table.rows(history)
    spoilt = [dict(row) for row in history.stiffness]
    for row in spoilt:
        row["compliance"] *= 2.0 if row["campaign"] == "r1-4" else 1.0
    campaigns = [
        row | ({"verdict": verdict} if row["campaign"] == "r1-4" else {})
        for row in history.campaigns
    ]
    without = [row for row in history.campaigns if row["campaign"] != "r1-4"]

    def rows(campaigns):
        return wear_table.rows(wear_table.History(campaigns, spoilt, history.covariance, ()))

    assert rows(campaigns) == rows(without)
    assert rows(campaigns)[0]["campaigns"] == before[0]["campaigns"] - 1
    assert rows(history.campaigns)[0]["scatter_common"] > 5 * before[0]["scatter_common"]


def test_the_same_readings_computed_twice_count_once():
    """A copy of a campaign under another name begins at the same second."""
    history = tables()
    copied = wear_table.History(
        [*history.campaigns, history.campaigns[3] | {"campaign": "copy"}],
        [*history.stiffness, *({**row, "campaign": "copy"} for row in history.stiffness
                               if row["campaign"] == "r1-3")],
        [*history.covariance, *({**row, "campaign": "copy"} for row in history.covariance
                                if row["campaign"] == "r1-3")],
        (),
    )  # fmt: skip

    assert wear_table.rows(copied)[0]["campaigns"] == wear_table.rows(history)[0]["campaigns"]
    assert wear_table.rows(copied)[1]["std"] == pytest.approx(
        wear_table.rows(history)[1]["std"], rel=1e-9
    )


def test_a_repair_in_any_campaign_holds_for_the_robot():
    """Told once, also in a campaign that does not count, it begins a new life of the joint."""
    history = tables(("1", "2", "3", "4"), steps=[(2002.0, 1, 1.3)])
    repair = {"campaign": "r1-7", "day": date(2021, 12, 1), "joint": 2, "what": "gearbox"}
    knows = wear_table.History(history.campaigns, history.stiffness, history.covariance, [repair])

    assert wear_table.rows(history)[0]["alarm"] == "step"
    assert wear_table.rows(knows)[0]["alarm"] is None


def test_a_joint_that_nobody_can_size_has_no_percentage():
    """A compliance that may be zero is no hundred per cent of anything."""
    history = tables()
    loose = [
        row | ({"covariance": 1.0} if row["parameter"] == row["other"] == "c_0" else {})
        for row in history.covariance
    ]

    first, second, *_ = wear_table.rows(
        wear_table.History(history.campaigns, history.stiffness, loose, ())
    )

    assert first["percent_a_year"] is None
    assert second["percent_a_year"] is not None


def test_a_stated_scatter_counts_until_campaigns_tell_it():
    """Where there are too few, it is the stated one; then it follows the campaigns."""
    few, many = tables(years=1), tables(years=6)

    assert wear_table.rows(few, 0.03)[1]["scatter"] == pytest.approx(3.0, rel=1e-3)
    assert wear_table.rows(few, 0.03)[1]["scatter_stated"]
    assert wear_table.rows(many, 0.03)[1]["scatter"] < 2.0
    assert fleet([Machine.of("", robot(np.random.default_rng(9)))], 0.01).robots[0].look


def test_only_the_newest_campaigns_are_followed(monkeypatch):
    """What is older says nothing of today, and costs."""
    history = tables(years=4)
    monkeypatch.setattr(wear_table, "_MOST", 5)
    newest = replace(history, campaigns=history.campaigns[-5:])

    assert wear_table.rows(history) == wear_table.rows(newest)
    assert wear_table.rows(history)[0]["campaigns"] == 5


# --- one comparison ------------------------------------------------------------------------


def told_by(answers):
    """The table `wear` made of these answers, whose errors are independent."""
    campaigns, stiffness, covariance = [], [], []
    for one in answers:
        about = {"campaign": one.campaign, "verdict": "adequate", "robot_serial": None}
        campaigns.append(about | {"measured": datetime.fromisoformat(one.measured)})
        for j, joint in enumerate(one.stiffness):
            row = {"campaign": one.campaign, "model": "recommended", "identifiable": True}
            stiffness.append(
                row
                | {"axis": None, "joint": j + 1, "name": joint.name, "compliance": joint.compliance}
            )
            covariance += [
                {
                    "campaign": one.campaign,
                    "parameter": f"c_{joint.name.removeprefix('k_')}",
                    "other": f"c_{other.name.removeprefix('k_')}",
                    "covariance": joint.compliance_std**2 if joint is other else 0.0,
                }
                for other in one.stiffness
            ]
    return standing(wear_table.History(campaigns, stiffness, covariance, []))


SOFTER = [2e-7, 2.6e-7, 2e-7]


@pytest.mark.parametrize("hours", [("", ""), ("T08:00:00", "T16:00:00")])
def test_before_and_after_a_repair_of_one_day_are_told_apart(hours):
    """Overview, wear and comparison say the same where a gear was changed between two campaigns."""
    before = campaign("before", [2e-7] * 3, measured=f"2026-11-24{hours[0]}")
    after = campaign("later", SOFTER, measured=f"2026-11-24{hours[1]}")

    page = overview([before, after], told_by([before, after]))
    two = comparison(
        ("before", "later"), before.stiffness, after.stiffness, (np.eye(3) * 1e-18,) * 2
    )

    assert (page.verdict, page.tone) == ("A stiffness has changed", "attention")
    assert "k_1 changed" in " ".join(line.text for line in page.first)
    assert two.verdict == "They differ"


def test_one_day_among_years_is_compared_by_itself():
    """A robot that is followed and steady has nothing to do but for the day that differs."""
    steady = [campaign(f"c{k}", [2e-7] * 3, measured=f"202{k}-05-01") for k in range(4)]
    broken = campaign("d", SOFTER, measured="2023-05-01")
    back = campaign("e", [2e-7] * 3, measured="2024-05-01")
    table = next(
        block
        for section in overview([*steady, broken, back], told_by([*steady, back])).sections
        for block in section.blocks
        if getattr(block, "name", "").startswith("robots-")
    )

    page = overview([*steady, broken, back], told_by([*steady, back]))
    calm = overview([*steady, back], told_by([*steady, back]))

    assert page.verdict == "A stiffness has changed"
    assert "k_1" in table.rows[0][1].text
    assert calm.verdict == "No stiffness has changed"


def test_a_rehearsal_is_no_campaign_of_the_robot():
    """What was simulated beside a robot neither raises an alarm for it nor is its last campaign."""
    first = campaign("first", [2e-7] * 3, measured="2026-01-01")
    second = campaign("second", [2e-7] * 3, measured="2026-02-01")
    rehearsal = campaign("rehearsal", SOFTER, measured="2026-02-01")
    virtual = rehearsal.model_copy(update={"simulated": True})

    kept_apart = overview([first, second, virtual], told_by([first, second]))
    counted = overview([first, second, rehearsal], told_by([first, second]))

    assert kept_apart.verdict == "No stiffness has changed"
    assert "1 of them simulated" in kept_apart.first[0].text
    assert virtual.machine != second.machine
    assert counted.verdict == "A stiffness has changed"


def test_rehearsals_that_differ_are_no_change_of_the_robot():
    """Two of them with another stiffness each; alone they are compared with each other."""
    real = [campaign(f"real{k}", [2e-7] * 3, measured=f"2026-0{k}-01") for k in (1, 2)]
    virtual = [
        campaign(name, size, measured=f"2026-0{k}-01").model_copy(update={"simulated": True})
        for k, (name, size) in enumerate((("one", [2e-7] * 3), ("two", SOFTER)), 1)
    ]

    assert overview([*real, *virtual], told_by(real)).verdict == "No stiffness has changed"
    assert overview(virtual, ()).verdict == "A stiffness has changed"
