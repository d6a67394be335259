"""The order of screening: whole files once, then the first finding of the first test, again."""

from collections import Counter
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_case import small

from pipeline.faults import fault as fault_module
from pipeline.faults import screen as module
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.screen import Screened, confirm, screen, screen_again


@dataclass(frozen=True)
class Bench:
    """A campaign of which is only known which mistakes are still in it."""

    wrong: tuple[str, ...]
    settings: object = field(default_factory=lambda: SimpleNamespace(displacements=None))
    robot: object = field(default_factory=lambda: SimpleNamespace(nominal_compliance=np.ones(2)))
    cell: object = field(default_factory=lambda: Cell())


@dataclass(frozen=True)
class Cell:
    """A model that knows its causes only."""

    causes: tuple[str, ...] = ()

    def with_effects(self, *more):
        """The model with further causes."""
        return Cell((*self.causes, *more))

    @property
    def parameters(self):
        """One for the springs, one for each cause."""
        return ("spring", *self.causes)


def mistake(name, beside_model=False):
    return Mistake(
        name=name, where=name, evidence="", correction="", before=2.0, after=1.0, unit="1",
        beside_model=beside_model,
        correct=lambda case: replace(case, wrong=tuple(w for w in case.wrong if w != name)),
    )  # fmt: skip


@pytest.fixture
def tests(monkeypatch):
    """Puts tests in place of the real ones; each finds the mistakes of its letter."""
    calls = []

    def put(*letters, **more):
        def make(letter):
            def find(asked):
                calls.append((letter, asked))
                found = [w for w in asked.case.wrong if w[0] == letter.lower()]
                beside = more.get("beside", "")
                return [mistake(w, w[0] in beside) for w in found[: more.get("at_once", 1)]]

            return Fault(
                letter, letter, find,
                in_files=letter.isupper(),
                in_forces=letter in more.get("forces", ""),
                beside_model=letter in more.get("beside", ""),
            )  # fmt: skip

        monkeypatch.setattr(module, "FAULTS", tuple(make(letter) for letter in letters))
        return calls

    return put


def names(screened):
    return [found.name for found in screened.findings]


def test_a_clean_campaign_is_given_back_itself(tests):
    """Every test is asked once, with the measurements that are at hand."""
    calls, case, reduced = tests("F", "a", "b"), Bench(()), object()

    got = screen(case, reduced)

    assert got.case is case
    assert got.findings == ()
    assert [letter for letter, _ in calls] == ["F", "a", "b"]
    assert [asked.known for letter, asked in calls if letter != "F"] == [reduced, reduced]


def test_whole_files_come_first_and_once(tests):
    """All findings of such a test are put right before the next, and it is not asked again."""
    calls = tests("b", "F", "G", at_once=2)

    got = screen(Bench(("b1", "g1", "f1", "f2", "f3")), object())

    assert names(got) == ["f1", "f2", "g1", "b1"]
    assert Counter(letter for letter, _ in calls)["F"] == 1
    assert got.case.wrong == ("f3",)
    seen = [asked.case.wrong for letter, asked in calls if letter == "G"]
    assert seen == [("b1", "g1", "f3")]


def test_after_each_finding_the_grossest_test_is_asked_first(tests):
    """Of one test what it finds first; then all over again, on measurements made anew."""
    calls, reduced = tests("a", "b"), object()

    got = screen(Bench(("b1", "a1", "b2", "a2")), reduced)

    assert names(got) == ["a1", "a2", "b1", "b2"]
    assert got.case.wrong == ()
    assert [letter for letter, _ in calls] == ["a", "a", "a", "b", "a", "b", "a", "b"]
    assert [asked.known is reduced for _, asked in calls] == [True] + [False] * 7


def test_with_more_than_a_dozen_it_stops(tests):
    """The campaign as a whole is wrong."""
    tests("a")

    got = screen(Bench(tuple(f"a{k}" for k in range(20))), object())

    assert names(got) == [f"a{k}" for k in range(12)]


def test_a_campaign_that_arrives_reduced_is_asked_about_forces_only(tests):
    """Tests that read files or readings have nothing to read."""
    calls = tests("F", "a", "b", forces="b")
    case = replace(Bench(("a1", "b1", "f1")), settings=SimpleNamespace(displacements="table"))

    got = screen(case, object())

    assert names(got) == ["b1"]
    assert {letter for letter, _ in calls} == {"b"}


def again(case, findings, causes, parameters=None):
    """Screened again beside causes that were estimated with these parameters."""
    right = case
    for one in findings:
        right = one.correct(right)
    screened = Screened(tuple(findings), right)
    parameters = ("spring", *causes) if parameters is None else parameters
    extended = SimpleNamespace(parameters=parameters, value=np.arange(2.0))
    return screened, screen_again(case, screened, causes, extended)


def test_what_a_cause_explains_is_taken_back(tests):
    """Only tests beside the model are asked again, with the causes, and gross mistakes stay."""
    calls = tests("a", "b", beside="b")
    case = Bench(("a1", "b1"))
    flagged = [mistake("a1"), mistake("x1", True), mistake("b1", True)]

    _, got = again(case, flagged, ("tilt",))

    assert names(got) == ["a1", "b1"]
    assert got.case.wrong == ()
    assert {letter for letter, _ in calls} == {"b"}
    first = calls[0][1]
    assert first.cell.causes == ("tilt",)
    assert first.case.wrong == ("b1",)
    assert first.start.tolist() == [0.0, 1.0]
    assert first.known is None


def test_what_stays_flagged_stays_as_it_was(tests):
    """The same object comes back, with nothing asked where nothing could be taken back."""
    calls = tests("b", beside="b")
    case = Bench(("b1",))

    screened, got = again(case, [mistake("b1", True)], ("tilt",))
    assert got is screened
    assert len(calls) == 1
    for findings, causes, parameters in (
        ([mistake("a1")], ("tilt",), None),
        ([mistake("x1", True)], (), None),
        ([mistake("x1", True)], ("tilt",), ("spring",)),
    ):
        screened, got = again(case, findings, causes, parameters)
        assert got is screened
    lost = screen_again(case, screened, ("tilt",), None)
    assert lost is screened
    assert len(calls) == 1


def test_never_more_is_flagged_again_than_was_before(tests):
    """One was flagged beside the model: at most one is, though more could be found."""
    calls = tests("b", beside="b")

    screened, got = again(Bench(("b1", "b2", "b3")), [mistake("x1", True)], ("tilt",))

    assert len(calls) == 1
    assert got is screened


def test_evidence_along_one_axis_is_weighed_along_one(tests, monkeypatch):
    """Chance rarely has one coordinate off by as much as it often has three."""
    seen = []
    monkeypatch.setattr(
        Screening, "mistaken", lambda _, square, axes: seen.append((square, axes)) or 0.5
    )
    sure = {"name": "outlier", "unit": "sigma", "size_unit": "m", "p_value": 1e-6, "before": 6.0}
    tests("a")
    (fault,) = module.FAULTS

    def found(asked):
        return [replace(one, **sure, where=one.where, axes=1) for one in fault.find(asked)]

    monkeypatch.setattr(module, "FAULTS", (replace(fault, find=found),))

    assert screen(Bench(("a1",)), object()).findings == ()
    assert seen == [(36.0, 1)]


@pytest.mark.parametrize("beside", [0.95, 0.5])
@pytest.mark.parametrize("causes", [(), ("tilt",)])
def test_a_doubted_reading_is_tested_by_the_noise_beside_the_accepted_model(
    tests, monkeypatch, beside, causes
):
    """Tails that are hardly seen keep it; seen better they may not, beside springs and causes."""
    tests("a")
    (fault,) = module.FAULTS
    asked = []

    def found(now):
        asked.append(now)
        told = {"name": "outlier", "unit": "sigma", "size_unit": "m", "p_value": 1e-6}
        return [replace(one, **told, where=one.where) for one in fault.find(now)]

    @dataclass(frozen=True)
    class Tails:
        sure: float
        likely_heavy: bool = False

        def mistaken(self, square, axes):
            return self.sure

    monkeypatch.setattr(Screening, "family", property(lambda s: s.accepted or Tails(0.6)))
    monkeypatch.setattr(module, "FAULTS", (replace(fault, find=found),))
    monkeypatch.setattr(module, "lock_lost", lambda one, _: one)
    case = Bench(("a1",))
    extended = SimpleNamespace(value=np.arange(2.0), parameters=("spring", *causes))

    screened = screen(case, object())
    judged = confirm(screened, Tails(beside), causes, extended if causes else None)

    assert screened.findings == ()
    assert [one.where for one in screened.doubted] == ["a1"]
    assert asked[-1].cell.causes == causes
    assert (judged is screened) is (beside == 0.5)
    assert judged.case.wrong == (("a1",) if beside == 0.5 else ())
    assert confirm(replace(screened, doubted=()), Tails(beside), (), None).findings == ()
    assert confirm(screened, Tails(0.99, likely_heavy=True), (), None) is screened


def test_a_screening_computes_what_is_asked_once(monkeypatch):
    """Measurements at hand are used; else the case is reduced, once for all that ask."""
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
