"""Unlisted laws: built from place, variable and shape; found only if present in the data."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from bench.league.hidden import SECRETS
from bench.league.judge import SCATTER, score
from bench.league.machine import Machine, Spring
from bench.league.play import Rules, drawn, play
from bench.league.run import answer_of
from pipeline.answer.diagnosis import diagnosis_of_good_data
from pipeline.diagnosis import unlisted as search
from pipeline.diagnosis.cause_search import Replacement, may_join, merged, statistics_given
from pipeline.diagnosis.causes import _either
from pipeline.diagnosis.diagnose import diagnose
from pipeline.diagnosis.isolability import rich_pulls, rich_tool, twins
from pipeline.library.model_file import dumps
from pipeline.machine.cell import load, paper_cell, sensitivity
from pipeline.machine.effects import catalogue, unlisted
from pipeline.machine.law import Law, parse
from pipeline.machine.robot import load as robot_of
from pipeline.prediction.model import IdentifiedModel, part
from pipeline.prediction.model import parse as parse_model
from pipeline.reduction.bring import bring, conformed, plain
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.detect import threshold
from pipeline.system.estimate import identify
from pipeline.system.evidence import Scores
from pipeline.system.score_tests import by_products

KR500 = robot_of("kr500_rail")
RNG = np.random.default_rng(36)
CELL = paper_cell(KR500, rich_tool(RNG))
PULLS = rich_pulls(KR500, RNG, 40)
Q, S, HOURS = PULLS.q, PULLS.q[:, 0], PULLS.time / 3600
SINCE = (PULLS.time - PULLS.time_zero) / 3600
ENDS = (-10.0, 10.0)


def law(where, part, kind, variable, source=0, order=1.0, ends=ENDS, at=0.0):
    """A law valid between some limits."""
    return Law(where, part, kind, variable, source, order, *ends, at)


def turning(joint, amount, axis=(0, 0, 1), slides=False, fixed=False):
    """One spring of the league's machine: own force, those of all others -> deflection."""
    return [Spring(f"j{joint}", joint, axis, slides, amount, fixed=fixed)]


CASES = {
    "ripple": (
        law(3, "spring", "periodic", "angle", 3, 7.0),
        1,
        turning(3, lambda own, _: own * np.sin(7 * Q[:, 2])),
    ),
    "ripple with its second harmonic": (
        replace(
            law(3, "spring", "periodic", "angle", 3, 7.0),
            more=law(3, "spring", "periodic", "angle", 3, 14.0),
        ),
        3,
        turning(3, lambda own, _: own * np.sin(14 * Q[:, 2])),
    ),
    "softer one way and stiffer under load": (
        replace(
            law(2, "spring", "smooth", "torque", 2, 1.0, (-2000.0, 3000.0)),
            more=law(2, "spring", "smooth", "torque", 2, 3.0, (-2000.0, 3000.0)),
        ),
        1,
        turning(2, lambda own, _: own * (own / 3000.0) ** 2),
    ),
    "roll along the rail that also jumps": (
        replace(
            law("rail", "roll", "smooth", "position", 1, 1.0),
            more=law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
        ),
        2,
        turning(1, lambda own, _: own * (S > 6.0), (0, 1, 0), fixed=True),
    ),
    "by another joint": (
        law(4, "spring", "coupling", "angle", 6, 2.0),
        0,
        turning(4, lambda own, _: own * np.cos(2 * Q[:, 5])),
    ),
    "step on the rail": (
        law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
        0,
        turning(1, lambda own, _: own * (S > 6.0), (0, 1, 0), fixed=True),
    ),
    "drive by the metre": (
        law("rail", "drive", "periodic", "position", 1, 0.25),
        0,
        turning(1, lambda own, _: own * np.cos(2 * np.pi * S / 4), slides=True),
    ),
    "rollers": (
        law("rail", "vertical", "smooth", "force", 0, 2 / 3),
        0,
        turning(
            1,
            lambda own, _: 10 * np.sign(own) * np.abs(own) ** (2 / 3),
            (0, 0, 1),
            slides=True,
            fixed=True,
        ),
    ),
    "warms": (
        law(5, "spring", "smooth", "time", 0, 2.0, (0.0, 2e4)),
        0,
        turning(5, lambda own, _: own * (HOURS * 3600 / 2e4) ** 2),
    ),
    "knees": (
        law(2, "knees", "smooth", "torque", 2, 2.0, (-4000.0, 3000.0), 1000.0),
        1,
        turning(2, lambda own, _: np.sign(own) * np.maximum(np.abs(own) - 2500.0, 0)),
    ),
    "creeps": (
        law(6, "creep", "smooth", "time"),
        0,
        turning(6, lambda own, _: own * SINCE),
    ),
    "grows": (
        law(3, "grows", "smooth", "time"),
        0,
        turning(3, lambda own, _: SINCE, (1, 0, 0), slides=True),
    ),
    "bearing": (
        law(4, "bearing_z", "smooth", "force"),
        0,
        turning(4, lambda own, _: own, slides=True),
    ),
    "tips": (
        law(5, "tips", "step", "torque", 5, 0.0, at=60.0),
        1,
        turning(5, lambda own, _: np.tanh(own / 60.0), (0, 1, 0)),
    ),
    "pair": (
        law(3, "pair", "coupling", "torque", 5),
        0,
        [
            *turning(3, lambda _, every: every["j5"]),
            *turning(5, lambda _, every: every["j3"]),
        ],
    ),
}


def with_and_without(springs, eps):
    """A machine with compliant springs, and the same with rigid ones."""

    def yielding(one, much):
        return replace(one, law=lambda own, every: much * one.law(own, every))

    return [Machine(KR500, [yielding(one, much) for one in springs]) for much in (eps, 0.0)]


@pytest.mark.parametrize("name", CASES)
def test_a_law_moves_the_reflectors_as_a_machine_that_has_it(name):
    """Columns equal the effect of springs of another machine (4 x 4 matrices) per amplitude."""
    one, column, springs = CASES[name]
    eps = 1e-9
    machine, bare = with_and_without(springs, eps)
    tool = CELL.tool
    moved, still = (
        m.settle(Q, tool.points, tool.load_point, PULLS.force)[0] for m in (machine, bare)
    )

    made = sensitivity(CELL, PULLS, np.zeros(7), [unlisted.effect(KR500, one)])[..., column]

    assert np.abs(made).max() > 0
    np.testing.assert_allclose(
        (moved - still) / eps, made, atol=2e-3 * np.abs(made).max() + 1e-3 * np.abs(made).mean()
    )


def test_the_scale_reads_another_force_by_the_law():
    """The relative force error scales the displacements, according to the law for that pull."""
    x = KR500.nominal_compliance
    one = unlisted.effect(KR500, law("scale", "reading", "smooth", "time", 0, 1.0, (0.0, 2e4)))
    moved = sensitivity(CELL, PULLS, x, CELL.effects) @ x

    made = sensitivity(CELL, PULLS, x, [one])[..., 0]

    np.testing.assert_allclose(made, moved * (PULLS.time / 2e4)[:, None, None], rtol=1e-6)


def test_a_zero_of_the_scale_that_jumps_adds_the_same_force_to_every_later_pull():
    """One newton along the chain adds displacement over force, whatever the pull."""
    x, at = KR500.nominal_compliance, float(np.median(PULLS.time))
    where = law("scale", "zero", "step", "time", 0, 0.0, (0.0, 2e4), at)
    one = unlisted.effect(KR500, where)
    per_newton = sensitivity(CELL, PULLS, x, CELL.effects) @ x
    per_newton = per_newton / np.linalg.norm(PULLS.force, axis=1)[:, None, None]

    made = sensitivity(CELL, PULLS, x, [one])[..., 0]

    newtons = np.sum(made * per_newton, axis=(1, 2)) / np.sum(per_newton**2, axis=(1, 2))
    np.testing.assert_allclose(made, newtons[:, None, None] * per_newton, atol=1e-15)
    before, after = newtons[PULLS.time < at], newtons[PULLS.time > at]
    assert np.ptp(before) == pytest.approx(0, abs=1e-9)
    assert after - before.mean() == pytest.approx(1)
    assert one.called.startswith("zero that jumps at ")
    assert one.parameters[0].unit == "N"


def test_a_dead_band_adds_the_same_force_to_every_small_pull():
    """Pulls up to a limit lose the same force; larger ones lose none."""
    sticks = unlisted.effect(KR500, law("scale", "zero", "step", "force", 0, 1.0, at=1500.0))
    loaded = load(CELL, PULLS, KR500.nominal_compliance)
    size = np.linalg.norm(PULLS.force, axis=1)

    point, force = sticks.wrench(loaded, np.array([-40.0]))

    lost = np.where(size <= 1500.0, 40.0, 0.0)
    assert np.linalg.norm(force, axis=1) == pytest.approx(size - lost)
    assert 0 < lost.sum() < 40.0 * len(size)
    np.testing.assert_array_equal(point, loaded.load_point)


def test_a_jump_is_sought_between_all_pulls_and_not_the_first_of_each_pose():
    """For laws of the force, steps are between any two different pulls."""
    laws = unlisted.effects(KR500, load(CELL, PULLS, KR500.nominal_compliance))
    at = [one.law.at for one in laws if one.law.of[:3] == ("scale", "zero", "force")]
    size = np.sort(np.linalg.norm(PULLS.force, axis=1))
    assert len(at) == min(len(size) - 5, 60)
    assert size[2] < min(at) < size[3]
    assert size[-4] < max(at) < size[-3]


def test_a_jump_is_never_sought_between_pulls_of_the_same_force():
    """Three load steps in all directions; equal forces may differ by a rounding, and are equal."""
    size = np.repeat([1000.0, 2000.0, 3000.0], [12, 12, 16])[:, None]
    along = PULLS.force / np.linalg.norm(PULLS.force, axis=1, keepdims=True)
    pulls = replace(PULLS, force=size * along)
    assert len(np.unique(np.linalg.norm(pulls.force, axis=1))) > 3

    laws = unlisted.effects(KR500, load(CELL, pulls, KR500.nominal_compliance))
    at = [one.law.at for one in laws if one.law.of[:3] == ("scale", "zero", "force")]

    assert at == pytest.approx([1500.0, 2500.0], abs=1e-9)


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


def test_every_law_has_a_share_of_the_odds_and_a_form_that_a_file_can_hold():
    """Probabilities of all laws sum to one; label and form reproduce each law."""
    every = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    forms = {(one.label, one.form) for one in every}

    assert sum(one.odds for one in every) == pytest.approx(1.0)
    assert len(forms) == len(every) > 500
    assert all(parse(str(one.law.where), one.form) == one.law for one in every)
    assert unlisted.named(KR500, "joint_tilt:3", "") is None
    assert unlisted.named(KR500, "unlisted_law:3", "spring wavy angle 3 1 0 1 0 False") is None


def test_a_law_calls_joints_as_the_controller_calls_its_axes():
    """The place, and the joint whose angle or torque it depends on; the rail moves alone."""
    every = [
        law(4, "spring", "coupling", "angle", 6, 2.0),
        law(3, "pair", "coupling", "torque", 5),
        law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
    ]

    assert [unlisted.effect(KR500, one).called for one in every] == [
        "stiffness that follows the angle of joint 6 (A5), 2 per turn in joint 4 (A3)",
        "compliance shared with joint 5 (A4) in joint 3 (A2)",
        "roll of the carriage that jumps at 6.0 m of the rail at the rail",
    ]
    made = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    axes = {unlisted.worded(KR500, one).axis for one in made}
    assert axes == {None, "A1", "A2", "A3", "A4", "A5", "A6"}


def test_what_a_law_lacks_is_tried_in_its_own_place_and_variable():
    """Each further shape once, with the probability of the law, half of it for harmonics."""
    loaded = load(CELL, PULLS, np.zeros(7))
    wave = replace(unlisted.effect(KR500, law(5, "spring", "periodic", "angle", 5, 3.0)), odds=0.2)
    other = unlisted.effect(KR500, law(2, "pair", "coupling", "torque", 5))

    further = unlisted.extensions(KR500, loaded, wave)

    orders = [one.law.more.order for one in further if one.law.more.kind == "periodic"]
    harmonics = [one for one in further if one.law.more.order in (6, 9, 12, 15, 18)]
    assert sorted(orders) == [k for k in range(1, 21) if k != 3]
    assert {one.law.more.kind for one in further} == {"periodic", "smooth", "step"}
    assert {one.label for one in further} == {wave.label}
    assert all(one.law.more.of == wave.law.of and one.law.extends(wave.law) for one in further)
    assert not any(wave.law.extends(one.law) for one in further)
    assert sum(one.odds for one in further) == pytest.approx(0.2)
    assert sum(one.odds for one in harmonics) == pytest.approx(0.1)
    assert all(unlisted.named(KR500, one.label, one.form).law == one.law for one in further)
    assert unlisted.extensions(KR500, loaded, other) == ()


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
    for _ in range(200):
        own = rng.standard_normal((POSES, ROWS // POSES)) * rng.lognormal(0, 1, (POSES, 1))
        made, now = view(own.ravel())
        hits += search._by_structure(made, now, rng).min() < 0.1

    assert hits <= stats.binom.ppf(0.999, 200, 0.1)


def test_a_law_over_all_poses_is_one():
    """Copies reach a law that fills the residuals only if all their signs are equal."""
    view = many(3)
    first = view(np.zeros(ROWS))[0].A[:, BASE]
    made, now = view(first + 0.05 * np.random.default_rng(5).standard_normal(ROWS))

    p = search._by_structure(made, now, np.random.default_rng(6))
    assert int(np.argmin(p)) == 0
    reached = round(p[0] * (1 + search._FLIPS)) - 1
    alike = 2.0 ** (1 - len(np.unique(PULLS.pose)))
    assert reached <= stats.binom.ppf(0.999, search._FLIPS, alike)


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


def test_a_law_that_nobody_listed_is_found():
    """A machine whose second gear ripples with its teeth, diagnosed alone."""
    case = ingested(in_memory(hiding(36, tooth_stiffness=1.0).files), conformed, plain)
    data = bring(case).data
    _, estimate = identify(case.cell, data, KR500.nominal_compliance)
    where = place_of_interest(None, KR500, data.pulls)

    found = diagnose(case.cell, data, estimate, where, np.random.default_rng(0))

    rippled(json.loads(diagnosis_of_good_data(found, KR500).model_dump_json()))


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


def test_what_is_not_decided_of_a_law_is_said():
    """Orders in one phrase, another kind as another law, and nothing twice."""
    wave = law(5, "spring", "periodic", "angle", 5, 2.0)
    six, steady = replace(wave, order=6.0), law(5, "spring", "smooth", "time")
    both = [replace(wave, order=3.0, more=one) for one in (wave, replace(wave, order=9.0))]

    def said(one, *others):
        return unlisted.undecided(KR500, unlisted.effect(KR500, one), others).noun

    assert said(wave, six) == "stiffness that varies 2 or 6 times per turn"
    assert said(both[0], both[1]) == (
        "stiffness that varies 3 times per turn and varies 2 or 9 times per turn"
    )
    assert said(wave, steady, six) == (
        "stiffness that varies 2 or 6 times per turn, or stiffness that changes with time"
    )
    assert said(steady, replace(steady, order=2.0)) == "stiffness that changes with time"
    assert said(six) == unlisted.effect(KR500, six).noun


@pytest.mark.parametrize(("shares", "told"), [((0.6, 0.39), 2), ((0.97, 0.03), 0)])
def test_laws_are_undecided_where_none_leads_by_twenty_to_one(shares, told):
    """By the evidence of each, as a further cause must lead to be named."""
    waves = [law(5, "spring", "periodic", "angle", 5, order) for order in (2.0, 6.0)]
    suspects = tuple(unlisted.effect(KR500, one) for one in waves)
    rival = Replacement("unlisted_law:5", 0, 1.0, tuple(enumerate(shares)))
    case = SimpleNamespace(suspects=suspects)
    found = SimpleNamespace(accepted=(0,), rivals=((rival,),))

    assert len(_either(case, found, 0)) == told


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

    told, again = (m.predict(q, force) for m in (model, parse_model(dumps(model))))

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
