"""The order of screening: whole files once, then the first finding of the first test, repeated."""

from collections import Counter
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_case import screen, small

from pipeline.faults import fault as fault_module
from pipeline.faults import screen as module
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.screen import Screened, ScreeningBase, files_beside, singles_of
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring


@dataclass(frozen=True)
class Bench:
    """A campaign of which only the remaining mistakes are known."""

    wrong: tuple[str, ...]
    settings: object = field(default_factory=lambda: SimpleNamespace(displacements=None))
    robot: object = field(
        default_factory=lambda: SimpleNamespace(nominal_compliance=np.ones(2), n=2)
    )
    anchors: dict = field(default_factory=dict)
    anchors_read: dict = field(default_factory=dict)
    cell: object = field(default_factory=lambda: Cell())

    @property
    def readings(self):
        """A zero, a pull and a base round."""
        return pd.DataFrame({
            "group": ["pose4_rep0", "pose4_rep2", "base"], "pose": [4, 4, None],
            "state": ["unloaded", "loaded", "base"], "repeat": [0, 2, 0],
        })  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """A model of which only the causes are known."""

    causes: tuple[str, ...] = ()

    def with_effects(self, *more):
        """The model with further causes."""
        return Cell((*self.causes, *more))

    @property
    def parameters(self):
        """One for the springs, one for each cause."""
        return ("spring", *self.causes)


def mistake(name):
    return Mistake(
        name=name, where=name, evidence="", correction="", before=2.0, after=1.0, unit="1",
        correct=lambda case: replace(case, wrong=tuple(w for w in case.wrong if w != name)),
    )  # fmt: skip


def determined_if(monkeypatch, enough):
    """Let what a campaign is reduced to determine something where `enough` of it holds."""

    def bring(case):
        return SimpleNamespace(data=SimpleNamespace(enough=lambda _: enough(case)))

    monkeypatch.setattr(module, "bring", bring)


@pytest.fixture
def tests(monkeypatch):
    """Replace the real tests; each finds the mistakes of its letter."""
    calls = []
    monkeypatch.setattr(module, "lock_lost", lambda one, _: one)
    determined_if(monkeypatch, lambda _: True)
    monkeypatch.setattr(module, "misfit", lambda _: np.nan)

    def put(*letters, **more):
        def make(letter):
            def find(asked):
                calls.append((letter, asked))
                found = [w for w in asked.case.wrong if w[0] == letter.lower()]
                return [mistake(w) for w in found[: more.get("at_once", 1)]]

            return Fault(
                letter, find,
                in_files=letter.isupper(),
                in_forces=letter in more.get("forces", ""),
            )  # fmt: skip

        monkeypatch.setattr(module, "FAULTS", tuple(make(letter) for letter in letters))
        return calls

    return put


def names(screened):
    return [found.name for found in screened.findings]


def test_a_clean_campaign_is_given_back_itself(tests):
    """Every test runs once, with the given measurements."""
    calls, case, reduced = tests("F", "a", "b"), Bench(()), object()

    got = screen(case, reduced)

    assert got.case is case
    assert got.findings == ()
    assert [letter for letter, _ in calls] == ["F", "a", "b"]
    assert [asked.known for letter, asked in calls if letter != "F"] == [reduced, reduced]


def test_whole_files_come_first_and_once(tests):
    """All findings of such a test are corrected before the next, and it does not run again."""
    calls = tests("b", "F", "G", at_once=2)

    got = screen(Bench(("b1", "g1", "f1", "f2", "f3")), object())

    assert names(got) == ["f1", "f2", "g1", "b1"]
    assert Counter(letter for letter, _ in calls)["F"] == 1
    assert got.case.wrong == ("f3",)
    seen = [asked.case.wrong for letter, asked in calls if letter == "G"]
    assert seen == [("b1", "g1", "f3")]


def test_after_each_finding_the_grossest_test_is_asked_first(tests):
    """The first finding of one test; then all tests again, on new measurements."""
    calls, reduced = tests("a", "b"), object()

    got = screen(Bench(("b1", "a1", "b2", "a2")), reduced)

    assert names(got) == ["a1", "a2", "b1", "b2"]
    assert got.case.wrong == ()
    assert [letter for letter, _ in calls] == ["a", "a", "a", "b", "a", "b", "a", "b"]
    assert [asked.known is reduced for _, asked in calls] == [True] + [False] * 7


def test_a_mistake_that_would_leave_nothing_stays_and_is_said_to(tests, monkeypatch):
    """The campaign unchanged, with a finding that nothing corrects; no test repeats for ever."""
    calls = tests("F", "a")
    determined_if(monkeypatch, lambda case: len(case.wrong) > 0)

    got = screen(Bench(("a1",)), object())

    assert names(got) == ["a1"]
    assert got.findings[0].hopeless
    assert got.case.wrong == ("a1",)
    assert len(calls) == 2


def test_it_stops_where_something_new_is_found_for_ever(tests):
    """After forty rounds of mistakes it stops, with the findings so far."""
    tests("a")

    got = screen(Bench(tuple(f"a{k}" for k in range(60))), object())

    assert names(got) == [f"a{k}" for k in range(40)]


def test_a_campaign_that_arrives_reduced_is_asked_about_forces_only(tests):
    """Tests that read files or readings have no input."""
    calls = tests("F", "a", "b", forces="b")
    case = replace(Bench(("a1", "b1", "f1")), settings=SimpleNamespace(displacements="table"))

    got = screen(case, object())

    assert names(got) == ["b1"]
    assert {letter for letter, _ in calls} == {"b"}


def test_single_readings_are_tested_beside_what_is_held(tests):
    """The causes, their estimate and the tails; corrections of whole files stay."""
    calls, family = tests("F", "a"), object()
    case = Bench(("a1", "a2"))
    beside = ScreeningBase(case.cell.with_effects("tilt"), np.arange(2.0), family)

    got = singles_of(Screened((mistake("f1"),), case), None, beside)

    assert names(got) == ["f1", "a1", "a2"]
    assert got.case.wrong == ()
    assert {letter for letter, _ in calls} == {"a"}
    for _, asked in calls:
        assert asked.cell.causes == ("tilt",)
        assert asked.start.tolist() == [0.0, 1.0]
        assert asked.accepted is family
    assert calls[0][1].known is None


def test_what_was_found_has_a_key_whatever_the_order():
    """Two results are equal if the same mistakes are held."""
    one, other = mistake("a"), mistake("b")

    assert Screened((one, other), None).key == Screened((other, one), None).key
    assert Screened((one,), None).key != Screened((other,), None).key


def test_readings_that_noise_may_have_moved_are_given_back():
    """A pull stays rejected; for a reading the tails decide."""
    told = {"name": "outlier", "unit": "sigma", "size_unit": "m", "p_value": 1e-6}
    found = mistake("pull"), replace(mistake("reading"), **told)
    files = Screened((), Bench(("pull", "reading")))

    assert Screened(found, None).without_doubt(files).wrong == ("reading",)


def test_files_that_are_put_right_are_not_put_right_again():
    """Exchanged twice, rows would be where they were."""
    swap = replace(mistake("swap"), correct=lambda case: replace(case, wrong=case.wrong[::-1]))
    files = Screened((swap,), Bench(("a", "b")))

    assert Screened((swap, mistake("b")), None).without_doubt(files).wrong == ("a",)
    assert Screened((swap,), None).without_doubt(files).wrong == ("a", "b")


class Tails:
    """A family with this certainty for any blunder, that records its arguments."""

    def __init__(self, sure):
        self.sure, self.seen, self.states, self.near = sure, [], [], []

    @property
    def rather(self):
        """It is what it is."""
        return self

    def mistaken(self, square, axes, state, near):
        """The given certainty; arguments are recorded."""
        self.seen.append((square, axes))
        self.states.append(state)
        self.near.append(near)
        return self.sure


def doubtful(monkeypatch, **known):
    """The one test finds readings that noise may have moved."""
    (fault,) = module.FAULTS
    told = {"name": "outlier", "unit": "sigma", "size_unit": "m", "p_value": 1e-6} | known

    def found(asked):
        return [replace(one, **told, where=one.where) for one in fault.find(asked)]

    monkeypatch.setattr(module, "FAULTS", (replace(fault, find=found),))


def test_evidence_along_one_axis_is_weighed_along_one(tests, monkeypatch):
    """By chance three coordinates are often off by this much, one coordinate rarely."""
    tests("a")
    doubtful(monkeypatch, before=6.0, axes=1)
    tails, case = Tails(0.5), Bench(("a1",))
    files = Screened((), case)

    assert singles_of(files, None, ScreeningBase(case.cell, np.ones(2), tails)).findings == ()
    assert tails.seen == [(36.0, 1)]


@pytest.mark.parametrize(
    ("where", "state"),
    [("pose4_rep0/P1", (4, -1)), ("pose4_rep2/P1", (4, 2)), ("base/B1", None)],
)
def test_a_reading_is_judged_in_its_state(where, state):
    """Pose and pull, -1 for a zero; one of the base is of no pose."""
    tails, one = Tails(0.5), replace(mistake("a1"), name="outlier", where=where, unit="sigma")
    one = replace(one, size=1e-3, size_unit="m", p_value=1e-6, near=((4.0, 3.0),))

    assert not Screening(Bench(()), Cell(), np.ones(1), accepted=tails).sure(one)
    assert tails.states == [state]
    assert tails.near == [one.near]


@pytest.mark.parametrize("sure", [0.95, 0.5])
def test_a_reading_is_judged_by_the_tails_that_all_readings_show(tests, monkeypatch, sure):
    """A doubtful one stays in use, and is listed apart from those that were not questioned."""
    tests("a")
    doubtful(monkeypatch)
    case = Bench(("a1",))

    got = singles_of(Screened((), case), None, ScreeningBase(case.cell, np.ones(2), Tails(sure)))

    assert [one.where for one in got.findings] == (["a1"] if sure > 0.9 else [])
    assert [one.where for one in got.doubted] == ([] if sure > 0.9 else ["a1"])
    assert got.case.wrong == (() if sure > 0.9 else ("a1",))


def test_tails_are_those_before_anything_was_taken_out(tests, monkeypatch):
    """Tails reduced by each reading taken as a blunder would soon disappear."""
    calls = tests("a")
    doubtful(monkeypatch)
    monkeypatch.setattr(
        Screening, "family", property(lambda s: s.accepted or Tails(0.91 if s.known else 0.0))
    )

    got = screen(Bench(("a1", "a2", "a3")), object())

    assert [one.where for one in got.findings] == ["a1", "a2", "a3"]
    assert [asked.accepted is None for _, asked in calls] == [True, False, False, False]


def test_a_screening_computes_what_is_asked_once(monkeypatch):
    """Given measurements are used; otherwise the case is reduced, once for all tests."""
    case, count = small(2), Counter()
    for name in ("bring", "identify", "repeated_zeros", "noise_scale"):
        plain = getattr(fault_module, name)

        def counted(*args, name=name, plain=plain):
            count[name] += 1
            return plain(*args)

        monkeypatch.setattr(fault_module, name, counted)

    asked = Screening(case, case.cell, case.robot.nominal_compliance)
    assert not count
    for _ in range(2):
        assert asked.spread[1] == 54
        assert len(asked.zeros.pose) == 18
        assert asked.system.B.shape == (36 * 3, 7)
        assert len(asked.estimate.value) == 7

    assert count == {"bring": 1, "identify": 1, "repeated_zeros": 1, "noise_scale": 1}
    assert Screening(case, case.cell, asked.start, asked.reduced).reduced is asked.reduced
    assert count["bring"] == 1


@pytest.mark.parametrize("true", [True, False])
def test_rows_exchanged_in_the_files_are_judged_again_beside_causes(true):
    """Two forces that the files' tests exchanged: they stay so only if the readings say so."""
    given = small()
    row, other = given.loads.index[[2, 7]]

    def exchanged(case):
        force = case.loads["force_n"].copy()
        force[[row, other]] = force[[other, row]].to_numpy()
        return replace(case, loads=case.loads.assign(force_n=force))

    case = exchanged(given) if true else given
    one = replace(mistake("swap"), correct=exchanged, places=1)
    files = Screened((one,), exchanged(case))
    law = next(
        law
        for law in catalogue(case.robot, bring(case).data.pulls)
        if law.label == "joint_hardening:2"
    )
    springs = case.robot.nominal_compliance
    start = np.append(springs, np.zeros(len(law.parameters)))
    base = ScreeningBase(case.cell.with_effects(law), start, None, (law,))

    for beside in base, ScreeningBase(case.cell, springs):
        assert names(files_beside(case, files, beside)) == (["swap"] if true else [])
    if true:  # among so many places that chance alone finds one as good, it counts for nothing
        asked = (Screening(each, case.cell, springs) for each in (case, files.case))
        without, loss = (each.loss[1] for each in asked)
        odds = np.exp((without - loss) / 2)
        for share, held in (0.9e-2, ["swap"]), (1.1e-2, []):
            many = Screened((replace(one, places=share * odds),), files.case)
            assert names(files_beside(case, many, ScreeningBase(case.cell, springs))) == held
