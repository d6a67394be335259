"""A spoilt campaign is read as it was, answered with a word, or rejected in a sentence."""

from dataclasses import replace
from pathlib import Path

import hostile_cases
import pytest

from bench.exam import JSON, Kept
from bench.fuzz import judge, run
from bench.fuzz.bases import NAMES, base
from bench.fuzz.catalogue import FAMILIES, MUTATIONS, Case, case
from bench.fuzz.judge import GOOD, clean
from bench.fuzz.mutation import Mutation
from bench.fuzz.play import ANSWER, SCREENED, Played, Reported, play
from bench.fuzz.run import contest, played
from bench.fuzz.table import summary

SCREENINGS = (
    0,
    4,
    5,
    7,
    12,
    13,
    16,
    17,
    19,
    20,
    21,
    22,
    23,
    24,
    26,
    27,
    29,
    30,
    31,
    32,
    34,
    35,
    436,
    462,
    493,
    513,
    479,
    529,
    573,
    699,
)
"""Fixed cases, the first that are quick; two in every run of the tests, all in the slow."""

ANSWERS = (322, 400, 403, 404)
"""The same, to the answer."""

RESULTS = Path(__file__).parents[2] / "build" / "fuzz.jsonl"
"""Where the slow ones keep what is done: the next run goes on from there."""


def bad(rows):
    """What must not be, for whoever reads the failure."""
    wrong = [row for row in rows if row["outcome"] not in GOOD]
    return "\n".join(summary(wrong)) if wrong else ""


# --- the pipeline --------------------------------------------------------------------------------


@pytest.mark.whole
@pytest.mark.parametrize(
    ("screenings", "answers"),
    [(SCREENINGS[::15], ANSWERS[:1]), pytest.param(SCREENINGS, ANSWERS, marks=pytest.mark.slow)],
    ids=["two", "all"],
)
def test_spoilt_campaigns_end_well(screenings, answers):
    """No exception, no hang, no number that is none, no other answer without a word."""
    asked = [(n, SCREENED) for n in screenings] + [(n, ANSWER) for n in answers]
    rows = list(played(asked))

    assert [(row["case"], row["to"]) for row in rows] == asked
    assert not bad(rows)


@pytest.mark.slow
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize(("to", "count"), [(SCREENED, 20_000), (ANSWER, 1_000)])
def test_very_many_spoilt_campaigns_end_well(to, count):
    """The same of thousands; what is done is kept for the next run."""
    rows = contest(range(count), to, RESULTS, jobs=2)

    assert len(rows) == count
    assert not bad(rows)


# --- the fuzzer ----------------------------------------------------------------------------------


def test_a_case_is_a_function_of_its_number():
    """Whoever has the number has the files."""
    for number in range(40):
        one, other = case(number), case(number)

        assert dict(one.files) == dict(other.files)
        assert [m.name for m in one.mutations] == [m.name for m in other.mutations]


def test_every_case_spoils_something():
    """Between one and three mutations, each of which changed a byte, and of every family one."""
    cases = [case(number) for number in range(600)]

    assert all(1 <= len(one.mutations) <= 3 for one in cases)
    assert all(dict(one.files) != dict(base(one.base)) for one in cases if len(one.mutations) == 1)
    assert {m.family for one in cases for m in one.mutations} == set(FAMILIES)
    assert {one.base for one in cases} == set(NAMES)


def test_mutations_have_names_of_their_own():
    """So that a row of the results says what was done."""
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS)


def test_a_finished_case_is_not_played_again(tmp_path, monkeypatch):
    """Rows of the same code count; a line that was cut off and rows of other code do not."""
    results = tmp_path / "results.jsonl"
    for number, code in ((0, run.code()), (1, "other")):
        row = {"case": number, "to": SCREENED, "outcome": "same"}
        Kept(results, code, JSON).add(f"{SCREENED}-{number}", row)
    results.write_text(results.read_text() + '{"case": 2, "to"')
    asked = []
    monkeypatch.setattr(
        run,
        "played",
        lambda left, jobs, seconds: (
            asked.append(n) or {"case": n, "to": to, "outcome": "said"} for n, to in left
        ),
    )

    rows = contest(range(3), SCREENED, results)

    assert asked == [1, 2]
    assert [row["outcome"] for row in rows] == ["same", "said", "said"]


# --- the judge -----------------------------------------------------------------------------------

NOTHING = Mutation("nothing:", lambda files, rng: files)


def made(name="reduced", mutation=NOTHING, files=None):
    """A case of one mutation."""
    return Case(0, name, (mutation,), files or base(name))


def answered_as(said, **others):
    """What came of a case that says this."""
    return judge.judge(made(), Played(reported=said, **others))


@pytest.fixture(scope="module")
def before():
    """What is said of the clean campaign."""
    return clean("reduced", ANSWER)


def softer(said, factor=1.3, joint=1):
    """The same with one joint's compliance multiplied."""
    values = list(said.compliance)
    values[joint] *= factor
    return replace(said, compliance=tuple(values))


@pytest.mark.whole
def test_an_unchanged_answer_is_the_same(before):
    """Nothing to complain about."""
    assert answered_as(before).word == "same"


@pytest.mark.whole
def test_a_silent_change_is_reported(before):
    """Another stiffness without a word; with one it is well, or where it is meant."""
    assert answered_as(softer(before)).word == "silent"
    assert "compliance 2" in answered_as(softer(before)).why
    assert answered_as(replace(softer(before), words={"mistake outlier"})).word == "said"
    assert answered_as(replace(softer(before), rejected=1)).word == "said"
    meant = Mutation("key:model.equilibrium", NOTHING.act, meant="the user's choice")
    assert judge.judge(made(mutation=meant), Played(reported=softer(before))).word == "meant"


@pytest.mark.whole
def test_another_answer_that_is_said_to_hold_misleads(before):
    """A mistake is named and corrected, and the stiffness is another all the same."""
    told = replace(softer(before), words={"mistake outlier"}, verdict="bad_data")

    assert answered_as(replace(told, reason="mistake")).word == "misled"
    assert answered_as(replace(told, reason="mistake_and_unexplained")).word == "said"


@pytest.mark.whole
def test_one_factor_on_all_forces_misleads_nobody_who_is_told(before):
    """That all stiffnesses are twice the file's is said beside a joint's zero that is explained."""
    half = [None if c is None else c / 2 for c in before.compliance]
    said = replace(before, compliance=tuple(half), words={"cause"}, verdict="explained")

    assert answered_as(replace(said, factor=True)).word == "said"
    assert answered_as(said).word == "misled"
    assert answered_as(replace(softer(said), factor=True)).word == "misled"


@pytest.mark.whole
def test_a_blind_spot_covers_only_its_own_mutation(before):
    """A change that a listed blind spot owns up to is said; without the listing it is not."""
    off = Mutation("points:", NOTHING.act, covered=("load_point_offset",))
    listed = replace(softer(before), blind={"load_point_offset"})
    unlisted = replace(softer(before), blind=set())

    assert judge.judge(made(mutation=off), Played(reported=listed)).word == "said"
    assert judge.judge(made(mutation=off), Played(reported=unlisted)).word == "silent"


@pytest.mark.whole
def test_one_small_factor_on_all_forces_is_nobodys_to_see(before):
    """All stiffnesses together by 1.2 pass, by 2 they do not."""

    def together(factor):
        values = tuple(factor * value for value in before.compliance)
        return replace(before, compliance=values)

    assert answered_as(together(1.2)).word == "same"
    assert answered_as(together(2.0)).word == "silent"


@pytest.mark.whole
def test_a_number_that_is_none_is_reported(before):
    """In result.json or in a promised column, but not in one that says so."""
    assert answered_as(before, not_finite=("result.json.fit.chi2",)).word == "not finite"
    assert answered_as(replace(before, not_finite=["22_forces.fx_n"])).word == "not finite"


def test_an_exception_is_reported():
    """With its kind and place."""
    outcome = answered_as(Reported(), error="ValueError: no", where="system/estimate.py:7 solve")

    assert outcome.word == "exit 1"
    assert "ValueError: no at system/estimate.py:7" in outcome.why


@pytest.mark.parametrize(
    ("sentence", "wrong"),
    [
        ("joints.csv:2: pose 7 is missing; add it.", ""),
        ("joints.csv:2: pose\n7 is missing; add it.", "several lines"),
        ("joints.csv:2: pose \x1b[31m is missing; add it.", "control character"),
        ("joints.csv:2: pose \u202e is missing; add it.", "control character"),
        ("joints.csv:2: " + "A" * 2000, "letters"),
        ("pose 7 is missing; add it.", "names no file"),
    ],
)
def test_a_sentence_that_helps_nobody_is_reported(sentence, wrong):
    """One line, short, printable, with a file and a way out."""
    outcome = answered_as(Reported(), refused=sentence, exit_code=5, way_out="add it")

    assert outcome.word == ("sentence" if wrong else "rejected")
    assert wrong in outcome.why


def test_a_rejection_without_a_way_out_is_reported():
    """And one that is an internal error."""
    assert answered_as(Reported(), refused="joints.csv: no", exit_code=5).why.startswith(
        "no way out"
    )
    assert "exit code 1" in answered_as(Reported(), refused="joints.csv: no", exit_code=1).why


def test_a_real_exception_is_seen(monkeypatch):
    """Planted in the pipeline, not in what is told of it."""

    def broken(*args):
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("pipeline.run.bring", broken)
    found = play(base("reduced"), SCREENED, lambda said: False)

    assert judge.judge(made(), found).word == "exit 1"
    assert "planted" in found.error


def test_a_real_nan_in_a_table_is_seen(monkeypatch):
    """A stage gives a displacement that is none."""
    from pipeline.reduction import bring as stage

    displacements = stage.displacements

    def moved(settings, placed):
        table = displacements(settings, placed)
        table.loc[0, "dx_m"] = float("nan")
        return table

    monkeypatch.setattr(stage, "displacements", moved)
    found = play(base("in_place"), SCREENED, lambda said: False)

    assert "23_displacements.dx_m" in found.reported.not_finite


@pytest.mark.whole
def test_suspicious_screenings_are_answered(before):
    """Where stiffnesses moved and nothing was said, the diagnosis is heard; else it is spared."""
    screened = clean("reduced", SCREENED)
    quiet = softer(screened)

    assert judge.suspicious(made(), quiet)
    assert not judge.suspicious(made(), screened)
    assert not judge.suspicious(made(), replace(quiet, p_value=1e-9))
    assert not judge.suspicious(made(), replace(quiet, words={"mistake outlier"}))


# --- limits --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_what_does_not_end_is_ended_and_reported(monkeypatch):
    """A hang, a dead process, a deaf one, one without memory; the next case is played."""
    monkeypatch.setattr(run, "GRACE", 0.5)
    asked = [(number, SCREENED) for number in range(6)]
    rows = {row["case"]: row["outcome"] for row in played(asked, 1, hostile_cases.row, 0.5)}

    assert rows == {0: "same", 1: "hang", 2: "killed", 3: "hang", 4: "memory", 5: "same"}


@pytest.mark.whole
def test_two_processes_share_the_cases():
    """Each case is played once, whoever plays it, and one that dies is replaced."""
    asked = [(number, SCREENED) for number in (0, 5, 2, 6, 7, 8)]
    rows = list(played(asked, 2, hostile_cases.row, 5))

    assert sorted(row["case"] for row in rows) == [0, 2, 5, 6, 7, 8]
    assert [row["case"] for row in rows if row["outcome"] == "killed"] == [2]
