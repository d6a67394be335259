"""The exam beside the league: campaigns as they occur, and a judge who must be able to fail."""

import copy
import itertools
import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from world_files import SEED, cell_of, written

from bench.league.hidden_effect import Secret, setup
from bench.league.machine import Spring
from bench.league.play import pull_to, strained
from bench.worlds import run
from bench.worlds.__main__ import chosen
from bench.worlds.cell import READING_S, Manner, build, random_plan
from bench.worlds.files import line, raw
from bench.worlds.judge import Interval, Judged, Spoilt, Truth, forces_doubted, judged, shift
from bench.worlds.noise import SIGMA_M, Bursts, Spells, Student, Turn, Wander, White
from bench.worlds.run import SEEDS, Fixture, Played, asked, contest, fixtures
from bench.worlds.table import lines, spoken
from bench.worlds.visible import Adjustment, from_table
from bench.worlds.worlds import EXAMS, WORLDS
from pipeline.base.errors import InputError, UsageError
from pipeline.machine.robot import load
from pipeline.service.executor import InThisProcess

KR500 = load("kr500_rail")


@pytest.fixture(scope="module")
def clean():
    """A normal campaign: what is true, and the answer."""
    cell, _, _, content = written("normal")
    said = asked(content)
    return Truth(cell.stiffness.tolist(), cell.deflection()), said.answer


@pytest.mark.whole
def test_a_clean_campaign_is_let_go(clean):
    """Springs and test pose lie in their intervals, and nothing is accused."""
    truth, answer = clean

    one = judged(truth, answer)

    assert not one.accused
    assert (one.innocents, one.false_causes) == ((), ())
    assert len(one.springs) >= 6
    assert np.mean([each.covered for each in (*one.springs, *one.deflections)]) > 0.8
    assert max(abs(each.pull) for each in one.deflections) < 4


def accused_of(answer, **cause):
    """The answer with one cause more."""
    wrong = copy.deepcopy(answer)
    wrong["diagnosis"]["causes"].append({"where": None, "rivals": [], **cause})
    return wrong


@pytest.mark.whole
@pytest.mark.parametrize("name", ["rail_roll", "outlier", "unlisted_law"])
def test_a_false_cause_is_counted(clean, name):
    """Whoever accuses a clean campaign is caught, whatever verdict he gives."""
    truth, answer = clean

    one = judged(truth, accused_of(answer, name=name))

    assert one.accused
    assert bool(one.innocents) == (name == "outlier")
    assert bool(one.false_causes) == (name != "outlier")


@pytest.mark.whole
@pytest.mark.parametrize("name", ["heavy_tails", "tracker_wander", "tracker_noise"])
def test_a_name_of_noise_accuses_nobody(clean, name):
    """It counts as the family where that is the right one."""
    truth, answer = clean

    one = judged(replace(truth, family=("heavy_tails",)), accused_of(answer, name=name))

    assert not one.accused
    assert one.family == (name == "heavy_tails")


@pytest.mark.whole
@pytest.mark.parametrize("verdict", ["unexplained", "bad_data", "ambiguous", "explained"])
def test_a_doubt_without_a_name_is_an_accusation(clean, verdict):
    """Only a cause that is right here excuses the verdict that it leads to."""
    truth, answer = clean
    doubting = copy.deepcopy(answer)
    doubting["diagnosis"]["verdict"] = verdict
    excused = replace(truth, allowed=("tracker_drift",))

    assert judged(truth, doubting).accused
    assert judged(excused, doubting).accused
    hiding = replace(truth, secrets=("tracker_drift",))
    for right in (excused, hiding):
        named = judged(right, accused_of(doubting, name="tracker_drift"))
        assert named.accused == (verdict in ("unexplained", "bad_data"))


@pytest.mark.whole
def test_an_interval_beside_the_truth_is_counted(clean):
    """Stiffnesses, deflections and combinations that are elsewhere are not covered."""
    truth, answer = clean
    stiff = [0.1 * k for k in truth.stiffness]
    mixed = {
        **answer,
        "combinations": [
            {"of": ["k_theta2", "k_theta4"], "weights": [1.0, 0.5], "value": value, "std": 1e-9}
            for value in (1 / truth.stiffness[1] + 0.5 / truth.stiffness[3], 1.0)
        ],
    }

    wrong = judged(Truth(stiff, truth.deflection + 1e-3), answer)

    assert not any(one.covered for one in (*wrong.springs, *wrong.deflections))
    assert [one.covered for one in judged(truth, mixed).combinations] == [True, False]


@pytest.mark.whole
def test_a_reading_is_named_in_place_only(clean):
    """The right group and target, or the right line; a neighbour is an innocent."""
    truth, answer = clean
    spoilt = Spoilt("pose03_rep1_loaded/P2", 80, 0.01, 1e-4, ("tracker.csv:80", "tracker.csv:81"))
    truth = replace(truth, spoilt=(spoilt,))

    def said(where, row):
        wrong = accused_of(answer, name="outlier", where=where) if where else dict(answer)
        return judged(truth, {**wrong, "rejected": [{"file": "tracker.csv", "line": row}]})

    assert said(spoilt.name, 80).placed == said(None, 80).placed == (True,)
    assert said(spoilt.name, 80).innocents == said(None, 81).innocents == ()
    assert said("pose03_rep1_loaded/P1-P2", 81).placed == (True,)
    assert said("pose03_rep1_loaded", 81).placed == (False,)
    assert said("pose03_rep2_loaded/P2", 81).placed == (False,)
    assert said("pose03_rep1_loaded/P1", 81).placed == said(None, 81).placed == (False,)
    assert len(said("pose03_rep1_loaded/P1", 82).innocents) == 2


@pytest.mark.whole
def test_what_moves_is_measured_in_standard_uncertainties(clean):
    """A compliance that is two of them off, and one that is no longer there."""
    _, answer = clean
    moved, gone = copy.deepcopy(answer), copy.deepcopy(answer)
    row = moved["stiffness"][3]
    row["compliance"] += 2 * row["compliance_std"]
    gone["stiffness"][3]["compliance"] = None

    assert shift(moved, answer) == pytest.approx((2.0, 0.0))
    assert shift(gone, answer)[0] == np.inf
    assert not forces_doubted(answer, answer)
    assert forces_doubted(accused_of(answer, name="unit_mixup"), answer)
    said = "The stiffnesses are about 9.8 times (8.2 to 12) those of the robot file."
    factor = {**answer, "common_factor": {"value": 9.8}, "findings": [said]}
    assert forces_doubted(factor, answer)
    assert not forces_doubted(factor, factor)
    assert not forces_doubted({**factor, "findings": []}, answer)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", WORLDS)
def test_every_world_writes_a_campaign(name):
    """Each reading has its line, in the order of time, and the table names what was read."""
    cell, clean, record, content = written(name)

    told = tomllib.loads(content["campaign.toml"].decode())
    rows = content["tracker.csv"].decode().splitlines()

    assert len(rows) == 1 + len(cell.slots)
    assert set(told["naming"]["measured"]) < set(told["tool"])
    for k in np.flatnonzero((clean != record).any(axis=1)):
        group, target, *xyz = rows[line(k) - 1].split(",")[:5]
        assert (group, target) == (cell.slots[k].group, cell.slots[k].target)
        np.testing.assert_allclose(np.array(xyz, float), 1e3 * record[k], atol=1e-4)


def test_worlds_share_the_machine_and_not_the_noise():
    """The same seed gives the same cell in every world, so that worlds compare in pairs."""
    one, other = written("normal"), written("student3")

    np.testing.assert_array_equal(one[0].points, other[0].points)
    np.testing.assert_array_equal(one[0].stiffness, other[0].stiffness)
    assert (one[2] != other[2]).any(axis=1).all()
    assert (cell_of("normal", 12).stiffness != one[0].stiffness).all()


def test_the_day_is_one_that_an_operator_has():
    """A reading every 10 to 25 s, a pose in minutes, the base at start, end and in between."""
    slots = cell_of("normal").slots
    gaps = [3600 * (b.hours - a.hours) for a, b in itertools.pairwise(slots) if a.group == b.group]
    every = np.diff([3600 * s.hours for s in slots])
    bases = list(dict.fromkeys(s.group for s in slots if s.state == "base"))

    assert every.min() >= READING_S[0]
    assert max(gaps) <= READING_S[1]
    assert bases[0] == slots[0].group == "base_start"
    assert bases[-1] == slots[-1].group == "base_end"
    assert len(bases) >= 4
    assert 1.5 < slots[-1].hours < 4


@pytest.mark.parametrize(
    ("noise", "kurtosis"), [(White(), 3.0), (Student(5), 9.0), (Bursts(), 13.5)], ids=repr
)
def test_noise_has_the_variance_and_the_tails_of_its_name(noise, kurtosis):
    """Student 5 has the stated variance and a kurtosis of 9, bursts 1.75 of it and 13.5."""
    e = noise(np.zeros(400_000), np.zeros((400_000, 3)), np.random.default_rng(1)) / SIGMA_M

    assert e.var() == pytest.approx(1.75 if isinstance(noise, Bursts) else 1.0, rel=0.03)
    assert np.mean(e**4) / e.var() ** 2 == pytest.approx(kurtosis, rel=0.25)


@pytest.mark.whole
def test_a_noisy_spell_lasts_some_minutes():
    """Of 8 min every 60 min or so, in which successive readings scatter 4.5 times as much."""
    hours = np.arange(200_000) / 60 / 4
    e = Spells()(hours, np.zeros((200_000, 3)), np.random.default_rng(4)) / SIGMA_M
    wide = np.abs(e).max(axis=1) > 5

    share = 1 - np.exp(-8 / 60)
    assert e.var() == pytest.approx(1 + 20 * share, rel=0.1)
    assert wide[1:][wide[:-1]].mean() > 0.6 * wide.mean() / share


def test_student_noise_has_one_scale_per_reading_or_one_per_axis():
    """A reading that is far off in x is far off in y, unless each axis goes by itself."""
    rng = np.random.default_rng(2)
    joint, apart = (
        np.abs(Student(3, each)(np.zeros(50_000), np.zeros((50_000, 3)), rng))
        for each in (False, True)
    )

    assert np.corrcoef(np.log(joint[:, 0]), np.log(joint[:, 1]))[0, 1] > 0.1
    assert abs(np.corrcoef(np.log(apart[:, 0]), np.log(apart[:, 1]))[0, 1]) < 0.02


@pytest.mark.whole
def test_a_wander_forgets_with_its_time():
    """Its covariance between readings t apart is s^2 exp(-t / T), beside white noise."""
    hours = np.arange(200_000) * 0.1
    e = Wander(2, 30)(hours, np.zeros((200_000, 3)), np.random.default_rng(3)) / SIGMA_M

    lags = [np.mean(e[k:] * e[: len(e) - k]) for k in (0, 5, 10)]
    assert lags[0] == pytest.approx(1 + 4, rel=0.05)
    assert lags[1:] == pytest.approx([4 / np.e, 4 / np.e**2], abs=0.15)


def test_a_turn_moves_what_is_far_and_across_the_beam():
    """Twice the range, twice the error; nothing along the beam."""
    hours = np.repeat(np.arange(50_000), 2) * 10.0
    at = np.tile([[4.0, 0.0, 0.0], [0.0, 8.0, 0.0]], (50_000, 1))
    e = Turn(2, 30)(hours, at, np.random.default_rng(3)) / SIGMA_M

    near, far = e[::2].std(axis=0), e[1::2].std(axis=0)
    assert near == pytest.approx([1.0, np.hypot(1, 2 * 4 / 6), np.hypot(1, 2 * 4 / 6)], rel=0.02)
    assert far == pytest.approx([np.hypot(1, 2 * 8 / 6), 1.0, np.hypot(1, 2 * 8 / 6)], rel=0.02)


def test_blunders_are_what_they_are_called():
    """A stale reading is the one before, a failed lock the station itself, a pair two."""
    counts = {}
    for name in ("stale", "failed_lock", "base_off", "chain_off", "pair_one_pose"):
        cell, clean, record, _ = written(name)
        counts[name] = np.flatnonzero((clean != record).any(axis=1))
        where = [cell.slots[k] for k in counts[name]]
        at = counts[name][0]
        if name == "stale":
            np.testing.assert_array_equal(record[at], clean[at - 1])
        elif name == "failed_lock":
            np.testing.assert_array_equal(record[at], np.zeros(3))
        elif name == "pair_one_pose":
            assert len({slot.group.split("_")[0] for slot in where}) == 1
        else:
            assert where[0].state == name.split("_")[0]
            assert 2.9e-4 < np.linalg.norm(record[at] - clean[at]) < 5.1

    assert [len(found) for found in counts.values()] == [1, 1, 1, 1, 2]


def test_the_smallest_visible_blunder_shows_four_times_in_five():
    """At 0.1 % two-sided, in residuals of the machine itself, weights and rod included."""
    rules = Manner(poses=4, steps=(0.5, 1.0))
    cell = build(KR500, random_plan(KR500, rules, 5), rules, 5)
    own, rng = Adjustment(cell), np.random.default_rng(6)
    rows = len(own.range)
    readings = rng.integers(len(cell.slots), size=3000)
    ways = rng.normal(size=(3000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    seen = due = 0
    basis = np.vstack([own.range, own.beforehand])
    for at, way in zip(readings, ways, strict=True):
        size = own.smallest(at, way)
        if size is None or size > 1:
            continue
        error = rng.normal(size=len(basis))
        error[3 * at : 3 * at + 3] += size / SIGMA_M * way
        left = (error - basis @ (basis.T @ error))[:rows]
        w = way @ left[3 * at : 3 * at + 3] / np.sqrt(own.redundancy(at, way))
        seen, due = seen + (abs(w) > 3.2905), due + 1

    assert due > 1500
    assert seen / due == pytest.approx(0.80, abs=0.03)


@pytest.mark.parametrize(
    ("softer", "harder_n", "aside_m"), [(0.01, 0, 0), (0, 1.0, 0), (0, 0, 0.005)]
)
def test_the_adjustment_knows_what_the_machine_does(softer, harder_n, aside_m):
    """Another machine, force and direction move the reflectors as its columns say."""
    rules = Manner(poses=2, steps=(0.5, 1.0))
    cell = build(KR500, random_plan(KR500, rules, 7), rules, 7)
    anchor = cell.plan.anchor[cell.course.pose]
    stiffness = cell.stiffness * (1 + softer * np.linspace(-1, 1, 7))
    one = strained(
        setup(KR500, cell.stiffness), cell.course, cell.tool, pull_to(anchor), cell.scale
    )
    other = strained(
        setup(KR500, stiffness),
        cell.course,
        cell.tool,
        pull_to(anchor + aside_m * np.array([0, 1, 0])),
        cell.scale + harder_n,
    )
    moved = {"unloaded": 0 * one.rest, "loaded": other.loaded - one.loaded}
    moved |= {"chain": other.chain - one.chain}
    change = np.array(
        [np.zeros(3) if s.state == "base" else moved[s.state][s.pull, s.which] for s in cell.slots]
    )

    basis = Adjustment(cell, scale_n=1e6).range
    seen = (change / SIGMA_M).ravel()
    left = seen - basis @ np.linalg.lstsq(basis, seen, rcond=None)[0]

    reflectors = np.abs(moved["loaded"]).max() / SIGMA_M
    assert reflectors > 0.05
    assert np.abs(left).max() < 0.03 * reflectors


def test_the_table_tells_what_shows_in_a_direction():
    """An error along x needs what x needs, one between x and y what both show together."""
    rows = [
        ("tracker", "tracker.csv", 5, axis, v, "mm")
        for axis, v in zip("xyz", (0.3, 0.4, np.inf), strict=True)
    ]
    rows += [
        ("zero", "tracker.csv", 7, "x", 0.1, "mm"),
        ("direction", "tracker.csv", 8, "x", 1, "rad"),
    ]
    names = ["source", "file", "line", "axis", "smallest_visible", "unit"]
    table = pd.DataFrame(rows, columns=names)

    assert from_table(table, 5, np.array([1.0, 0, 0])) == pytest.approx(3e-4)
    assert from_table(table, 5, np.array([0.6, 0.8, 0])) == pytest.approx(1e-3 / np.hypot(2, 2))
    assert [from_table(table, k, np.array([1.0, 0, 0])) for k in (6, 7, 8)] == [None] * 3


@pytest.mark.slow
def test_a_blunder_is_played_beside_its_own_campaign():
    """Named in place or not, the game knows what the blunder moved."""
    one = run.played(Fixture("loaded_off", 0, SEED, cause=False))

    assert one.judged.outcome == one.before.outcome == "answered"
    assert len(one.judged.placed) == len(one.spoilt) == 1
    assert one.moved is not None
    assert one.spoilt[0].visible_m < 1e-3


def test_what_stops_the_pipeline_is_told_apart(monkeypatch):
    """Refused input is one thing, a crash another."""
    content = written("normal")[3]
    assert asked({**content, "loads.csv": b"pose\n"}).outcome == "refused"

    def breaks(*_):
        raise ZeroDivisionError("0/0")

    monkeypatch.setattr(run, "campaign_answer", breaks)
    assert asked(content).outcome == "crashed"


def test_games_that_are_kept_are_not_played_again(tmp_path, monkeypatch):
    """A line that was cut off is; lines of other code stay and do not count."""
    done = []

    def inline(one):
        done.append(one)
        return Played(one.kind, one.seed, Judged("answered"), moved=(np.inf, 0.0))

    monkeypatch.setattr(run, "played", inline)
    log, wanted = tmp_path / "kept.jsonl", fixtures(["normal", "stale"], 2, 3, False, SEEDS)
    first = contest(wanted, log, InThisProcess())
    log.write_text(log.read_text()[:-20])
    again = contest(wanted, log, InThisProcess())
    monkeypatch.setattr(run, "code", lambda: "other")
    contest(wanted[:1], log, InThisProcess())
    codes = iter(["other", "older"])
    monkeypatch.setattr(run, "code", lambda: next(codes))
    with pytest.raises(InputError, match="changed on the way"):
        contest(wanted[1:2], log, InThisProcess())

    assert done == [*wanted, wanted[-1], wanted[0], wanted[1]]
    assert again == first
    assert again[0].moved == (np.inf, 0.0)
    assert len(log.read_text().splitlines()) == 5
    assert [one.seed for one in first] == [one.seed for one in wanted]


def test_every_game_has_a_seed_of_its_own():
    """In one file, as many as it has."""
    seeds = [int(word) for word in SEEDS.read_text().split()]

    assert len(set(seeds)) == len(seeds) >= 1000
    with pytest.raises(InputError, match="seeds"):
        fixtures(["normal"], 1, len(seeds), False, SEEDS)


def test_worlds_are_chosen_by_name_or_exam():
    """A word that is none is answered with those that are."""
    assert chosen("") == list(WORLDS)
    instruments = [world.name for world in WORLDS.values() if world.exam == "instruments"]
    assert chosen("stale,instruments,stale") == ["stale", *instruments]
    with pytest.raises(UsageError, match="student3"):
        chosen("sudent3")


def test_the_table_counts_what_was_judged():
    """Shares with their counts, one table per exam; an interval that misses is missed."""
    hit, miss = Interval("k", 1.0, 1.1, 0.1, 0.9, 1.3), Interval("k", 1.0, 2.0, 0.1, 1.8, None)
    spoilt = (Spoilt("base_end/B1", 9, 0.01, 1e-4), Spoilt("base_end/B2", 10, 1e-5, 1e-4))
    games = [
        Played("normal", 1, Judged("answered", accused=False, springs=(hit, miss))),
        Played("normal", 2, Judged("crashed", "KeyError: k")),
        Played("stale", 1, Judged("answered", placed=(True, False)), spoilt=spoilt),
    ]

    said = "\n".join([*lines(games), *spoken(games)])

    assert "50.0 % (1 of 2" in said
    assert "| stale | 1 | 100.0 % (1 of 1; 2.5 to 100.0) | 0.0 % (0 of 1; 0.0 to 97.5) |" in said
    assert said.count("## ") == 2
    assert set(EXAMS) == {world.exam for world in WORLDS.values()}


def test_raw_files_say_nothing_of_what_hides():
    """A machine with a secret writes down what one without it would."""
    world = WORLDS["weights_floor_cause"]
    robot = load(world.robot)
    plan = world.plan(robot, SEED)
    honest, hiding = (build(robot, plan, world.rules, SEED, s) for s in ((), world.secrets))
    one, other = (raw(cell, cell.local, world.stated, (), 1.0, True) for cell in (honest, hiding))

    same = [name for name in one if one[name] == other[name]]
    assert same == ["campaign.toml", "loads.csv", "joints.csv"]


def remembering(joint, part, minutes):
    """A joint that is softer after its loads by up to a part, and forgets them."""

    def plant(one, size, course):
        keeps = np.exp(-60 * np.diff(course.time) / minutes)

        def law(own, _):
            now, held = 0.0, np.zeros(len(own))
            share = np.abs(own) / max(np.abs(own).max(), 1e-300)
            for i, keep in enumerate(keeps):
                held[i + 1] = now = keep * now + (1 - keep) * share[i]
            return size * one.compliance[joint - 1] * own * held

        one.machine.springs.append(Spring(f"past{joint}", joint, (0, 0, 1), False, law))

    return Secret("memory", f"joint {joint}", False, plant), part


@pytest.mark.slow
def test_a_joint_that_remembers_its_loads_is_none_of_the_catalogue():
    """Friction of that joint fits best, but predicts no better: no known cause is accepted."""
    world = WORLDS["memory"]
    plan = world.plan(KR500, SEED)
    cell = build(KR500, plan, world.rules, SEED, (remembering(2, 0.15, 10.0),))
    record = run._recorded(cell, world, SEED)[0]

    said = asked(run._files(cell, world, record, 1.0)).answer["diagnosis"]

    assert said["verdict"] == "unexplained"
    assert said["causes"] == []
    assert "no known cause explains it" in said["why"]
