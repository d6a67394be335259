"""Stage diagnose on simulated campaigns through the raw files, without access to the truth."""

import json

import numpy as np
import pytest

from bench.league.hidden import SECRETS
from bench.league.play import Rules, drawn, play
from pipeline import tables
from pipeline.annex import promises
from pipeline.annex.diagnosis_tables import apart_table, clues_table, examined_table
from pipeline.answer.diagnosis import diagnosis_of_good_data
from pipeline.answer.stiffness import stiffness_entries
from pipeline.diagnosis.average import dependences
from pipeline.diagnosis.diagnose import diagnose
from pipeline.diagnosis.facts import Drift
from pipeline.diagnosis.verdict import verdict
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import load
from pipeline.reduction.displacements import displacements
from pipeline.reduction.forces import forces
from pipeline.reduction.ingest import ingest
from pipeline.reduction.measured import measured
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.reduction.register import place, register
from pipeline.reduction.settings import parse
from pipeline.run import campaign_answer
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify

KR500 = load("kr500_rail")


def frame(table):
    """A table as pandas has it."""
    return table.to_pandas() if hasattr(table, "to_pandas") else table


def reduced(files):
    """Cell and measurements from the raw files of a campaign."""
    settings = parse(files["campaign.toml"].decode())
    got = ingest(settings, KR500, files)
    readings = frame(got.readings)
    registration = register(settings, readings)
    placed = frame(place(registration, readings))
    points = np.array([settings.tool[name] for name in settings.measured])
    tool = Tool(
        np.array(settings.tool["load_point"]), np.array(settings.measured, dtype=object), points
    )
    data = measured(
        settings,
        KR500,
        registration,
        frame(got.joints),
        frame(forces(settings, placed, frame(got.loads))),
        frame(displacements(settings, placed)),
    )
    return paper_cell(KR500, tool), data


def examined(seed, *effects, noise_scale=1.0, poses=16, stiffness=None):
    """Diagnosis of a campaign with hidden effects."""
    plan = Plan(
        poses={"count": poses},
        pulls={"steps_n": [1000, 2000, 3000, 1500]},
        tracker={"noise_scale": noise_scale},
        hidden={
            "effects": list(effects),
            "stiffness": stiffness,
            "stiffness_spread": 0.0 if stiffness else 0.25,
            "tool_sd_m": 2e-4,
            "equilibrium": "deformed",
        },
    )
    cell, data = reduced(simulate(plan, np.random.default_rng(seed)).files)
    system, estimate = identify(cell, data, KR500.nominal_compliance)
    where = place_of_interest(None, KR500, data.pulls)
    found = diagnose(cell, data, estimate, where, np.random.default_rng(0))
    return found, cell, data, system, estimate


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("noise_scale", [1.3, 1.0, 0.8])
def test_an_innocent_robot_is_let_go(noise_scale):
    """Without a hidden effect the model is adequate, whatever the true scatter of the readings."""
    found, *_ = examined(21, noise_scale=noise_scale)

    assert verdict(found.facts) == "adequate"
    assert not found.causes
    assert found.estimate is None
    assert found.facts.gain is None, "no cause, so nothing that could improve a prediction"


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("planted", "label"),
    [
        ("rail_roll", "rail_roll"),
        ("rail_backlash", "rail_backlash"),
        ("joint_tilt:2", "joint_tilt:2"),
        ("joint_hardening:3", "joint_hardening:3"),
        ("joint_lost_motion:3=2x", "joint_lost_motion:3"),
        ("chain_offset=2x", "chain_offset"),
    ],
)
def test_a_hidden_effect_is_named(planted, label):
    """The hidden effect is named with its place, and reduces the cross-validation error."""
    found, *_ = examined(22, planted)

    assert verdict(found.facts) == "explained"
    assert [cause.effect.label for cause in found.causes] == [label]
    assert found.causes[0].gain.ci95[0] > 0
    assert found.estimate.p_value > 1e-3


@pytest.mark.whole
def test_a_drift_that_the_base_rounds_would_show_is_not_named():
    """The same displacements without base rounds, and beside rounds that show not half of it."""
    found, cell, data, _, estimate = examined(22, "tracker_drift=6x")
    (cause,) = found.causes
    assert cause.effect.label == "tracker_drift"
    nothing, unsure = np.zeros(3), np.full(3, 1e-9)
    still = Drift(
        effect=cause.effect,
        velocity=nothing,
        std=unsure,
        turn=nothing,
        turn_std=unsure,
        moved_m=0.0,
        hours=2.0,
        p_value=0.5,
        named=False,
        undecided=False,
        visible=2.0,
    )
    where = place_of_interest(None, KR500, data.pulls)
    other = diagnose(cell, data, estimate, where, np.random.default_rng(0), drift=still)
    assert "tracker_drift" not in [one.effect.label for one in other.causes]


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("planted", "pair"),
    [
        ("joint_tilt:5=2x", {"joint_tilt:5", "joint_tilt:6"}),
        ("tool_flex=2x", {"joint_tilt:7", "tool_flex"}),
    ],
)
def test_twins_are_never_named_singly(planted, pair):
    """Effects that no pose separates are ambiguous, and both are named."""
    found, *_ = examined(23, planted)

    assert verdict(found.facts) == "ambiguous"
    cause = found.causes[0]
    assert {cause.effect.label, cause.rivals[0].effect.label} == pair
    assert cause.probability < 0.7


@pytest.mark.whole
def test_what_is_stated_of_a_stiffness_holds_with_the_twin_too():
    """Joint 6 tilts, its twin may be named: every interval holds the true spring, with a note."""
    true = [7e7, 4.2e6, 6e6, 3.5e6, 6.5e5, 6e5, 4.2e5]
    found, cell, *_ = examined(23, "joint_tilt:6=2x", stiffness=true)

    entries = stiffness_entries(cell, found.hypotheses)
    depends = {d.spring for d in dependences(found.hypotheses)}
    assert depends
    for j, one in enumerate(entries):
        low, high = (b if b is not None else e for b, e in zip(one.ci95, (0, np.inf), strict=True))
        assert low < true[j] < high
        if one.value is not None:
            assert abs(one.compliance - 1 / true[j]) / one.compliance_std < 3
            assert sum(part.share for part in one.budget) == pytest.approx(1, abs=1e-3)
        if j in depends:
            assert all(f"tilt of the bearing in joint {k}" in one.finding for k in (5, 6))


@pytest.mark.slow
def test_what_comes_nearest_predicts_better_and_is_not_believed():
    """The carriage is displaced for good, as in no law: any listed cause is improbable.

    A cause that predicts worse is none: tests/diagnosis/test_verdict.py has the facts.
    """
    rules = Rules()
    plan = drawn(KR500, np.random.default_rng((2026, 9, 1)), rules)
    walks = SECRETS["carriage_walks"]
    files = play(KR500, plan, [(walks, 2.0)], np.random.default_rng([1, 10]), rules).files

    said = campaign_answer("walks", in_memory(files)).answer
    found = said.diagnosis
    assert found.verdict == "unexplained"
    assert all(one.gain.reduction > 0 for one in found.causes)
    assert all(one.probability < 1e-3 for one in found.causes)
    assert all(one.outside_catalogue.probability > 0.99 for one in found.causes)
    assert said.recommended.model == "joint_springs"
    assert all(one.reduction > 0 for one in found.alone)


@pytest.mark.whole
def test_two_laws_of_a_gear_that_a_plan_hardly_tells_ask_for_a_pull():
    """If no torque is below the knee of a gear, lost motion and a knee are equal.

    Both are given.
    """
    found, *_ = examined(22, "joint_lost_motion:4=2x")

    assert verdict(found.facts) == "ambiguous"
    cause = found.causes[0]
    assert cause.effect.label == "joint_lost_motion:4"
    assert [rival.effect.label for rival in cause.rivals] == ["joint_hardening:4"]
    asked = [p for p in found.next_poses if "joint_hardening:4" in p.separates]
    assert asked
    assert asked[-1].after > asked[0].before + 1.0
    said = diagnosis_of_good_data(found, load("kr500_rail")).next_poses
    assert [one.approach for one in said] == [one.at.approach for one in found.next_poses]
    assert {abs(one.approach) for one in said} == {1.0}


def test_hidden_twins_of_the_stiffnesses_are_blind_spots():
    """A wrong gain and a yawing carriage are unnoticed, and the diagnosis says so."""
    found, *_ = examined(24, "scale_gain", "rail_yaw")

    assert verdict(found.facts) == "adequate"
    blind = {s.effect.label: s for s in found.blind_spots}
    assert blind["scale_gain"].smallest_visible is None
    assert "dead weight" in blind["scale_gain"].effect.needs
    assert blind["rail_yaw"].smallest_visible is None


@pytest.mark.whole
def test_scatter_beyond_the_certificate_is_named():
    """Readings that scatter 2.2 times as stated are a cause, not a missing spring."""
    found, *_ = examined(25, noise_scale=2.2)

    assert [cause.effect.name for cause in found.causes] == ["tracker_noise"]
    assert found.scatter.tracker == pytest.approx(2.2, abs=4 * found.scatter.tracker_std)


@pytest.mark.whole
def test_a_scale_that_scatters_weighs_less_in_the_extended_stiffnesses():
    """Named with its factor; the springs hold the truth, with larger uncertainty."""
    stiffness = (1.2 / KR500.nominal_compliance).tolist()
    plan = Plan(
        poses={"count": 16},
        pulls={"steps_n": [1000, 2000, 3000, 1500]},
        scale={"sigma_n": 3.0},
        hidden={"effects": ["force_noise=9x"], "stiffness": stiffness, "equilibrium": "deformed"},
    )
    cell, data = reduced(simulate(plan, np.random.default_rng(25)).files)
    _, before = identify(cell, data, KR500.nominal_compliance)
    where = place_of_interest(None, KR500, data.pulls)
    found = diagnose(cell, data, before, where, np.random.default_rng(0))

    assert [cause.effect.name for cause in found.causes] == ["force_noise"]
    off = found.estimate.value - 1 / np.array(stiffness)
    assert np.all(np.abs(off) < 3.5 * found.estimate.std)
    assert np.all((found.estimate.std > 1.085 * before.std)[1:6])  # no force loads joint 7


@pytest.mark.whole
def test_the_extended_model_gives_back_the_planted_size_and_the_springs():
    """Springs and cause, estimated together, are within their uncertainty."""
    found, _, _, _, before = examined(26, "rail_roll=2x")
    size = found.causes[0].amplitudes[0]

    assert size.value == pytest.approx(2e-8, abs=4 * size.std)
    assert found.estimate.chi2 / found.estimate.dof == pytest.approx(1, abs=0.25)
    assert len(found.estimate.value) == len(before.value) + 1


@pytest.mark.whole
def test_what_the_diagnosis_says_fits_into_result_json_and_the_tables():
    """The answer is JSON without NaN, and the tables conform to their schemas."""
    found, cell, data, system, estimate = examined(27, "rail_roll")

    said = diagnosis_of_good_data(found, KR500)
    assert json.loads(said.model_dump_json())["verdict"] == "explained"
    assert said.causes[0].gain.reduction > 0
    tables.conform(clues_table(found), promises.DIAGNOSIS)
    tables.conform(apart_table(found), promises.SEPARABILITY)
    rows = examined_table(found, cell, data, system, estimate)
    kept = tables.conform(rows, promises.examined(KR500)).to_pandas()
    assert np.isfinite(kept["left_out_extended_m"]).all()
    assert kept["left_out_extended_m"].std() < kept["left_out_m"].std()


@pytest.mark.slow
def test_the_same_campaign_gets_the_same_diagnosis():
    """The result depends only on the campaign and the generator."""
    first, *_ = examined(28, "compensator=2x")
    second, *_ = examined(28, "compensator=2x")

    assert diagnosis_of_good_data(first, KR500) == diagnosis_of_good_data(second, KR500)


@pytest.mark.parametrize(("noise_scale", "due"), [(1.0, "explained"), (3.0, "unexplained")])
def test_three_poses_confirm_a_cause_where_the_stated_noise_holds(noise_scale, due):
    """A carriage that rolls; with three times the stated noise a fourth pose is required."""
    plan = Plan(
        poses={"count": 3},
        pulls={"steps_n": [1000, 2000, 3000, 1500]},
        tracker={"noise_scale": noise_scale},
        hidden={"effects": ["rail_roll=5x"], "stiffness_spread": 0.25, "tool_sd_m": 2e-4},
    )
    files = simulate(plan, np.random.default_rng(0)).files

    answer = campaign_answer("three", in_memory(files)).answer

    assert answer.diagnosis.verdict == due
    assert any("requires four poses" in said for said in answer.verdict_sentence) == (
        due == "unexplained"
    )
