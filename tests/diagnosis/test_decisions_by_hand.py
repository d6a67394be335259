"""Decisions of a diagnosis at either side of their bounds, from numbers put in by hand."""

from dataclasses import dataclass, replace
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pipeline.diagnosis import (
    cause_search,
    causes,
    converge,
    diagnose,
    drift,
    hypotheses,
    unlisted,
    unloaded_geometry,
)
from pipeline.diagnosis.cause_search import NamelessReplacement, Replacement, _Move
from pipeline.diagnosis.facts import NO_UNLOADED, CrossValidation, Facts
from pipeline.geometry.unloaded import MidChange
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.system import alarms
from pipeline.system.simultaneous import cost

KR500 = load("kr500_rail")
EFFECTS = {one.label: one for one in catalogue(KR500)}
ONE_TABLE_CAUSE = (Some(effect=Some(since=False)),)


def gained(reduction, low):
    """A cross-validation."""
    return CrossValidation(np.ones(1), np.ones(1), reduction, (low, 0.9), ())


# --- unloaded positions ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("known", "yes"),
    [
        ({}, ()),
        ({"miss_m": 0.9e-3}, ("off",)),
        ({"miss_m": 1.1e-3}, ("off", "unexplained")),  # ten times the noise
        ({"miss_m": 1.1e-3, "usual_m": 0.6e-3}, ("off",)),  # not twice what joints err by
        ({"miss_m": 1.1e-3, "yields_m": 0.9e-3}, ("off",)),
        ({"miss_m": 0.03}, ("off", "unexplained", "refuted")),
        ({"tool_m": 0.03}, ("refuted",)),
        ({"miss_m": 0.05, "causes": ONE_TABLE_CAUSE}, ("believed", "corrects")),
        (
            {"miss_m": 0.05, "causes": ONE_TABLE_CAUSE, "left_m": 0.03},
            ("off", "unexplained", "refuted"),
        ),
        (
            {"miss_m": 1.1e-3, "causes": ONE_TABLE_CAUSE, "gain": gained(0.0, -0.1)},
            ("off", "unexplained", "useless"),
        ),
        (
            {"miss_m": 1.1e-3, "causes": ONE_TABLE_CAUSE, "gain": gained(0.1, -0.1)},
            ("believed", "corrects"),
        ),
        ({"rough": True, "miss_m": 1.1e-3}, ("off", "unexplained")),
        ({"rough": True, "miss_m": 1.1e-3, "gain": gained(0.2, 0.1)}, ("corrects",)),
        ({"miss_m": 1.1e-3, "gain": gained(0.2, 0.1)}, ("off", "unexplained")),
        (
            {"rough": True, "miss_m": 0.03, "gain": gained(0.2, 0.1)},
            ("off", "unexplained", "refuted"),
        ),
    ],
)
def test_unloaded_positions_are_judged_by_their_deviation(known, yes):
    """Noise of 0.1 mm, deviations of 0.15 mm with a table that leaves 0.1 mm, if not otherwise."""
    usual = {"miss_m": 1.5e-4, "left_m": 1e-4, "noise_m": 1e-4, "usual_m": 1e-4}
    stood = replace(NO_UNLOADED, **usual | known)
    names = ("believed", "corrects", "off", "unexplained", "useless", "refuted")

    assert {one for one in names if getattr(stood, one)} == set(yes)
    assert stood.remains_m == (stood.left_m if stood.corrects else stood.miss_m)
    assert stood.since == (not stood.causes)
    assert not stood.weighs


class Suspect(Some):
    """One of many, which are told apart by themselves."""

    __hash__ = object.__hash__


def named(label, name="", sags=False, columns=(0,)):
    """A suspect of the table."""
    parameters = tuple(Some(typical=t, lower=-1.0, upper=1.0) for t in (2.0, 5.0)[: len(columns)])
    effect = Some(label=label, name=name or label, parameters=parameters)
    return Suspect(effect=effect, label=label, sags=sags, columns=columns, wide=0.1)


def test_rivals_are_the_others_that_are_not_improbable():
    """The likeliest first, those of one origin with the cause left out."""
    others = [named(one) for one in "abcde"]
    odds = np.array([0.2, 0.5, alarms.GEOMETRY, 0.25, 2 * alarms.GEOMETRY])
    found = unloaded_geometry._rivals(others, odds, [1])
    assert [(one.effect.label, one.probability) for one in found] == [
        ("d", 0.25), ("a", 0.2), ("e", 2 * alarms.GEOMETRY),
    ]  # fmt: skip


def test_masses_are_in_units_of_their_usual_sizes():
    """And so are their bounds; whatever else is in SI."""
    sag, other = named("s", sags=True, columns=(0, 1)), named("o", columns=(0, 1))
    assert unloaded_geometry._units(sag).tolist() == [2.0, 5.0]
    assert unloaded_geometry._units(other).tolist() == [1.0, 1.0]
    for mean, fits in (([0.5, 0.2], True), ([0.51, 0.0], False), ([0.0, -0.21], False)):
        search = Some(found=Some(mean=np.array(mean)))
        assert unloaded_geometry._Search.possible(search, sag) is fits
        assert unloaded_geometry._Search.possible(search, other)


def test_a_bump_turns_the_robot_at_the_poses_since_it():
    """By the last three of its six unknowns; a joint's change and a target's turn nothing."""
    pulls = Some(pose=np.array([1, 2, 3, 3]))
    changed = [
        (MidChange(2, (1,), 2), slice(0, 1)),
        (MidChange(0, (1, 2), 3), slice(1, 7)),
        (MidChange(0, (1,), 2, target=1), slice(7, 10)),
    ]
    x = np.arange(10.0)
    (turns,) = unloaded_geometry._bumps(Some(changed=changed), x, pulls)
    assert turns.tolist() == [[0, 0, 0], [0, 0, 0], [4, 5, 6], [4, 5, 6]]


def test_a_cause_is_compared_with_what_the_rest_is_off_by():
    """Its length over it; of many unknowns what they move, rms over the coordinates."""
    D = np.zeros((1, 2, 2))
    D[0, 0] = 3.0, 0.0
    D[0, 1] = 0.0, 4.0
    rows = Some(D=D)
    columns = Some(table=slice(0, 1), changes=slice(9, 9), loose=slice(5, 8))
    zeros = Some(columns=columns, about=lambda x: rows, usual=lambda: np.array([2e-4]))
    found = Some(
        mean=np.array([1e-3, 2e-3]), zeros=zeros, per_letter=np.array([5e-4]),
        roughness=(4e-4, 1e-4),
    )  # fmt: skip
    assert unloaded_geometry._size(found, named("a")) == pytest.approx(2.0)
    found.per_letter[:] = 1e-4
    assert unloaded_geometry._size(found, named("a")) == pytest.approx(5.0)
    many = named("b", "base_moved", columns=(0, 1))
    moves = np.sqrt((3e-3**2 + 8e-3**2) / 2)
    assert unloaded_geometry._size(found, many) == pytest.approx(moves / 2e-4)
    columns.table = slice(1, 2)  # the first is then of the masses
    assert unloaded_geometry._size(found, many) == pytest.approx(moves / 4e-4)
    assert unloaded_geometry._least(found, named("c")) == pytest.approx(
        unloaded_geometry.OUTSTANDING * 4e-4 / 2.0
    )
    assert unloaded_geometry._least(found, named("c", sags=True, columns=(0, 1))) == pytest.approx(
        unloaded_geometry.OUTSTANDING * 4e-4 / np.sqrt(12.5)
    )


# --- the base -------------------------------------------------------------------------------------

DRIFT = next(one for one in EFFECTS.values() if one.name == "tracker_drift")


@dataclass(frozen=True)
class Laws:
    """Two laws of a drift, of which the second explains 50 of 70 by a motion of its own."""

    rest: float = 70.0
    drop: tuple = (10.0, 50.0)
    dof: int = 26
    chance: float = 1e-9
    known: float = 1e18

    @property
    def size(self):
        """Motion by each law."""
        return np.array([np.zeros(6), [1e-8, 2e-8, 3e-8, 4e-7, 5e-7, 6e-7]])

    @property
    def N(self):
        """Information on it."""
        return np.array([np.eye(6), self.known * np.eye(6)])

    @property
    def cov(self):
        """Its covariance."""
        return np.array([np.eye(6), np.diag([1, 4, 9, 16, 25, 36]) * 1e-18])

    def p(self, variance, dof):
        """P-values, which show by which variance they were asked for."""
        assert dof == np.inf
        return np.array([0.5, self.chance * variance])


@pytest.mark.parametrize(
    ("knocked", "named_", "undecided"),
    [(-9.3, True, False), (-9.1, True, True), (9.1, True, True), (9.3, False, True)],
)
def test_a_drift_is_told_from_a_knock_by_their_margin(knocked, named_, undecided):
    """Odds of a hundred to one either way decide."""
    found = drift._stated(DRIFT, Laws(), 1, knocked, 2e-4, 3.0)
    assert (found.named, found.undecided) == (named_, undecided)


def test_a_drift_is_stated_with_what_its_law_leaves():
    """Of 70 the motion leaves 20 with 20 degrees of freedom: as much as chance."""
    found = drift._stated(DRIFT, Laws(), 1, -20.0, 2e-4, 3.0)
    assert found.p_value == pytest.approx(1.69e-9)
    assert found.velocity.tolist() == [1e-8, 2e-8, 3e-8]
    assert found.turn == pytest.approx(np.array([4e-8, 5e-8, 6e-8]))  # a lever of ten metres
    assert found.std == pytest.approx(np.array([1e-9, 2e-9, 3e-9]))
    assert found.turn_std == pytest.approx(np.array([4e-10, 5e-10, 6e-10]))
    assert (found.moved_m, found.hours) == (2e-4, 3.0)
    vague = drift._stated(DRIFT, Laws(known=1e8), 1, -20.0, 2e-4, 3.0)
    assert found.visible < 1.0 == vague.visible  # it was seen


@pytest.mark.parametrize("known", [1e18, 1e14])
def test_a_drift_that_is_not_seen_would_be_from_some_size_on(known):
    """In four of five campaigns, by the noncentral chi-square of six unknowns."""
    found = drift._stated(DRIFT, Laws(chance=0.1, known=known), 1, -20.0, 2e-4, 3.0)
    shown = known * sum(one.typical**2 for one in DRIFT.parameters) / 1.69
    least = stats.chi2.isf(alarms.DRIFT, 6)
    assert not found.named
    assert stats.ncx2.sf(least, 6, found.visible**2 * shown) == pytest.approx(0.8, rel=1e-6)


def test_what_a_drift_leaves_widens_it_and_beyond_chance_unmakes_it():
    """80 of 20 degrees of freedom are no rigid motion; 40 and 65 are, with their variance."""
    wide = drift._stated(DRIFT, Laws(rest=90.0), 1, -20.0, 2e-4, 3.0)
    assert wide.named
    assert wide.std == pytest.approx(np.sqrt(2) * np.array([1e-9, 2e-9, 3e-9]))
    assert wide.p_value == pytest.approx(2e-9)
    assert drift._stated(DRIFT, Laws(rest=115.0), 1, -20.0, 2e-4, 3.0).named  # by 1.3 squared
    odd = drift._stated(DRIFT, Laws(rest=130.0), 1, -20.0, 2e-4, 3.0)
    assert (odd.named, odd.visible) == (False, np.inf)
    weak = drift._stated(DRIFT, Laws(chance=0.1), 1, -20.0, 2e-4, 3.0)
    assert not weak.named


def test_readings_of_the_base_are_after_each_interval_between_two_rounds():
    """Rounds in the order of their mean times, whatever their names."""
    table = pd.DataFrame({"group": list("bbaac"), "since": [0.0, 10, 100, 110, 50]})
    found = [one.tolist() for one in drift._rounds(table)]
    assert found == [[False, False, True, True, True], [False, False, True, True, False]]


def test_reflectors_that_were_read_in_one_round_tell_no_motion():
    """Seconds since the first reading with a time; by order all rows have one."""
    time = pd.to_datetime(["2026-01-01 10:00", "2026-01-01 10:01", None, "2026-01-01 10:03"])
    table = pd.DataFrame(
        {"target": ["B1", "B2", "B1", "B1"], "group": ["a", "a", "b", "c"], "time": time,
         "time_s": [5.0, 6, 7, 9]}
    )  # fmt: skip
    timed = drift._repeated(table, False)
    assert timed["since"].tolist() == [0.0, 180.0]
    assert timed["group"].tolist() == ["a", "c"]
    ordered = drift._repeated(table, True)
    assert ordered["since"].tolist() == [0.0, 2.0, 4.0]
    assert ordered["group"].tolist() == ["a", "b", "c"]


def test_rounds_that_no_motion_makes_agree_are_deformed():
    """By what is left of them, in the noise of a reading; nothing where chance leaves as much."""
    white = np.broadcast_to(np.eye(3) / 2e-5, (8, 3, 3))
    assert drift._unit_m(white) == pytest.approx(2e-5)
    each = Some(rest=100.0, drop=[10.0], dof=16, rank=[6])
    assert drift._beyond(each) == (90.0, 10)
    assert drift._deformed(each, white) == pytest.approx(6e-5)
    for left, dof in ((40.0, 16), (100.0, 6)):
        quiet = Some(rest=left, drop=[10.0], dof=dof, rank=[6])
        assert drift._deformed(quiet, white) == 0.0
    assert drift._deformed(None, white) == 0.0


@pytest.mark.parametrize(
    ("known", "knocked"),
    [
        ({}, True),
        ({"chance": 2e-9}, False),
        ({"least": 1e-4}, False),
        ({"deformed": 1e-6}, False),
        ({"dof": 6}, False),
        ({"each": None}, False),
    ],
)
def test_a_tracker_was_knocked_before_the_round_that_moved_most(known, knocked):
    """By 0.3 mm along x, rms over the readings, after a step of 0.1 mm; ten sigma at least."""
    named_rounds = pd.DataFrame({"group": list("aabbcc"), "since": [0.0, 1, 9, 10, 19, 20]})
    rigid = np.zeros((6, 3, 6))
    rigid[:, :, :3] = np.eye(3)
    rigid[::2, 1, 3] = 1.0  # a turn moves every second reading
    size = np.zeros((2, 6))
    size[0, 0], size[1, 0], size[1, 3] = 1e-4, 3e-4, 4e-4
    asked = []

    def p(variance, dof):
        asked.append((variance, dof))
        return np.array([known.get("chance", 5e-10)])

    each = Some(size=size.reshape(1, 12), p=p, rest=30.0, drop=[10.0], dof=known.get("dof", 20),
                rank=[6])  # fmt: skip
    law = replace(drift._stated(DRIFT, Laws(chance=0.1), 1, -20.0, 2e-4, 3.0),
                  deformed_m=known.get("deformed", 0.0))  # fmt: skip
    white = np.broadcast_to(np.eye(3) / known.get("least", 2e-5), (6, 3, 3))
    found = drift._knocked(law, known.get("each", each), named_rounds, white, rigid)

    if not knocked:
        assert found is law
        return
    assert found.knocked == ("b", "c")
    assert found.moved_m == pytest.approx(np.sqrt(9e-8 + 16e-8 / 2))
    assert asked == [(pytest.approx(1.69), np.inf)]


# --- sets of causes -------------------------------------------------------------------------------


def task(*labels):
    """Suspects without laws."""
    each = [Some(label=one, law=None, called=f"the {one}") for one in labels]
    return Some(suspects=tuple(each), nameless=("x",))


def test_sets_of_causes_share_their_probability():
    """Two places, in one of them two causes; one stranger in the first place, one in both."""
    rivals = (
        (Replacement("a", 0, 0.75, ((0, 1.0),)), Replacement("b", 1, 0.25, ((1, 0.6), (2, 0.4)))),
        (Replacement("c", 3, 1.0, ((3, 1.0),)),),
    )
    both = NamelessReplacement(0.5, 5, (0, 1))
    strange = (NamelessReplacement(0.2, 4, (0,)), both)
    found = Some(accepted=(0, 3), rivals=rivals, strange=strange)
    sets = hypotheses._likely(task("a", "b", "b", "c"), found)

    known = 0.8 * 0.5
    expected = [
        ((0, 3), known * 0.75, ()),
        ((5,), 0.6 * 0.5 / 0.7, ((0, 5), (3, 5))),
        ((3, 4), 0.6 * 0.2 / 0.7, ((0, 4),)),
        ((1, 3), known * 0.25 * 0.6, ((0, 1),)),
        ((2, 3), known * 0.25 * 0.4, ((0, 2),)),
    ]
    assert [one.suspects for one in sets] == [one for one, *_ in expected]
    assert [one.weight for one in sets] == pytest.approx([one for _, one, _ in expected])
    assert [one.instead for one in sets] == [one for *_, one in expected]
    assert sum(one.weight for one in sets) == pytest.approx(1.0)


def test_a_cause_that_takes_two_places_is_in_no_set():
    """Nor is what is hardly likely; the accepted causes lead whatever their weight."""
    rivals = (
        (Replacement("a", 0, 0.005, ((0, 1.0),)), Replacement("b", 1, 0.995, ((1, 1.0),))),
        (Replacement("b", 1, 0.5, ((1, 1.0),)), Replacement("c", 2, 0.5, ((2, 1.0),))),
    )
    found = Some(accepted=(0, 1), rivals=rivals, strange=())
    sets = hypotheses._likely(task("a", "b", "c"), found)
    assert [(one.suspects, one.weight) for one in sets] == [
        ((0, 1), 0.0), ((1, 2), pytest.approx(0.4975)),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("first", "second", "strange", "certain"),
    [(0.96, 0.96, 0.0, True), (0.96, 0.94, 0.0, False), (0.96, 0.96, 0.06, False)],
)
def test_every_cause_must_be_certain_and_no_stranger_likely(first, second, strange, certain):
    """At 95 %, each against its own rivals."""
    rivals = (
        (Replacement("a", 0, first), Replacement("b", 1, 1 - first)),
        (Replacement("a", 0, 1 - second), Replacement("b", 1, second)),
    )
    stranger = NamelessReplacement(strange, 2) if strange else None
    found = Some(accepted=(0, 1), rivals=rivals, stranger=stranger)
    assert hypotheses._certain(task("a", "b"), found) is certain


@dataclass(frozen=True, eq=False)
class Law:
    """A suspect with or without a law."""

    label: str
    law: float | None


@dataclass(frozen=True)
class Weighed:
    """Something with a weight."""

    weight: float


def test_small_causes_leave_the_others_their_probability():
    """A tenth and a fifth, of seven tenths."""
    sets = hypotheses.beside_small([Weighed(0.75), Weighed(0.25)], [Weighed(0.1), Weighed(0.2)])
    assert [one.weight for one in sets] == pytest.approx([0.525, 0.175, 0.1, 0.2])


def test_newcomers_take_the_place_of_the_first_that_leaves():
    """The others stay in their order."""
    suspects = task(*"abcdef").suspects
    assert _Move(0.0, (1,), ()).of(suspects, (5, 4, 3)) == (5, 3)
    assert _Move(0.0, (1,), (0,)).of(suspects, (5, 4, 3)) == (5, 0, 3)
    assert _Move(0.0, (0, 2), (1, 2)).of(suspects, (5, 4, 3)) == (1, 2, 4)
    assert _Move(0.0, (1, 2), (0,)).of(suspects, (5, 4, 3)) == (5, 0)


@pytest.mark.parametrize(
    ("into", "mine", "theirs", "gains"),
    [
        ((), 9.0, 0.0, True),
        ((2,), 5.0, 5.2, True),
        ((2,), 5.0, 5.05, False),
        ((2, 3), 5.0, 5.2, False),
        ((2, 3), 5.0, 5.2 + cause_search.LEAST_EVIDENCE, True),
    ],
)
def test_a_move_must_gain_where_those_that_leave_do_not_act(monkeypatch, into, mine, theirs, gains):
    """Beside those that stay, by a tenth, and by the price of each cause more."""
    asked = []

    def chained(task, view, rest, which):
        asked.append((view, tuple(rest), tuple(which)))
        return mine if tuple(which) == (1,) else theirs

    monkeypatch.setattr(cause_search, "_chained", chained)
    view = Some(model=Some(accepted=(0, 1)))
    without = Some(suspects=(), without=lambda view, gone: ("without", gone))
    assert cause_search._gains(without, view, _Move(1.0, (1,), into)) is gains
    assert asked == (
        [(("without", {1}), (0,), (1,)), (("without", {1}), (0,), into)] if into else []
    )


@pytest.mark.parametrize(("p", "lacks", "open_"), [(1e-4, False, True), (1e-2, False, False),
                                                   (1e-2, True, True)])  # fmt: skip
def test_something_is_open_by_a_suspect_or_by_lack_of_fit(p, lacks, open_):
    """Either is enough."""
    end = Some(p=np.array([0.5, p]), lack=Some(found=lacks))
    assert cause_search._open(end, Some(p=1e-3)) is open_


@pytest.mark.parametrize(
    ("detected", "explains", "strange", "unproven", "open_"),
    [
        (False, False, 0.9, 0.5, False),
        (True, True, 0.0, 0.0, False),
        (True, False, 0.0, 0.0, True),
        (True, True, 0.06, 0.0, True),
        (True, True, 0.04, 0.0, False),
        (True, True, None, 0.01, True),
    ],
)
def test_laws_are_sought_where_the_catalogue_is_not_certain(
    detected, explains, strange, unproven, open_
):
    """Something is left, or has no name, or predicts no left-out pose for certain."""
    stranger = None if strange is None else Some(probability=strange)
    plain = Some(unproven=lambda columns, rng: unproven)
    found = Some(detected=detected, explains=explains, stranger=stranger, plain=plain)
    assert unlisted._open_(found, np.random.default_rng(1)) is open_


# --- causes ---------------------------------------------------------------------------------------


def test_rivals_of_a_cause_are_the_others_of_its_place():
    """Its own probability; none where it is none of them."""
    each = (Replacement("b", 1, 0.3), Replacement("a", 0, 0.7))
    found, asked = Some(rivals=(each,)), task("a", "b", "c")
    own, others = causes._possible(asked, found, 0, asked.suspects[0])
    assert (own, [(one.effect.label, one.probability) for one in others]) == (0.7, [("b", 0.3)])
    own, others = causes._possible(asked, found, 0, asked.suspects[2])
    assert (own, len(others)) == (0.0, 2)


def test_what_has_no_name_is_stated_for_each_place():
    """With its probability there; nothing where nothing nameless was sought."""
    strange = (NamelessReplacement(0.1, 2), NamelessReplacement(0.4, 3))
    found = Some(strange=strange, wide=Some(suspects=("a", "b", "x", "y")))
    assert causes._unnamed(Some(strange=()), 1) is None
    one = causes._unnamed(found, 1)
    assert (one.effect, one.probability) == ("y", 0.4)


def test_undecided_laws_of_a_place_are_told_by_their_share():
    """Within the least evidence of the likeliest; the accepted one first."""
    laws = [*(Law("a", 1.0) for _ in range(4)), Law("b", None)]
    far = np.exp(-cause_search.LEAST_EVIDENCE)
    forms = ((0, 0.3), (1, 0.6), (2, 0.6 * far * 0.99), (3, 0.6 * far * 1.01))
    found = Some(accepted=(0, 4), rivals=((Replacement("a", 0, 1.0, forms),),) * 2)
    told = causes._either(Some(suspects=laws), found, 0)
    assert [one.effect for one in told] == [laws[0], laws[1], laws[3]]
    assert [one.probability for one in told][:2] == [0.3, 0.6]
    assert causes._either(Some(suspects=laws), found, 1) == ()
    alone = Some(accepted=(0,), rivals=((Replacement("a", 0, 1.0, forms[:1]),),))
    assert causes._either(Some(suspects=laws), alone, 0) == ()
    other = Some(accepted=(0,), rivals=((Replacement("b", 4, 1.0, forms),),))
    assert causes._either(Some(suspects=laws), other, 0) == ()


def test_a_state_costs_its_scatter_its_mistakes_and_its_laws():
    """20 pulls at twice the stated scatter; a reading of 5 sigma; a law of 6 sigma among others."""
    law = Some(effect=Some(law="any"), height=Some(value=-6e-3, std=1e-3), amplitudes=(1, 2))
    vague = Some(effect=Some(law="any"), height=None, amplitudes=(1,))
    plain = Some(effect=Some(law=None))
    end = Some(
        diagnosis=Some(scatter=Some(scale=2.0), causes=(plain, law, vague)),
        screened=Some(findings=(Some(before=5.0, axes=3),)),
        right=Some(data=Some(pulls=range(20))),
    )
    rare = 2 * np.log(1000 / converge.NAMELESS)
    expected = 40 * np.log(2) + 1 + float(cost(25.0, 3)) + float(cost(36.0, 2)) + rare
    expected += float(cost(1.0, 1)) + rare
    assert converge._cost(end) == pytest.approx(expected)
    end.diagnosis = Some(scatter=Some(scale=0.5), causes=())
    assert converge._cost(end) == pytest.approx(float(cost(25.0, 3)))
    assert converge._strange(Some(diagnosis=Some(causes=(plain, law)))) == [law]


def test_causes_help_unless_left_out_poses_are_predicted_worse():
    """With certainty where nothing but residuals tells the scatter."""
    facts = Facts(False, True)
    assert facts.helps
    assert replace(facts, gain=gained(0.1, -0.1)).helps
    assert not replace(facts, gain=gained(0.0, -0.1)).helps
    assert not replace(facts, gain=gained(0.1, -0.1), scatter_told=False).helps
    assert replace(facts, gain=gained(0.1, 0.01), scatter_told=False).helps
    assert not facts.hopeless
    assert replace(facts, mistakes=(Some(hopeless=False), Some(hopeless=True))).hopeless


def test_a_cause_of_the_table_is_stated_with_its_twins_and_rivals(monkeypatch):
    """Two are free; the second is as likely as its evidence, and that of a twin, say."""
    one, two, twin, rival, other = (named(label) for label in "abcde")
    evidence = {two: 3.0, twin: 2.0, rival: 2.5, other: -40.0}
    freed = []

    def unrefined(zeros, sums, free):
        freed.append((zeros, sums, free))
        return Some(evidence=lambda other: evidence[other])

    monkeypatch.setattr(unloaded_geometry, "products", lambda rows: f"sums of {rows}")
    monkeypatch.setattr(unloaded_geometry, "unrefined", unrefined)
    monkeypatch.setattr(unloaded_geometry, "same", lambda zeros, sums, a, b: b is twin)
    two.columns = (1,)
    search = Some(
        zeros="zeros", rows="rows", free=(one, two), asked=(one, two, twin, rival, other),
        found=Some(mean=np.array([7.0, 4e-3]), covariance=np.diag([1.0, 9e-8])),
        p_value=lambda asked: 1e-5 if asked is two else 1.0,
    )  # fmt: skip
    found = unloaded_geometry._off(search, 1)

    total = np.exp(3.0) + np.exp(2.0) + np.exp(2.5)
    assert freed == [("zeros", "sums of rows", (one,))]
    assert found.effect is two.effect
    assert (found.value.tolist(), found.std.tolist()) == ([4e-3], [3e-4])
    assert found.p_value == 1e-5
    assert found.probability == pytest.approx((np.exp(3.0) + np.exp(2.0)) / total)
    assert [each.effect for each in found.rivals] == [rival.effect]
    assert found.twins == (twin.effect,)


LEAST = unlisted.LEAST_EVIDENCE


@pytest.mark.parametrize(
    ("evidence", "p", "structure", "found", "beyond"),
    [
        ([9.0, 8.0], [1e-7, 2e-7], [1e-6, 1e-6], {"a": 1e-6, "b": 2e-6}, 1e-6),
        ([8.0, 9.0], [1e-7, 2e-7], [1e-6, 1e-6], {"b": 2e-6, "a": 1e-6}, 1e-6),
        ([9.0, LEAST - 0.1], [1e-7, 2e-7], [1e-6, 1e-6], {"a": 1e-6}, 1e-6),
        ([9.0, 8.0], [1e-7, 0.5], [1e-6, 1e-6], {"a": 1e-6}, 1e-6),
        ([9.0, 8.0], [1e-7, 2e-7], [0.2, 1e-5], {"b": 1e-5}, 1e-6),
        ([9.0, 8.0], [1e-7, 2e-7], [0.2, 0.3], {}, 1e-6),
        ([9.0, LEAST - 0.1], [0.5, 1e-7], [1e-6, 1e-6], {}, 1.0),
        ([9.0, 8.0], [0.3, 0.2], [1e-6, 1e-6], {}, 1.0),
        ([40.0, 40.1 - unlisted._WITHIN], [1e-7] * 2, [1e-7] * 2, {"a": 1e-6, "b": 1e-6}, 1e-6),
        ([40.0, 39.9 - unlisted._WITHIN], [1e-7] * 2, [1e-7] * 2, {"a": 1e-6}, 1e-6),
        ([], [], [], {}, 1.0),
    ],
)
def test_laws_are_likely_beyond_scatter_and_copies(
    monkeypatch, evidence, p, structure, found, beyond
):
    """Of two places, ten independent tries; the first is that of a cause that is held."""
    now = Some(log_evidence=np.array([99.0, *evidence]), p=lambda: np.array([1e-30, *p]), dof=50)
    view = Some(suspects="all", base="base", beside=lambda base: f"beside {base}")
    monkeypatch.setattr(unlisted, "_view", lambda *_: view)
    monkeypatch.setattr(unlisted, "statistics_given", lambda *_: now)
    monkeypatch.setattr(unlisted, "threshold", lambda *_: Some(independent=10.0))
    monkeypatch.setattr(unlisted, "_by_structure", lambda *_: np.array([0.0, *structure]))
    monkeypatch.setattr(unlisted.unlisted, "worded", lambda robot, law: law.label)
    laws = tuple(Some(label=label, law=None) for label in "ab"[: len(p)])
    told, least = unlisted._likely(
        Some(cell=Some(robot=None)), None, (4,), laws, np.random.default_rng(1)
    )

    assert list(told) == list(found)
    assert told == pytest.approx(found, rel=1e-4)
    assert least == pytest.approx(beyond, rel=1e-4)


def test_further_shapes_are_sought_of_accepted_laws_alone(monkeypatch):
    """Beside these laws; a cause of the catalogue may be what a law lacks."""
    suspects = (Law("a", None), Law("b", 1.0), Law("c", None), Law("d", 2.0))
    asked = Some(suspects=suspects, data=Some(pulls="pulls"), cell=Some(robot="robot"))
    model = Some(cell="cell", values="values")
    found = Some(accepted=(3, 0, 1), first=Some(model=model))
    monkeypatch.setattr(unlisted, "load", lambda *of: of)
    monkeypatch.setattr(
        unlisted.unlisted, "extensions", lambda robot, loaded, one: [(robot, loaded, one), one]
    )
    monkeypatch.setattr(unlisted, "_searched", lambda *of: of)
    *_, mine, every, start, rng = unlisted._extended(asked, found, "start", "rng")

    at = ("cell", "pulls", "values")
    assert mine == (3, 1)
    assert every == (
        ("robot", at, suspects[3]), suspects[3], ("robot", at, suspects[1]), suspects[1],
    )  # fmt: skip
    assert (start, rng) == ("start", "rng")


# --- what the diagnosis states --------------------------------------------------------------------


def test_a_misfit_is_held_against_the_scatter_that_contrasts_show():
    """P of F = 2 / 1.5^2 with 20 and 50 degrees of freedom; of chi-square where none shows it."""
    estimate = Some(p_value=1e-3, dof=20, chi2=40.0)
    seen = Some(known_from="contrasts", tracker=1.5, tracker_std=0.15)
    expected = stats.f.sf(2 / 2.25, 20, 50)
    assert diagnose._misfit(estimate, seen) == (1e-3, pytest.approx(expected))
    sure = Some(p_value=0.9, dof=20, chi2=40.0)
    assert diagnose._misfit(sure, seen) == (0.9, 0.9)
    for other in (
        diagnose._misfit(Some(p_value=1e-3, dof=0, chi2=0.0), seen),
        diagnose._misfit(estimate, Some(known_from="residuals")),
    ):
        assert other == (1e-3, 1e-3)
    one = Some(p_value=1e-3, dof=1, chi2=9.0)
    assert diagnose._misfit(one, seen)[1] == pytest.approx(stats.f.sf(4.0, 1, 50))
    assert diagnose._misfit(Some(p_value=None, dof=5), seen) == (None, 1.0)


def test_what_moves_between_poses_is_the_trackers_and_the_halls():
    """At right angles: 3 and 4 um."""
    wanders = Some(wanders=True, wander=Some(between_poses=3e-6))
    still = Some(wanders=False, wander=Some(between_poses=3e-6))
    grown = Some(deformed_m=4e-6)
    assert diagnose.between_poses(wanders, grown) == pytest.approx(5e-6)
    assert diagnose.between_poses(still, grown) == pytest.approx(4e-6)
    assert diagnose.between_poses(wanders, None) == pytest.approx(3e-6)
    assert diagnose.between_poses(None, None) == 0.0


def test_an_outbuilding_that_is_not_there_says_nothing(monkeypatch):
    """Else it is asked."""
    monkeypatch.setattr(diagnose.doors, "found", lambda door: None)
    assert diagnose._offered("door", "nothing", 1, 2) == "nothing"
    monkeypatch.setattr(diagnose.doors, "found", lambda door: lambda *of: (door, of))
    assert diagnose._offered("door", "nothing", 1, 2) == ("door", (1, 2))


def test_the_search_states_what_it_left(monkeypatch):
    """Settled where it explains all, or detected nothing; a ratio only of causes that help."""
    monkeypatch.setattr(diagnose, "suspect_statistics", lambda found: "clues")
    monkeypatch.setattr(diagnose, "misfits", lambda first: first.spread.sum())
    found = Some(
        refused=("a",), threshold=Some(p=1e-4), lack_first=Some(p_poses=0.1, p_pulls=0.2),
        lack=Some(p_poses=0.3, p_pulls=0.4), left=0.5, rough=1.5, seen="seen",
        first=Some(spread=np.array([3e-6, 4e-6])), explains=False, detected=True,
    )  # fmt: skip
    told = diagnose._of_search(found, False)
    assert told == {
        "refused": ("a",), "clues": "clues", "threshold": 1e-4, "lack_of_fit": (0.1, 0.2),
        "remainder": (0.3, 0.4, 0.5), "rough": None, "misfits": pytest.approx(7e-6),
        "noise_floor_m": pytest.approx(np.sqrt(12.5e-12)), "seen": "seen", "settled": False,
    }  # fmt: skip
    assert diagnose._of_search(found, True)["rough"] == 1.5
    found.explains = True
    assert diagnose._of_search(found, True)["settled"]
    found.explains = found.detected = False
    assert diagnose._of_search(found, True)["settled"]


@pytest.mark.parametrize(
    ("estimated", "wrong", "doubted", "beside"),
    [
        ("richer", 0, 0, ("richer", "values")),
        ("richer", 1, 0, ("richer", "values")),
        ("other", 1, 0, ("springs", "nominal")),
        (None, 0, 1, ("springs", "nominal")),
        (None, 0, 0, None),
        ("other", 0, 0, None),
    ],
)
def test_readings_are_screened_beside_the_causes_that_were_estimated(
    monkeypatch, estimated, wrong, doubted, beside
):
    """Else beside the springs of the file; not again where nothing was wrong beside these."""
    richer = Some(name="richer", parameters="richer")
    springs = Some(name="springs", with_effects=lambda *effects: richer)
    files = Some(case=Some(cell=springs, robot=Some(nominal_compliance="nominal")))
    estimate = None if estimated is None else Some(parameters=estimated, value="values")
    held = Some(findings=(1,) * wrong, doubted=(1,) * doubted)
    said = Some(modelled=("a", "b"), estimate=estimate, seen=Some(suspects="laws"))
    monkeypatch.setattr(converge, "_tails", lambda files, end: "family")
    monkeypatch.setattr(converge, "ScreeningBase", lambda *of: of)
    monkeypatch.setattr(converge, "files_beside", lambda *of: of)
    monkeypatch.setattr(converge, "singles_of", lambda *of: of)
    found = converge._screened("case", files, Some(diagnosis=said, screened=held))

    if beside is None:
        assert found is held
        return
    (case, of, base), none, again = found
    assert (case, of, none, base) == ("case", files, None, again)
    assert (base[0].name, *base[1:]) == (*beside, "family", "laws")
