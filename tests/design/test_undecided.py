"""What is still open: who could stand in a place, with which odds, and what is left out."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.design import undecided
from pipeline.design.undecided import _open, _standing_there, next_poses
from pipeline.diagnosis.cause_search import NamelessReplacement, Replacement
from pipeline.diagnosis.isolability import Twins
from pipeline.diagnosis.verdict import CERTAIN

NONE = Twins((), (), ())


def rival(label, suspect, probability):
    return Replacement(label, suspect, probability)


def found(*rivals, accepted=None, strange=()):
    """A search whose accepted causes are the first of each place."""
    accepted = accepted or tuple(place[0].suspect for place in rivals)
    return SimpleNamespace(accepted=accepted, rivals=rivals, strange=strange, wide="wide")


def cause(label, probability, twins=()):
    return SimpleNamespace(
        effect=SimpleNamespace(label=label), probability=probability, twins=twins
    )


def gain(low):
    return SimpleNamespace(ci95=(low, 0.9))


def test_rivals_of_two_hundredths_stand_beside_the_accepted_one():
    """The four likeliest of them, each with its probability; the rest is ignored."""
    others = [rival(f"r{k}", k, p) for k, p in enumerate((0.2, 0.1, 0.021, 0.019), 1)]
    few = found((rival("a", 0, 0.6), *others))
    assert _standing_there(few, 0, cause("a", 0.6), NONE) == {0: 0.6, 1: 0.2, 2: 0.1, 3: 0.021}

    others = [rival(f"r{k}", k, 0.1) for k in range(1, 7)]
    many = found((rival("a", 0, 0.4), *others))
    assert list(_standing_there(many, 0, cause("a", 0.4), NONE)) == [0, 1, 2, 3, 4]


def test_a_cause_that_is_certain_has_no_rivals():
    """At 95 % and above nothing is asked."""
    few = found((rival("a", 0, CERTAIN), rival("b", 1, 1 - CERTAIN)))

    assert _standing_there(few, 0, cause("a", CERTAIN), NONE) == {0: CERTAIN}
    assert list(_standing_there(few, 0, cause("a", CERTAIN - 1e-6), NONE)) == [0, 1]


def test_twins_count_as_one():
    """No pull tells them apart: their odds are added, and neither is the other's rival."""
    place = (rival("a", 0, 0.4), rival("twin", 1, 0.35), rival("b", 2, 0.25))
    known = Twins((), (("twin", "a"), ("b", "x")), ())

    assert _standing_there(found(place), 0, cause("a", 0.4), known) == {
        0: pytest.approx(0.75),
        2: 0.25,
    }


def test_what_has_no_name_takes_its_part_of_the_odds():
    """Where it is likelier than one in twenty; the others share the rest."""
    place = (rival("a", 0, 0.7), rival("b", 1, 0.3))
    for share, there in ((0.4, True), (0.05, False), (0.06, True)):
        odds = _standing_there(
            found(place, strange=(NamelessReplacement(share, 9),)), 0, cause("a", 0.7), NONE
        )
        rest = 1 - share if there else 1.0
        expected = {0: 0.7 * rest, 1: 0.3 * rest} | ({9: share} if there else {})
        assert odds == pytest.approx(expected)


def test_each_place_asks_with_the_other_causes_taken_for_granted():
    """A question for a place that is open, none for one that is not."""
    places = (
        (rival("a", 3, 0.6), rival("b", 1, 0.4)),
        (rival("c", 5, 0.99), rival("d", 2, 0.01)),
        (rival("e", 7, 0.5), rival("f", 8, 0.5)),
    )
    causes = (cause("a", 0.6), cause("c", 0.99), cause("e", 0.5))

    first, second = _open(found(*places), causes, gain(0.1), NONE)

    assert (first.who, first.odds, first.rest) == ((3, 1), (0.6, 0.4), (5, 7))
    assert (second.who, second.odds, second.rest) == ((7, 8), (0.5, 0.5), (3, 5))


def test_where_only_the_worth_is_open_causes_are_held_against_the_springs_alone():
    """A gain that may be nothing; a cause with a twin is not asked about."""
    places = ((rival("a", 3, 0.99),), (rival("c", 5, 0.98),))
    certain = (cause("a", 0.99), cause("c", 0.98, twins=("d",)))

    (one,) = _open(found(*places), certain, gain(-0.1), NONE)

    assert (one.who, one.odds, one.rest) == ((3, None), (0.5, 0.5), (5,))
    assert _open(found(*places), certain, gain(0.01), NONE) == []
    assert len(_open(found(*places), certain, gain(0.0), NONE)) == 1
    assert _open(found(*places), certain, None, NONE) == []


def test_nothing_is_proposed_where_nothing_is_open_or_reachable(monkeypatch):
    """No poses are drawn in vain, and a robot that reaches none gets no proposal."""
    drawn = []

    def candidates(case, rng):
        drawn.append(case)
        if case == "stuck":
            raise InputError("no pose", "make room")
        return SimpleNamespace(anchor=[] if case == "walled" else ["among"])

    monkeypatch.setattr(undecided, "candidates", candidates)
    monkeypatch.setattr(undecided, "propose", lambda *args: [args])
    rng = np.random.default_rng(1)
    open_ = found((rival("a", 3, 0.6), rival("b", 1, 0.4)))
    shut = found((rival("a", 3, 0.99),))

    assert next_poses("case", shut, (cause("a", 0.99),), gain(0.1), NONE, rng) == ()
    assert drawn == []
    assert next_poses("stuck", open_, (cause("a", 0.6),), None, NONE, rng) == ()
    assert next_poses("walled", open_, (cause("a", 0.6),), None, NONE, rng) == ()
    ((view, questions, among),) = next_poses("case", open_, (cause("a", 0.6),), None, NONE, rng)
    assert (view, among.anchor) == ("wide", ["among"])
    assert [one.who for one in questions] == [(3, 1)]
