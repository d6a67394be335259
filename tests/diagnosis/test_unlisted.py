"""Unlisted laws: built from place, variable and shape; found only if present in the data."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from small_case import asked, small
from unlisted_laws import CELL, KR500, PULLS, RNG, law, turning, with_and_without

from bench.league.hidden import SECRETS
from bench.league.judge import SCATTER, score
from bench.league.play import Rules, drawn, play
from bench.league.run import answer_of
from pipeline.answer.diagnosis import diagnosis_of_good_data
from pipeline.diagnosis import unlisted as search
from pipeline.diagnosis.cause_search import Replacement, may_join, merged, statistics_given
from pipeline.diagnosis.cause_search import search as find
from pipeline.diagnosis.causes import _either
from pipeline.diagnosis.diagnose import diagnose, search_task
from pipeline.diagnosis.isolability import twins
from pipeline.library.model_file import dumps, parse
from pipeline.machine.cell import load
from pipeline.machine.effects import catalogue, unlisted
from pipeline.prediction.model import IdentifiedModel, part
from pipeline.reduction.bring import bring
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.detect import threshold
from pipeline.system.estimate import identify
from pipeline.system.evidence import Scores
from pipeline.system.score_tests import by_products


@pytest.mark.whole
@pytest.mark.parametrize("lost_n", [150.0])
def test_a_scale_with_a_dead_band_is_named_and_leaves_the_springs_alone(lost_n):
    """Written into the log: pulls below 1800 N read 150 N too little."""
    plan = Plan(
        name="sticks",
        seed=8,
        poses={"count": 12},
        pulls={"steps_n": [900.0, 1600.0, 2400.0, 3200.0]},
    )
    files = dict(simulate(plan).files)
    clean = campaign_answer("clean", in_memory(dict(files))).answer
    head, *rows = [row.split(",") for row in files["loads.csv"].decode().splitlines()]
    at = head.index("force_n")
    for row in rows:
        force = float(row[at])
        row[at] = f"{force - lost_n * (force < 1800.0):.2f}"
    files["loads.csv"] = ("\n".join(",".join(row) for row in [head, *rows]) + "\n").encode()

    said = campaign_answer("sticks", in_memory(files)).answer

    assert str(said.diagnosis.verdict) == "explained"
    (cause,) = [one for one in said.diagnosis.causes if one.probability > 0.9]
    assert (cause.name, cause.where, cause.form) == ("unlisted_law", "scale", "step")
    for one, true in zip(said.stiffness, clean.stiffness, strict=True):
        if one.value and true.value:
            assert abs(one.value - true.value) < 3 * np.hypot(one.std, true.std)


def test_a_law_joins_in_the_place_of_the_one_that_it_extends():
    """Other laws of a joint exclude each other, and a prior is not paid twice."""
    one = replace(unlisted.effect(KR500, law(5, "spring", "periodic", "angle", 5, 3.0)), odds=0.01)
    wider = next(iter(unlisted.extensions(KR500, load(CELL, PULLS, np.zeros(7)), one)))
    rival = unlisted.effect(KR500, law(5, "creep", "smooth", "time"))
    roll = next(e for e in catalogue(KR500) if e.label == "rail_roll")
    these = (one, wider, rival, roll)
    none = np.zeros((4, 1))
    now = Scores(none[..., None], none, none, 1.0, 1)

    assert [may_join(these, [0], k) for k in range(4)] == [False, True, False, True]
    assert not may_join(these, [1], 0)
    assert merged(these, (3, 0, 1)) == (3, 1)
    np.testing.assert_allclose(statistics_given(these, now, [0]).log_odds, [0, -np.log(0.01), 0, 0])
    assert statistics_given(these, now, [3]) is now


ROWS, BASE, POSES = 48, 4, 12


def many(seed, suspects=40):
    """A base and suspects of two columns, more than rows, and the tests of each for rows y."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((ROWS, BASE + 2 * suspects))

    def view(y):
        A = np.column_stack([X, y])
        at = BASE + np.arange(2 * suspects).reshape(-1, 2)
        pose = np.repeat(np.arange(POSES), ROWS // POSES)
        made = SimpleNamespace(A=A, M=A.T @ A, first=BASE, owner=np.repeat(np.arange(suspects), 2))
        vars(made).update(
            suspects=[None] * suspects, base=np.arange(BASE), at=at, pose=pose, poses=POSES
        )
        return made, by_products(made.M, made.base, at, ROWS - BASE)

    return view


@pytest.mark.whole
def test_the_largest_of_more_columns_than_rows_is_drawn_as_rarely_as_stated():
    """Of clean draws 2 % are below 1 - (1 - 0.02)^(1/m) for the m tests."""
    view = many(1)
    limit = threshold(view(np.zeros(ROWS))[0], np.arange(BASE), ROWS - BASE, RNG, 8000)
    each = -np.expm1(np.log1p(-0.02) / limit.independent)
    rng = np.random.default_rng(2)
    least = [view(rng.standard_normal(ROWS))[1].p().min() for _ in range(3000)]

    assert np.mean(np.array(least) < each) == pytest.approx(0.02, abs=3 * np.sqrt(0.02 / 3000))


def test_structure_within_poses_is_no_law():
    """Effects specific to each pose are called a law no more often than stated."""
    view, rng, hits = many(3), np.random.default_rng(4), 0
    for _ in range(80):
        own = rng.standard_normal((POSES, ROWS // POSES)) * rng.lognormal(0, 1, (POSES, 1))
        made, now = view(own.ravel())
        hits += search._by_structure(made, now).min() < 0.1

    assert hits <= stats.binom.ppf(0.999, 80, 0.1)


def test_a_law_over_all_poses_is_one():
    """Copies reach a law that fills the residuals only if all their signs are equal."""
    view = many(3)
    first = view(np.zeros(ROWS))[0].A[:, BASE]
    made, now = view(first + 0.05 * np.random.default_rng(5).standard_normal(ROWS))

    p = search._by_structure(made, now)
    assert int(np.argmin(p)) == 0
    reached = round(p[0] * (1 + search._FLIPS)) - 1
    alike = 2.0 ** (1 - len(np.unique(PULLS.pose)))
    assert reached <= stats.binom.ppf(0.999, search._FLIPS, alike)


@pytest.fixture(scope="module")
def clean():
    """A search in a campaign in which nothing is hidden."""
    at = asked(small())
    task, _ = search_task(at.cell, at.reduced.data, at.estimate)
    return task, find(task, at.estimate.value, np.random.default_rng(1)), at.estimate.value


@pytest.mark.parametrize(("law", "open_"), [(1e-3, False), (1e-5, True)])
@pytest.mark.parametrize("certain", [True, False])
def test_what_stands_out_of_the_scatter_is_no_fit(clean, monkeypatch, law, open_, certain):
    """Nor where the law of it is certain and predicts left-out poses no better."""
    roll = next(e for e in catalogue(KR500) if e.label == "rail_roll")
    laws = {roll: law} if certain else {}
    monkeypatch.setattr(search, "_likely", lambda *_: (laws, law))
    monkeypatch.setattr(search, "_searched", lambda task, found, *_: (task, found))
    task, found, start = clean
    assert not found.detected

    _, end = search.with_unlisted_laws(task, found, start)

    assert end.detected == end.structured == open_
    assert end.clean != open_


def hiding(seed, **sizes):
    """A campaign of the league's machine with hidden effects."""
    rng = np.random.default_rng(seed)
    plan = drawn(KR500, rng, Rules())
    return play(KR500, plan, [(SECRETS[name], size) for name, size in sizes.items()], rng, Rules())


def measured(seed, **sizes):
    """Such a campaign, and the answer of the pipeline."""
    game = hiding(seed, **sizes)
    return game, answer_of(game.files)


def named(answer):
    """Names of the causes, except those of scatter."""
    return [c["name"] for c in answer["diagnosis"]["causes"] if c["name"] not in SCATTER]


def rippled(answer):
    """Check place, kind, order and amplitude of a stiffness that ripples six times per turn."""
    (cause,) = (c for c in answer["causes"] if c["name"] == "unlisted_law")
    size = cause["parameters"][0]

    assert answer["verdict"] == "explained"
    assert (cause["where"], cause["law"]["kind"], cause["law"]["variable"]) == (
        2,
        "periodic",
        "angle",
    )
    assert cause["law"]["order"] == 6
    assert size["ci95"][0] < 0.2 / 3.8e6 < size["ci95"][1]
    assert cause["gain"]["ci95"][0] > 0.5
    assert cause["p_value"] < 1e-3


@pytest.mark.whole
def test_a_law_that_nobody_listed_is_found():
    """A machine whose second gear ripples with its teeth, diagnosed alone."""
    case = ingested(in_memory(hiding(36, tooth_stiffness=1.0).files))
    data = bring(case).data
    _, estimate = identify(case.cell, data, KR500.nominal_compliance)
    where = place_of_interest(None, KR500, data.pulls)

    found = diagnose(case.cell, data, estimate, where, np.random.default_rng(0))

    rippled(json.loads(diagnosis_of_good_data(found, KR500).model_dump_json()))


@pytest.mark.whole
def test_a_scale_that_lost_a_third_by_the_end_is_named_however_much_that_is():
    """Written into the log: the last row reads a third more than was pulled, the first is right."""
    files = dict(simulate(Plan(name="drifts", seed=5, poses={"count": 12})).files)
    head, *rows = [row.split(",") for row in files["loads.csv"].decode().splitlines()]
    at = head.index("force_n")
    for k, row in enumerate(rows):
        row[at] = f"{float(row[at]) * (1 + k / (len(rows) - 1) / 3):.2f}"
    files["loads.csv"] = ("\n".join(",".join(row) for row in [head, *rows]) + "\n").encode()

    said = campaign_answer("drifts", in_memory(files)).answer

    (cause,) = [one for one in said.diagnosis.causes if one.name == "unlisted_law"]
    assert (cause.where, cause.law.variable, cause.law.order) == ("scale", "time", 1)
    assert cause.parameters[0].value == pytest.approx(1 / 7, rel=0.05)  # half of 1 to 3/4, of 7/8


@pytest.mark.slow
def test_a_law_that_nobody_listed_is_in_the_answer():
    """For the same machine, and the judge agrees."""
    game, answer = measured(36, tooth_stiffness=1.0)
    said = score(game.truth, answer, twins(KR500)).law

    rippled(answer["diagnosis"])
    assert said.place
    assert said.order
    assert said.halved


@pytest.mark.slow
def test_waves_that_the_poses_do_not_tell_apart_are_all_stated():
    """At angles 45° apart, 2, 6, 10, 14 and 18 waves per turn are equal; six is true."""
    rng = np.random.default_rng(36)
    plan = drawn(KR500, rng, Rules())
    q, step = plan.q.copy(), np.pi / 4
    q[:, 1] = np.round((q[:, 1] - 0.2) / step) * step + 0.2
    plan = replace(plan, q=q)
    files = play(KR500, plan, [(SECRETS["tooth_stiffness"], 1.0)], rng, Rules()).files
    causes = answer_of(files)["diagnosis"]["causes"]
    (law_,) = (c["law"] for c in causes if c["name"] == "unlisted_law")
    orders = {one["shapes"][-1]["order"]: one["probability"] for one in law_["either"]}

    assert set(orders) == {2, 6, 10, 14, 18}
    assert sum(orders.values()) == pytest.approx(1, abs=0.05)
    assert max(orders.values()) < 2 * min(orders.values())
    assert " or " in law_["text"]


@pytest.mark.parametrize(("shares", "told"), [((0.6, 0.39), 2), ((0.97, 0.03), 0)])
def test_laws_are_undecided_where_none_leads_by_twenty_to_one(shares, told):
    """By the evidence of each, as a further cause must lead to be named."""
    waves = [law(5, "spring", "periodic", "angle", 5, order) for order in (2.0, 6.0)]
    suspects = tuple(unlisted.effect(KR500, one) for one in waves)
    rival = Replacement("unlisted_law:5", 0, 1.0, tuple(enumerate(shares)))
    case = SimpleNamespace(suspects=suspects)
    found = SimpleNamespace(accepted=(0,), rivals=((rival,),))

    assert len(_either(case, found, 0)) == told


def test_structure_tells_of_a_place_that_it_follows_a_law_not_which():
    """A slip in four poses is as structured as its copies with other signs; creep there is not."""
    laws = [
        SimpleNamespace(label=label)
        for label in ("unlisted_law:5", "unlisted_law:3", "unlisted_law:5", "unlisted_law:scale")
    ]

    least = search._least_of_place(laws, np.array([3e-4, 0.2, 0.125, 0.5]))

    assert least.tolist() == [3e-4, 0.2, 3e-4, 0.5]


@pytest.mark.slow
def test_what_a_law_lacks_is_no_listed_cause():
    """An eccentric wheel, |sin| of the angle, is a law of its joint, without other causes."""
    for seed in range(40, 44):
        _, answer = measured(seed, eccentric_wheel=2.4)
        diagnosis = answer["diagnosis"]

        assert {(c["name"], c["where"]) for c in diagnosis["causes"] if c["gain"]} <= {
            ("unlisted_law", 5)
        }, seed


@pytest.mark.slow
def test_a_law_of_which_a_listed_cause_takes_a_part_is_found():
    """A growing link resembles a drifting tracker, which explains the larger part of it."""
    for seed in range(50, 54):
        _, answer = measured(seed, link_grows=2.0)
        causes = [c for c in answer["diagnosis"]["causes"] if c["name"] not in SCATTER]

        assert [(c["name"], c["where"]) for c in causes] == [("unlisted_law", 3)], seed
        assert causes[0]["law"]["variable"] == "time", seed


@pytest.mark.slow
def test_in_a_clean_campaign_no_law_is_found():
    """Laws are also sought if nothing was detected, and none is found."""
    _, answer = measured(37)

    assert answer["diagnosis"]["verdict"] == "adequate"
    assert not named(answer)


@pytest.mark.slow
def test_a_listed_cause_keeps_its_name():
    """What the catalogue explains is no unlisted law; test_one_answer has another case."""
    _, answer = measured(38, rail_roll=3.0)

    assert named(answer) == ["rail_roll"]


def test_outside_of_where_it_was_taught_a_law_is_as_uncertain_as_it_is_large():
    """Within the data the uncertainty is that of its amplitudes; beyond, its height is added."""
    one = unlisted.effect(KR500, law(2, "spring", "periodic", "angle", 2, 3.0, (-1.2, 1.2)))
    value = np.append(KR500.nominal_compliance, [3e-8, 4e-8])
    cov = np.diag(np.append(np.zeros(7), [1e-20, 1e-20]))
    found = SimpleNamespace(value=value, cov=cov)
    model = IdentifiedModel("c", "explained", {}, (part(1.0, CELL.with_effects(one), found),))
    q = np.tile([9.0, 0.5, -0.4, 0.6, 0.3, 0.9, 0.2], (2, 1))
    q[1, 1] = 1.5
    force = np.array([[300.0, 1000.0, 0.0]] * 2)
    machines = with_and_without(turning(2, lambda own, _: own), 5e-8)
    at = CELL.tool.load_point
    moved, still = (m.settle(q, at[None], at, force)[0] for m in machines)
    height = np.abs(moved - still)[:, 0]

    told, again = (m.predict(q, force) for m in (model, parse(dumps(model))))

    assert (told.std[0] < 0.01 * height[0].max()).all()
    np.testing.assert_allclose(told.std[1], height[1], rtol=0.02, atol=1e-7)
    np.testing.assert_array_equal(again.cov, told.cov)
    assert model.hypotheses[0].beside_springs == (one,)


@pytest.mark.parametrize(("poses", "copies"), [(1, 0), (4, 7), (12, 2047), (13, 3000), (40, 3000)])
def test_copies_of_few_poses_are_all_different_and_none_is_the_campaign(poses, copies):
    """Up to a common sign, which changes no square: no draw alone rejects a law of 12 poses."""
    signs = search._signs(poses, np.random.default_rng(5))
    alike = {tuple(row) for row in (signs * signs[:, :1]).tolist()}

    assert signs.shape == (copies, poses)
    assert len(alike) == copies
    assert (1.0,) * poses not in alike
