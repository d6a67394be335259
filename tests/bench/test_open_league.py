"""The open league: nobody can change a truth or see it early, and the count is what it says."""

import itertools
import json
import sys

import numpy as np
import pytest
from scipy import stats

from bench.open_league import entries, sealed, table, truth
from bench.open_league.draw import SEEDS, fixtures
from bench.open_league.entries import Entry, play
from bench.open_league.reply import read
from bench.open_league.score import score as scored
from bench.open_league.solvers import least_squares, stepwise
from bench.open_league.solvers.problem import Problem, Suspect
from bench.open_league.truth import Cause, Prediction, Stiffness, Truth
from pipeline.base.errors import InputError, UsageError

SALT = "0" * 32
ROLL = Cause(name="rail_roll", amplitudes={"c_roll": 1e-8})
TWIN = Cause(name="joint_tilt", where=5, accept=("joint_tilt:6",))
STRANGER = Cause(name="chain_rubs", listed=False)
RIPPLE = Cause(name="gear_ripple", where=5, listed=False)


def true(*causes, **more):
    """A truth of one joint and one prediction."""
    return Truth(
        salt=SALT,
        kind="test",
        stiffness=(Stiffness(name="k_theta2", value=2e6),),
        causes=causes,
        predictions=(
            Prediction(
                name="test_pose",
                q=(0.0,),
                force_n=(0.0, 0.0, -1000.0),
                deflection_m={"P1": (1e-3, 0.0, -2e-3)},
            ),
        ),
        **more,
    )


def cause(name, where=None, probability=None, rivals=()):
    """A cause as result.json has it."""
    said = {"name": name, "where": where, "rivals": list(rivals)}
    return said if probability is None else said | {"probability": probability}


def answer(*causes, verdict="explained", value=2.1e6, ci95=(1.9e6, 2.3e6), dx=1.1, std=0.06):
    """The scored part of result.json."""
    return {
        "stiffness": [{"name": "k_theta2", "value": value, "ci95": list(ci95)}],
        "test_pose_deflection": [
            {"target": "P1", "dx_mm": dx, "dy_mm": 0.0, "dz_mm": -2.0, "std_mm": [std] * 3}
        ],
        "diagnosis": {"verdict": verdict, "causes": list(causes)},
    }


def score(truth, said):
    """The score of an answer as it is printed."""
    return scored(truth, read(said)[0])


@pytest.fixture
def games(tmp_path):
    """Three games with their truths, not sealed."""
    folder = tmp_path / "games"
    for k, causes in enumerate([(), (ROLL,), (STRANGER,)], 1):
        (folder / f"g{k}").mkdir(parents=True)
        (folder / f"g{k}" / "campaign.toml").write_text(f"# {k}\n")
        truth.write(folder / f"g{k}" / "truth.json", true(*causes))
    return folder


@pytest.fixture
def hidden(tmp_path):
    return tmp_path / "truths"


def test_what_is_sealed_is_out_of_sight(games, hidden):
    """Players get hashes only; what is hashed is the very file that is kept."""
    said = sealed.seal(games, hidden)

    assert not list(games.rglob("truth.json"))
    assert sorted(said.games) == ["g1", "g2", "g3"]
    assert truth.read(hidden / "g2.json").causes == (ROLL,)
    assert sealed.manifest(games) == said
    assert len({one.truth for one in said.games.values()}) == 3
    with pytest.raises(UsageError, match="sealed already"):
        sealed.seal(games, hidden)


def test_truths_do_not_stay_with_the_games(games):
    """A folder inside the games would be handed out with them, and nothing is moved there."""
    with pytest.raises(UsageError, match="elsewhere"):
        sealed.seal(games, games / "truths")
    assert len(list(games.rglob("truth.json"))) == 3


def test_a_truth_without_salt_gets_one(games, hidden):
    """Otherwise whoever knows the format could try all causes."""
    path = games / "g1" / "truth.json"
    said = json.loads(path.read_text())
    del said["salt"]
    path.write_text(json.dumps(said))

    sealed.seal(games, hidden)

    assert len(truth.read(hidden / "g1.json").salt) == 32
    assert truth.read(hidden / "g1.json").salt != SALT


@pytest.mark.parametrize(
    ("change", "words"),
    [({"kind": 3}, "kind"), ({"surprise": 1}, "surprise"), ({"stiffness": 1}, "stiffness")],
)
def test_what_is_no_truth_is_named(games, hidden, change, words):
    """With its file and word; nothing is sealed then."""
    path = games / "g2" / "truth.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))

    with pytest.raises(InputError, match=words):
        sealed.seal(games, hidden)
    assert not (games / sealed.MANIFEST).exists()
    assert (games / "g1" / "truth.json").exists()


def test_another_truth_is_not_revealed(games, hidden):
    """One changed digit, and none of the truths is published."""
    sealed.seal(games, hidden)
    path = hidden / "g2.json"
    path.write_text(path.read_text().replace("rail_roll", "rail_yaws"))

    with pytest.raises(InputError, match="SHA-256"):
        sealed.reveal(games, hidden)
    assert not (games / sealed.TRUTH).exists()


def test_a_changed_campaign_is_not_played(games, hidden):
    """Nor one with a file more."""
    sealed.seal(games, hidden)
    (games / "g3" / "hint.txt").write_text("chain")

    with pytest.raises(InputError, match=r"hint\.txt of g3"):
        next(play(games, [Entry.of("a=true {folder}")]))


PRINTS = "import json, sys; print('at work'); print(json.dumps({'seen': sys.argv[1]}))"
PRINTS_ALL = """
import json, os, sys
for name in sys.argv[1:]:
    print(json.dumps({"campaign": name, "files": os.listdir("data/raw/" + name), "cpu_s": 0.5}))
"""


def test_entries_play_one_by_one_or_at_once(games, hidden):
    """Either way each game is played once, in a folder without any truth."""
    sealed.seal(games, hidden)
    one = Entry("one", (sys.executable, "-c", PRINTS, "{campaign}"))
    every = Entry("every", (sys.executable, "-c", PRINTS_ALL, "{campaigns}"))

    first = list(play(games, [one, every]))
    again = list(play(games, [one, every]))

    assert [(p.entry, p.game) for p in first] == [
        (e, g) for e in ("one", "every") for g in ("g1", "g2", "g3")
    ]
    assert [p.answer for p in first[:3]] == [{"seen": f"g{k}"} for k in (1, 2, 3)]
    assert {tuple(p.answer["files"]) for p in first[3:]} == {("campaign.toml",)}
    assert {p.cpu_s for p in first[3:]} == {0.5}
    assert again == []


def test_a_command_that_fails_has_no_answer(games, hidden):
    """Its exit code is kept; a command that is not there is said at once."""
    sealed.seal(games, hidden)

    (*_, last) = play(games, [Entry("ends", (sys.executable, "-c", "exit(7)", "{folder}"))])

    assert (last.exit_code, last.answer) == (7, None)
    with pytest.raises(UsageError, match="no-such-program cannot be carried out"):
        next(play(games, [Entry.of("x=no-such-program {folder}")]))


@pytest.mark.parametrize("text", ["pipeline run {campaign}", "=run {folder}", "a=run g1", "a/b=x"])
def test_an_entry_needs_a_name_and_a_campaign(text):
    """A path as a name would put answers elsewhere."""
    with pytest.raises(UsageError):
        Entry.of(text)


def test_answers_after_the_truth_do_not_count(games, hidden):
    """Neither new ones nor those that were changed; what stood does."""
    sealed.seal(games, hidden)
    for game in ("g1", "g2"):
        _kept(games, "early", game, answer(cause("rail_roll")))
    sealed.reveal(games, hidden)
    _kept(games, "early", "g2", answer(cause("joint_tilt", 3)))
    _kept(games, "late", "g2", answer(cause("rail_roll")))

    found = table.scored(games)

    assert list(found) == ["early"]
    assert [(g.score.answered, g.score.wrong) for g in found["early"]] == [
        (True, 1),
        (False, 0),
        (False, 0),
    ]


def _kept(games, entry, game, said):
    path = entries.place(games, entry, game)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"answer": said, "cpu_s": 1.0}))


@pytest.mark.parametrize(
    ("causes", "named", "right", "missed", "wrong", "exact"),
    [
        ((), (), 0, 0, 0, True),
        ((), ("rail_roll",), 0, 0, 1, False),
        ((), ("heavy_tails",), 0, 0, 0, True),
        ((ROLL,), (), 0, 1, 0, False),
        ((ROLL,), ("rail_roll", "rail_pitch"), 1, 0, 1, False),
        ((ROLL, TWIN), ("rail_roll",), 1, 1, 0, False),
        ((STRANGER,), ("chain_rubs",), 0, 0, 1, False),
        ((STRANGER,), ("unlisted_law",), 0, 0, 1, False),
        ((RIPPLE,), ("gear_ripple:5",), 0, 0, 1, False),
        ((RIPPLE,), (), 0, 0, 0, True),
        ((ROLL,), ("unlisted_law:rail",), 0, 1, 1, False),
    ],
)
def test_names_are_right_wrong_or_missed(causes, named, right, missed, wrong, exact):
    """Noise is neither; no listed name is right for what the catalogue has not."""
    one = score(true(*causes), answer(*map(cause, named)))

    assert (one.right, one.missed, one.wrong, one.exact) == (right, missed, wrong, exact)


def test_a_law_at_the_place_of_what_nobody_lists_is_right():
    """Elsewhere, or a listed cause at the same place, is a wrong name; its probability pays."""
    at = score(true(RIPPLE), answer(cause("unlisted_law", 5, 0.9)))
    elsewhere = score(true(RIPPLE), answer(cause("unlisted_law", 4, 0.9)))
    listed = score(true(RIPPLE), answer(cause("joint_hardening", 5, 0.9)))
    both = score(true(RIPPLE, ROLL), answer(cause("rail_roll"), cause("unlisted_law", 5)))

    assert [(s.placed, s.wrong, s.exact) for s in (at, elsewhere, listed)] == [
        (1, 0, True),
        (0, 1, False),
        (0, 1, False),
    ]
    assert (both.right, both.placed, both.missed, both.exact) == (1, 1, 0, True)
    assert at.log_score == pytest.approx(-np.log(0.9))
    assert elsewhere.log_score == pytest.approx(-np.log(1e-3) - np.log(0.1))


def test_twins_are_right_once():
    """Either name will do; both are one cause."""
    one = score(true(TWIN), answer(cause("joint_tilt", 6), cause("joint_tilt", 5)))
    other = score(true(TWIN), answer(cause("joint_tilt", 7)))

    assert (one.right, one.wrong, one.exact) == (1, 0, True)
    assert (other.right, other.missed, other.wrong) == (0, 1, 1)


def test_probabilities_pay_when_they_come_true():
    """-ln p, rivals counted; silence costs as much as certainty in the wrong."""
    rival = {"name": "rail_pitch", "where": None, "probability": 0.2}
    sure = score(true(ROLL), answer(cause("rail_roll", None, 0.8, [rival])))
    silent = score(true(ROLL), answer())
    plain = score(true(ROLL), answer(cause("rail_roll")))

    assert sure.log_score == pytest.approx(-2 * np.log(0.8))
    assert silent.log_score == pytest.approx(-np.log(1e-3))
    assert plain.log_score is None


def test_numbers_are_compared_with_their_intervals():
    """A stiffness 5 % too high inside, a deflection 0.1 mm off by less than two sigmas inside."""
    inside = score(true(), answer())
    outside = score(true(), answer(ci95=(2.05e6, 2.3e6), std=0.04))
    open_ = score(true(), answer(value=None, ci95=(1e6, None)))

    (spring,), (x, y, z) = inside.springs, inside.deflections
    assert spring.error == pytest.approx(0.05)
    assert (spring.covered, outside.springs[0].covered) == (True, False)
    assert spring.width == pytest.approx(0.2)
    assert x.error == pytest.approx(1e-4)
    assert (x.covered, outside.deflections[0].covered) == (True, False)
    assert (y.covered, z.covered) == (True, True)
    assert open_.springs[0].error is None
    assert (open_.springs[0].covered, open_.springs[0].width) == (True, None)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"stiffness": [{"value": 1.0}]}, "stiffness.0.name"),
        ({"diagnosis": {}}, "diagnosis.verdict"),
        ({"stiffness": [{"name": "k_theta2", "value": float("nan")}]}, "stiffness.0.value"),
        ({"diagnosis": {"verdict": "explained", "causes": [{"name": "a", "probability": 2}]}}, "2"),
    ],
)
def test_an_answer_that_cannot_be_scored_is_none(change, word):
    """And the player is told which word of it is wrong."""
    reply, problem = read(answer() | change)

    assert reply is None
    assert word in problem


def test_no_answer_is_nothing_right_and_nothing_wrong():
    """And no number."""
    one = score(true(ROLL), None)

    assert (one.answered, one.right, one.missed, one.wrong, one.noticed) == (False, 0, 1, 0, False)
    assert one.springs[0].covered is None
    assert all(value.error is None for value in one.deflections)


def test_wilsons_interval_is_that_of_the_textbook():
    """8 of 10, Brown, Cai and DasGupta (Statist. Sci. 16, 2001): 0.490 to 0.943."""
    assert table.share(8, 10) == "80 % (8 of 10; 49 to 94)"
    assert table.share(0, 0) == "-"


def test_games_and_not_values_are_drawn_again():
    """Ten equal values of each of two games tell as little as one of each."""
    few = table._with_ends([[0.0], [1.0]], np.mean, "{:.2f}")
    many = table._with_ends([[0.0] * 10, [1.0] * 10], np.mean, "{:.2f}")

    assert few == many == "0.50 (0.00 to 1.00)"


def test_seeds_are_nobodys_choice():
    """They are what the file says they are, and kinds meet noises."""
    import hashlib

    every = [int(word) for word in SEEDS.read_text().split()]
    made = [
        int(hashlib.sha256(f"open league {k}".encode()).hexdigest()[:15], 16)
        for k in range(1, len(every) + 1)
    ]

    assert every == made
    assert len({(one.kind, one.noise) for one in fixtures(72)}) == 16


def made(rng, z=0.0, noise=1.0, rows=90):
    """C = B x + Z z with two springs and six suspects of one or two columns."""
    B, Z = rng.normal(size=(rows, 2)), rng.normal(size=(rows, 8))
    c = B @ [2.0, 3.0] + Z[:, :2] @ np.full(2, z) + noise * rng.normal(size=rows)
    ends = (0, 2, 4, 5, 6, 7, 8)
    suspects = tuple(
        Suspect(f"cause{k}", None, tuple("ab")[: b - a], np.arange(a, b), True)
        for k, (a, b) in enumerate(itertools.pairwise(ends))
    )
    return Problem(
        springs=("k_1", "k_2"),
        targets=("P1",),
        c=c,
        B=B,
        Z=Z,
        pose=np.repeat(np.arange(rows // 9), 9),
        root=np.eye(rows) / noise,
        suspects=suspects,
        B_there=rng.normal(size=(3, 2)),
        Z_there=rng.normal(size=(3, 8)),
    )


def names(said):
    return [one["name"] for one in said["diagnosis"]["causes"]]


def test_plain_least_squares_is_numpys():
    """Value, covariance and Student's interval; nothing is named."""
    given = made(np.random.default_rng(1))
    said = least_squares.solve(given)

    x, rest, *_ = np.linalg.lstsq(given.B, given.c, rcond=None)
    cov = np.linalg.inv(given.B.T @ given.B) * rest[0] / 88
    half = stats.t.ppf(0.975, 88) * np.sqrt(np.diag(cov))
    assert names(said) == []
    for k, one in enumerate(said["stiffness"]):
        assert one["value"] == pytest.approx(1 / x[k])
        assert one["ci95"] == pytest.approx([1 / (x[k] + half[k]), 1 / (x[k] - half[k])])


def test_the_f_test_of_one_column_is_students():
    """Beside a mean, F of one column is t squared of the regression line."""
    rng = np.random.default_rng(2)
    z, y = rng.normal(size=40), rng.normal(size=40)
    rows = stepwise._Rows(y, np.ones((40, 1)), z[:, None], 0.05)
    one = Suspect("cause", None, ("a",), np.array([0]), True)

    assert rows.p_value(one, []) == pytest.approx(stats.linregress(z, y).pvalue)


def test_bonferroni_is_what_keeps_stepwise_from_naming_noise():
    """A true cause is found either way; in noise one of six is named in a quarter of the draws."""
    found = stepwise.solve(made(np.random.default_rng(3), z=1.0), bonferroni=True)
    idle = [made(np.random.default_rng([4, k])) for k in range(60)]
    false = {b: sum(bool(names(stepwise.solve(one, b))) for one in idle) for b in (True, False)}

    assert names(found) == ["cause0"]
    assert false[True] <= 9
    assert 8 <= false[False] <= 26


def test_the_lasso_is_soft_thresholding_where_columns_are_orthogonal():
    """That is, z = sign(g) max(|g| - lambda, 0) (Tibshirani 1996, Eq. 3)."""
    pytest.importorskip("sklearn", reason="extra `bench`")
    from bench.open_league.solvers.lasso import _Path

    rng = np.random.default_rng(5)
    Q = np.linalg.qr(rng.normal(size=(60, 5)))[0]
    y, B, Z = rng.normal(size=60), Q[:, :2], 3.0 * Q[:, 2:]
    path = _Path.of(y, B, Z)
    penalties = path.largest * np.array([1.0, 0.6, 0.2])

    g = np.sqrt(60) * Q[:, 2:].T @ y / 60
    soft = np.sign(g) * np.maximum(np.abs(g) - penalties[:, None], 0) * np.sqrt(60) / 3.0
    np.testing.assert_allclose(path.follow(penalties), soft, atol=1e-3 * np.abs(soft).max())


@pytest.mark.slow
def test_a_drawn_game_is_sealed_played_revealed_and_scored(tmp_path):
    """By its commands, with our engine and a solver as entries."""
    import subprocess

    def said(*words):
        command = [sys.executable, "-m", "bench.open_league", *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    folder, kept = str(tmp_path / "games"), str(tmp_path / "truths")
    said("draw", folder, "--count", "2")
    said("seal", folder, "--truth", kept)
    solver = f"{sys.executable} -m bench.open_league.solvers"
    ours = f"ours={sys.executable} -m pipeline run {{campaigns}} --json --engine local"
    said("play", folder, "--entry", ours, "--entry", f"plain={solver} least-squares {{folder}}")
    said("reveal", folder, "--truth", kept)

    text = said("score", folder)

    assert "| games, answered | 2, 2 | 2, 2 |" in text
    assert "clean: a cause is named | 0 % (0 of 1" in text
