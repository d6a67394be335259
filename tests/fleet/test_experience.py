"""What finished campaigns teach of causes, and what a run makes of it."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import report_sample

from pipeline.answer.contract import BlindSpot, Cause, PositionStep, Unit
from pipeline.base.errors import InputError
from pipeline.diagnosis.finding import Verdict
from pipeline.fleet.experience import experience, toml
from pipeline.reduction.settings import CausePrior
from pipeline.run import campaign_answer
from pipeline.simulate import simulate
from pipeline.store.campaign import in_memory

SAMPLE = report_sample.answer()
NAMES = ("rail_roll", "joint_tilt", "tool_flex", "rail_pitch")


def cause(name, times):
    return Cause.model_construct(name=name, where=None, probability=0.99, times_typical=times)


def answer(serial, *causes, verdict=Verdict.EXPLAINED, priors=()):
    said = SAMPLE.diagnosis.model_copy(update={"causes": causes, "verdict": verdict})
    unit = Unit(serial=str(serial), certificate=None, calibrated=None)
    model = SAMPLE.model.model_copy(update={"priors": priors})
    return SAMPLE.model_copy(update={"diagnosis": said, "robot_unit": unit, "model": model})


def fleet(rng, robots=40, campaigns=2):
    """Every third robot rolls on its rail, twice as much as usual; every twentieth has a tilt."""
    out = []
    for k in range(robots):
        own = [cause("rail_roll", 2.0 * rng.lognormal(0, 0.3))] if k % 3 == 0 else []
        own += [cause("joint_tilt", rng.lognormal(0, 0.3))] if k % 20 == 0 else []
        out += [answer(k, *own) for _ in range(campaigns)]
    return out


def test_common_causes_are_expected_and_large_ones_larger():
    """Odds follow the rates of robots and sizes their mean; what nobody had is rarest."""
    found = experience(fleet(np.random.default_rng(1)), NAMES)
    by_name = {one.name: one for one in found.causes}

    assert (found.robots, found.campaigns, found.learnt) == (40, 80, True)
    assert by_name["rail_roll"].odds > 2.5 > 1 > by_name["tool_flex"].odds
    assert by_name["tool_flex"].odds == by_name["rail_pitch"].odds >= 0.25
    assert max(one.odds for one in found.causes) <= 4.0
    assert by_name["rail_roll"].size == pytest.approx(1.8, abs=0.25)
    assert by_name["joint_tilt"].size == 1.0, "two robots teach no size"
    assert not by_name["joint_tilt"].size_learnt


def test_a_robot_counts_once_however_often_it_is_measured():
    """Fifty campaigns of one robot with a cause make it no commoner in others."""
    steady = fleet(np.random.default_rng(2))
    often = [*steady, *(answer(3, cause("rail_roll", 2.0)) for _ in range(50))]

    a, b = (experience(answers, NAMES).causes for answers in (steady, often))
    assert [one.odds for one in a] == pytest.approx([one.odds for one in b], rel=0.02)


def test_only_campaigns_that_could_see_a_cause_teach_that_it_is_rare():
    """Blind ones say nothing of it; positions nothing of what pulls are asked for."""
    rng = np.random.default_rng(1)
    spot = BlindSpot.model_construct(name="tool_flex", where=None)
    step = PositionStep(model="nominal table", between_mm=1.0, space_mm=1.0, series_mm=None)
    plain, told = fleet(rng), fleet(np.random.default_rng(1))
    blind = [
        one.model_copy(
            update={"diagnosis": one.diagnosis.model_copy(update={"blind_spots": (spot,)})}
        )
        for one in told
    ]
    weights = [one.model_copy(update={"position_steps": (step,)}) for one in told]
    odds = {
        key: {one.name: one.odds for one in experience(those, NAMES).causes}
        for key, those in {"plain": plain, "blind": blind, "both": [*plain, *weights]}.items()
    }

    assert odds["blind"]["tool_flex"] > odds["plain"]["tool_flex"]
    assert odds["both"] == odds["plain"]


def test_few_campaigns_teach_nothing_and_say_so():
    """Odds and sizes are the guessed ones, and no table is written."""
    found = experience(fleet(np.random.default_rng(3), robots=6), NAMES)

    assert not found.learnt
    assert {one.odds for one in found.causes} == {1.0}
    assert "all are guessed to be equally likely" in toml(found)
    assert tomllib.loads(toml(found)) == {}


@pytest.mark.parametrize("spoil", [{"verdict": Verdict.BAD_DATA}, {"priors": ("rail_roll",)}])
def test_bad_data_and_what_was_learnt_before_teach_nothing(spoil):
    """Else a prior would confirm itself."""
    good = fleet(np.random.default_rng(4))
    more = [answer(100 + k, cause("tool_flex", 3.0), **spoil) for k in range(30)]

    assert experience([*good, *more], NAMES) == experience(good, NAMES)


def test_what_is_written_is_what_campaign_toml_takes():
    """Every table is one of [priors], within its bounds."""
    said = tomllib.loads(toml(experience(fleet(np.random.default_rng(5)), NAMES)))["priors"]

    assert set(said) == set(NAMES)
    assert all(CausePrior(**one).odds == one["odds"] for one in said.values())
    assert said["rail_roll"]["size"] > 1.5


@pytest.fixture(scope="module")
def raw(small_plan):
    """A campaign's files with and without [priors]."""
    files = dict(simulate(small_plan).files)

    def made(more=""):
        toml = files["campaign.toml"] + more.encode()
        return in_memory(files | {"campaign.toml": toml})

    return made


@pytest.mark.whole
def test_priors_change_odds_and_nothing_where_they_say_nothing(raw):
    """Odds of 1 and sizes of 1 give the answer to the last digit; others are said."""
    plain = campaign_answer("a", raw()).answer
    same = campaign_answer("a", raw("\n[priors.rail_roll]\nodds = 1.0\n")).answer

    assert same.model.priors == ("rail_roll",)
    assert "estimated from other campaigns" in " ".join(same.assumptions)
    assert same.diagnosis == plain.diagnosis
    assert same.stiffness == plain.stiffness


def test_a_cause_that_is_none_is_refused(raw):
    """With the names that there are."""
    with pytest.raises(InputError, match=r"\[priors\] has rail_rol, .* rail_roll"):
        campaign_answer("a", raw("\n[priors.rail_rol]\nodds = 2.0\n"))
