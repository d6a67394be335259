"""A small league: machines that share nothing with the catalogue hide an effect or none.

The generator writes raw files and keeps the truth; the diagnosis sees the files only.
"""

import functools
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from bench.league import contest
from bench.league.figures import confusion_matrix
from bench.league.hidden import SECRETS
from bench.league.hidden_effect import NOMINAL, setup, straight
from bench.league.judge import REFUSED, Score, Size, Stated, foretold, score
from bench.league.machine import Machine, Spring
from bench.league.page import page
from bench.league.play import Rules, at_further_poses, drawn, play
from bench.league.run import KINDS, League, Played, answer_of, fixtures, played
from bench.league.table import ece, interval, rows
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.service.executor import InProcesses, InThisProcess

KR500 = load("kr500_rail")
TWINS = twins(KR500)


def measured(seed, sizes, plan=None, rules=None):
    """One game."""
    rng = np.random.default_rng(seed)
    plan = plan or drawn(KR500, rng, Rules())
    return play(KR500, plan, [(SECRETS[name], size) for name, size in sizes.items()], rng, rules)


def judged(seed, **sizes):
    """One game, judged; names write `joint_tilt:3` as joint_tilt_3."""
    game = measured(seed, {_label(name): size for name, size in sizes.items()})
    return score(game.truth, answer_of(game.files), TWINS)


def _label(name):
    head, _, tail = name.rpartition("_")
    return f"{head}:{tail}" if tail.isdigit() else name


def test_an_unloaded_machine_stands_where_the_kinematics_say():
    """The league's own matrices and the pipeline's kinematics agree about the unloaded robot."""
    rng = np.random.default_rng(1)
    q = rng.uniform(KR500.lower, KR500.upper, (5, 7))
    tool = np.array([[0.2, 0.05, 0.12], [-0.1, 0.2, 0.1]])
    machine = setup(KR500, 1 / NOMINAL).machine

    points, _ = machine.settle(q, tool, tool[0], np.zeros((5, 3)))

    np.testing.assert_allclose(points, configure(KR500, q).points(tool), atol=1e-12)


def test_a_machine_rests_where_the_springs_balance_the_pull():
    """In equilibrium the energy of springs and pull is the smallest: no small step lowers it."""
    rng = np.random.default_rng(2)
    q = rng.uniform(KR500.lower, KR500.upper, (1, 7))
    stiffness, force = 1 / NOMINAL, np.array([[900.0, -1500.0, -1800.0]])
    load_point = np.array([0.15, 0.0, 0.25])
    springs = [
        Spring(f"j{j}", j, (0, 0, 1), j == 1, straight(1 / k)) for j, k in enumerate(stiffness, 1)
    ]
    _, at = Machine(KR500, springs).settle(q, np.zeros((1, 3)), load_point, force)

    def energy(bent):
        here = configure(KR500, q + bent).points(load_point[None])[0, 0]
        return 0.5 * np.sum(stiffness * bent**2) - here @ force[0]

    def slope(bent):
        steps = np.eye(7) * 1e-6
        return np.array([(energy(bent + s) - energy(bent - s)) / 2e-6 for s in steps])

    bent = np.zeros(7)
    for _ in range(50):
        bent = bent - slope(bent) / stiffness
    rest = configure(KR500, q + bent).points(load_point[None])[0, 0]

    np.testing.assert_allclose(at[0], rest, atol=2e-8)
    assert np.linalg.norm(at[0] - configure(KR500, q).points(load_point[None])[0, 0]) > 1e-3


def test_what_is_to_be_foretold_is_what_the_machine_does():
    """Further poses of a game: the deformed equilibrium of the package, to 1 um."""
    rules = Rules(poses=2, tool_m=0.0)
    plan = drawn(KR500, np.random.default_rng(4), rules)
    seed = (4, 2)
    truth = play(KR500, plan, [], np.random.default_rng(seed), rules).truth
    asked = at_further_poses(KR500, plan, [], seed, rules)
    tool = Tool(plan.tool[0], np.array(["P"], dtype=object), plan.tool[:1])
    cell = replace(paper_cell(KR500, tool), equilibrium="deformed")

    pulls = Pulls.at(asked.q, asked.force)
    bent = predict(cell, pulls, 1 / np.array(truth["stiffness"])).displacement[:, 0]

    assert np.abs(asked.moved).max() > 1e-3
    np.testing.assert_allclose(asked.moved, bent, atol=1e-6)


def test_a_cause_acts_at_further_poses_too():
    """Lost motion of joint 2 at the size that is hidden, and what falsifies the scale does not."""
    plan = drawn(KR500, np.random.default_rng(4), Rules(poses=2))

    def moved(*secrets):
        hidden = [(SECRETS[name], 20.0) for name in secrets]
        return at_further_poses(KR500, plan, hidden, (4, 2), Rules(poses=2)).moved

    assert np.abs(moved("joint_lost_motion:2") - moved()).max() > 1e-5
    np.testing.assert_array_equal(moved("scale_zero"), moved())


def test_secrets_at_work_together_share_no_spring():
    """A law reads its torque by the name of its spring, so every spring has one of its own."""
    one, course = setup(KR500, 1 / NOMINAL), measured(3, {}).course

    for secret in SECRETS.values():
        secret.plant(one, 1.0, course)

    names = [spring.name for spring in one.machine.springs]
    assert len(names) == len(set(names))


@pytest.mark.slow  # test_one_answer has one
def test_an_innocent_machine_is_let_go():
    """Other stiffnesses, tool points, tools and scatter are no fault."""
    assert judged(31).verdict == "adequate"


@pytest.mark.slow  # test_one_answer has rail_roll, joint_tilt:5 and chain_rubs
@pytest.mark.parametrize(
    "sizes",
    [
        {"rail_backlash": 1.0},
        {"joint_tilt_3": 2.5},
        {"link_bending:forearm": 2.0},
        {"joint_asymmetry_4": 1.0},
        {"joint_hardening_3": 3.0},
        {"joint_lost_motion_3": 2.5},
        {"joint_hysteresis_4": 2.0},
        {"compensator": 2.0},
        {"chain_offset": 2.0},
        {"rail_roll": 1.0, "joint_hysteresis_4": 2.0},
    ],
    ids=lambda sizes: "+".join(sizes),
)
def test_a_secret_is_named(sizes):
    """A cause in another mathematical form than the catalogue's is named with its place."""
    one = judged(41, **sizes)

    assert one.right, one
    assert one.confident, one


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "rail_joint_rocks",
        "loose_nest",
        "shoulder_elbow_coupling",
        "hertzian_rollers",
        "clamp_turns",
    ],
)
def test_what_nobody_knows_is_not_given_a_name(name):
    """A cause outside the catalogue is noticed, and certain at most as what it is, in its place."""
    one = judged(43, **{name: 1.5})

    assert one.detected
    assert one.right or not one.confident


@pytest.mark.slow
@pytest.mark.parametrize("name", ["joint_tilt_6", "tool_flex"])
def test_twins_stay_undecided(name):
    """A twin is found, and both are stated."""
    one = judged(42, **{name: 2.5})

    assert one.right
    assert one.verdict == "ambiguous"


HIDDEN = {
    "innocent": {},
    "guilty": {"rail_roll": 1.0},
    "unheard_of": {"chain_rubs": 1.5},
}


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """Score of a game whose generator, pipeline and judge meet on disk only.

    Generator and pipeline are processes of their own; the truth lies where the pipeline is never
    sent, and nothing of it is in what the pipeline reads.
    """

    @functools.cache
    def played(name):
        root, sealed = tmp_path_factory.mktemp("project"), tmp_path_factory.mktemp("sealed")
        code = (
            "import sys; from pathlib import Path; from bench.league.contest import seal\n"
            f"seal({HIDDEN[name]!r}, {51 + list(HIDDEN).index(name)}, "
            f"Path(sys.argv[1]), Path(sys.argv[2]), {name!r})"
        )
        subprocess.run([sys.executable, "-c", code, root / "data" / "raw", sealed], check=True)
        told = b"".join(path.read_bytes() for path in (root / "data").rglob("*.*"))
        assert not [label for label in HIDDEN[name] if label.encode() in told]
        answers = contest.answers(root, [name])
        return score(contest.opened(sealed, name), answers[name], TWINS)

    return played


@pytest.mark.slow
@pytest.mark.xdist_group("league")
def test_through_real_files_an_innocent_machine_is_let_go(blind):
    """The command says so on raw files alone."""
    assert blind("innocent").verdict == "adequate"


@pytest.mark.slow
@pytest.mark.xdist_group("league")
def test_through_real_files_a_secret_is_named(blind):
    """With a gain that is certain."""
    one = blind("guilty")

    assert one.confident
    assert one.right
    assert one.gain[1] > 0


@pytest.mark.slow
@pytest.mark.xdist_group("league")
def test_through_real_files_what_nobody_knows_gets_no_name(blind):
    """It is noticed all the same."""
    one = blind("unheard_of")

    assert one.detected
    assert not one.confident


@pytest.mark.slow
@pytest.mark.xdist_group("league")
def test_the_files_in_memory_and_the_command_give_one_answer(blind):
    """What the league plays in memory is what the command says, to the last digit."""
    game = measured(52, HIDDEN["guilty"])

    assert score(game.truth, answer_of(game.files), TWINS) == blind("guilty")


def test_the_files_are_those_of_the_measurement_not_of_the_truth():
    """What an operator writes down does not depend on what the machine hides."""
    honest, hiding = measured(61, {}), measured(61, {"rail_roll": 3.0, "chain_weight": 2.0})

    for name in ("campaign.toml", "joints.csv", "loads.csv"):
        assert hiding.files[name] == honest.files[name]
    assert hiding.files["tracker.csv"] != honest.files["tracker.csv"]


def base_readings(game):
    lines = game.files["tracker.csv"].decode().splitlines()
    return [line for line in lines if line.startswith("base_")]


def test_truth_and_scatter_are_drawn_apart():
    """Other stiffnesses, and a secret that rolls dice, leave the scatter as it is."""
    one = measured(62, {})
    other = measured(62, {"chain_offset": 1.0}, rules=Rules(spread=0.1))

    assert base_readings(one) == base_readings(other)
    assert one.truth["stiffness"] != other.truth["stiffness"]


def test_a_further_pose_leaves_the_measured_ones_alone():
    """The machine, its secret and the readings so far stay as they are."""
    plan = drawn(KR500, np.random.default_rng(63), Rules())
    more = plan.further(plan.q[0], plan.anchor[0], 1.0)

    before, after = (measured(64, {"chain_offset": 2.0}, p) for p in (plan, more))

    assert before.truth == after.truth
    old, new = (game.files["tracker.csv"].decode().splitlines() for game in (before, after))
    assert set(old) - set(new) <= set(base_readings(before))
    assert len(new) == len(old) + 4 * 5 + 2 * 3


def test_no_two_games_share_a_seed():
    """Neither among themselves nor with a plan, and a game is the same in a shorter league."""
    every = fixtures(League())
    seeds = [one.seed for one in every]
    small = fixtures(League(clean=3, single=2, pairs=4, strange=1, power=1, doubtful=1))

    assert len(set(seeds)) == len(seeds) == len({one.key for one in every})
    assert not set(seeds) & {one.plan for one in every}
    assert set(small) <= set(every)
    assert {one.kind for one in every} == set(KINDS)
    half = Counter(one.kind for one in every[: len(every) // 2])
    assert all(abs(2 * half[one] - n) <= 3 for one, n in Counter(f.kind for f in every).items())
    assert len({secret for one in every if one.kind == "strange" for secret in one.secrets}) >= 10


@pytest.mark.slow
def test_an_interrupted_league_goes_on_and_ends_the_same(tmp_path):
    """Whatever the number of processes; a line that was cut off is played again."""
    league, log = League(clean=2, single=0, pairs=0, strange=0, power=0, doubtful=0), tmp_path / "l"
    whole = contest.contest(league, log, InProcesses(2))
    log.write_text(log.read_text()[:-40])

    again = contest.contest(league, log, InThisProcess(), minutes=1e-9)

    timeless = [replace(game, seconds=0, diagnosing=0, cost=0) for game in whole]
    assert [replace(game, seconds=0, diagnosing=0, cost=0) for game in again] == timeless
    assert sum(new == old for new, old in zip(again, whole, strict=True)) == 1
    assert contest.contest(replace(league, clean=3), log, InThisProcess(), minutes=0) == again
    assert contest.contest(replace(league, seed=1), log, InThisProcess(), minutes=0) == []
    log.write_text(log.read_text().replace('"code": "', '"code": "0'))
    assert contest.contest(league, log, InThisProcess(), minutes=0) == []


@contextmanager
def playing(log):
    """A league in a session of its own, with its first game played."""
    none = [f"--{kind}=0" for kind in ("single", "pairs", "strange", "power", "doubtful")]
    command = [sys.executable, "-m", "bench.league", *none, f"--log={log}", "--jobs=1"]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as league:
        while not log.is_file() or log.read_text().count("\n") < 2:
            assert league.poll() is None
            time.sleep(0.1)
        yield league


@pytest.mark.slow
def test_an_interrupted_league_says_what_is_kept(tmp_path):
    """Ctrl-C ends it at once, with the exit code of an interruption and one sentence."""
    with playing(tmp_path / "games") as league:
        os.killpg(league.pid, signal.SIGINT)

        _, said = league.communicate(timeout=20)

    assert league.returncode == 130
    assert re.search(r"Interrupted; \d+ of 1000 games are kept in ", said)
    assert len(said.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_league_leaves_nobody_behind(tmp_path, how):
    """The processes that play end with the one that hands out the games."""
    with playing(tmp_path / "games") as league:
        league.send_signal(how)
        league.wait(20)

        end = time.monotonic() + 20
        while _alive(league.pid) and time.monotonic() < end:
            time.sleep(0.1)
        left = _alive(league.pid)
        if left:
            os.killpg(league.pid, signal.SIGKILL)

    assert not left


def _alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def cause(
    name, probability=1.0, *rivals, where=None, location="rail", gain=(0.5, 0.4, 0.6), **size
):
    """A cause as result.json has it."""
    return {
        "name": name,
        "where": where,
        "location": location,
        "probability": probability,
        "rivals": [{"name": n, "where": w, "probability": p} for n, w, p in rivals],
        "parameters": [{"name": n, "ci95": list(ends)} for n, ends in size.items()],
        "gain": {"reduction": gain[0], "ci95": list(gain[1:])},
    }


def answer(verdict, *causes, next_poses=()):
    """result.json, as far as the judge opens it."""
    return {
        "diagnosis": {
            "verdict": verdict,
            "causes": causes,
            "next_poses": list(next_poses),
            "detection": {"remainder_over_scatter": 2.0},
            "noise_floor_mm": 0.03,
        },
        "joint_springs": {"validation": {"held_out_rms_mm": 0.2}},
        "stiffness": [
            {"name": "k_r1", "joint": 1, "value": 8e7, "identifiable": True, "ci95": [7e7, None]},
            {
                "name": "k_theta2",
                "joint": 2,
                "value": 4e6,
                "identifiable": True,
                "ci95": [3e6, 5e6],
            },
            {"name": "k_theta3", "joint": 3, "value": None, "identifiable": False, "ci95": None},
        ],
    }


def truth(*labels, place="rail", **amplitudes):
    """A sealed truth."""
    secrets = [
        {"label": label, "place": place, "known": True, "size": 1.0, "amplitudes": amplitudes}
        for label in labels
    ]
    return {"secrets": secrets, "stiffness": [9e9, 5.1e6, 1e6]}


def test_stiffnesses_are_judged_where_they_are_determined():
    """An interval without upper limit holds whatever is above its lower one."""
    springs = score(truth(), answer("adequate"), PAIR).springs

    assert [(one.name, one.covered) for one in springs] == [("k_r1", True), ("k_theta2", False)]


def test_a_prediction_is_judged_axis_by_axis():
    """Two standard uncertainties off is outside, and what is not determined is no prediction."""
    true, std = np.zeros((2, 3)), np.full((2, 3), 1e-6)
    std[1, 2] = np.inf
    said = np.array([[1.9e-6, -2.0e-6, 0.0], [0.0, 2.0e-6, 1.0]])

    judged = foretold(true, said, std)

    assert [one.covered for one in judged] == [True, False, True, True, False]


PAIR = Twins((), (("tool_flex", "joint_tilt:7"),), ())


def test_a_secret_that_is_not_seen_is_neither_right_nor_wrong():
    """`adequate` for a machine with a hidden cause counts as nothing found; a refusal likewise."""
    for one in (score(truth("rail_roll"), answer("adequate"), PAIR), REFUSED):
        assert not one.right
        assert not one.in_list
        assert not one.confident
    assert REFUSED.detected


def test_twins_are_one_name_and_others_are_not():
    """Odds of twins are added; neighbours stay apart."""
    flex = cause("tool_flex", 0.5, ("joint_tilt", 7, 0.4), ("joint_tilt", 6, 0.1), location="tool")
    one = score(truth("joint_tilt:7", place="tool"), answer("ambiguous", flex), PAIR)
    other = score(truth("joint_tilt:6", place="tool"), answer("ambiguous", flex), PAIR)

    assert one.right
    assert one.stated[0] == Stated("joint_tilt:7 = tool_flex", 0.9, True)
    assert not other.right
    assert other.in_list


def test_a_wrong_name_strays_and_a_wrong_place_is_misplaced():
    """Half of the truth is no right answer, but no wrong name either."""
    both = truth("rail_roll", "rail_pitch")
    half = score(both, answer("explained", cause("rail_roll")), PAIR)
    more = cause("joint_tilt", where=3, location="joint 3")
    beside = score(truth("rail_roll"), answer("explained", cause("rail_roll"), more), PAIR)
    swapped = score(truth("rail_roll"), answer("explained", cause("outlier")), PAIR)

    assert (half.right, half.strayed, half.misplaced) == (False, False, False)
    assert (beside.right, beside.strayed, beside.misplaced) == (False, True, True)
    assert (swapped.right, swapped.strayed, swapped.misplaced) == (False, True, False)


def test_scatter_is_no_name():
    """A scatter larger than stated beside the right cause takes nothing from it."""
    noisy = cause("tracker_noise", location="noise", gain=(0, 0, 0))
    one = score(truth("rail_roll"), answer("explained", cause("rail_roll"), noisy), PAIR)

    assert one.right
    assert score(truth(), answer("explained", noisy), PAIR).confident is False


def test_an_improbable_rival_is_not_on_the_list():
    """One per cent is what a reader takes notice of."""
    named = cause("rail_pitch", 0.98, ("rail_roll", None, 0.009))
    likely = cause("rail_pitch", 0.98, ("rail_roll", None, 0.011))

    assert not score(truth("rail_roll"), answer("ambiguous", named), PAIR).in_list
    assert score(truth("rail_roll"), answer("ambiguous", likely), PAIR).in_list


def test_amplitudes_are_compared_for_the_true_cause_only():
    """By the name of the parameter; the interval ends count as inside."""
    sealed = truth("rail_roll", c_roll=2.0)
    one = score(sealed, answer("explained", cause("rail_roll", c_roll=(1.0, 2.0))), PAIR)
    other = score(sealed, answer("explained", cause("rail_pitch", c_roll=(1.0, 2.0))), PAIR)

    assert one.sizes == (Size("c_roll", 2.0, 1.0, 2.0),)
    assert one.sizes[0].covered
    assert not Size("c_roll", 2.0, 2.1, 3.0).covered
    assert other.sizes == ()
    assert one.remainder == 2.0


def test_a_promise_is_that_of_all_proposed_poses():
    """Each pose says what the closest pair is with those before it: the last one counts."""
    proposals = [{"separates": [n, "c"], "sigmas_after": s} for n, s in (("a", 2.0), ("b", 5.0))]

    assert score(truth("a"), answer("ambiguous", next_poses=proposals), PAIR).apart == 5.0


WON = Score("explained", ("rail_roll",), True, True, False, False, (), (), None, 0.1, 1.0, None)
OPEN = replace(WON, verdict="ambiguous", apart=5.0, stated=(Stated("rail_roll", 0.6, True),))
UNPAID = replace(OPEN, stated=(Stated("rail_roll", 0.99, True), Stated("x", 0.01, False)))
STRAY = replace(WON, right=False, in_list=False, strayed=True, misplaced=True)
MISSED = Score("adequate", (), False, False, False, False, (), (), None, 0.1, 0.9, None)


def game(kind, *scores, secrets=("rail_roll",), times=2.0, missed=0.05):
    """A game that ended so."""
    return Played("1", kind, secrets, times, (1.0,), 0.5, missed, scores, 1.0, 0.5, 2.0)


def counted(*games):
    """First words of each row -> measured."""
    return {what.split(":")[0].split(",")[0]: value for what, value, _ in rows(games)}


def test_misses_and_wrong_names_are_counted_as_such():
    """Of four singles one is missed, one is wrong; what was not played does not count."""
    unplayed = game("single")
    table = counted(*(game("single", s) for s in (WON, WON, STRAY, MISSED)), unplayed)

    assert "(2 of 4;" in table["single cause at twice its smallest identifiable size"]
    assert "(1 of 4;" in table["confidently wrong name"]
    assert "(2 of 3;" in table["truth among cause and rivals"]
    assert "(0 of 4;" in table["gain interval above zero where the true gain is above 5 %"]


def test_a_gain_that_is_nothing_needs_no_interval():
    """No gain is asked of a machine whose hidden cause hardly moves the cross-validation error."""
    table = counted(game("single", WON, missed=0.04), game("single", WON, missed=0.01))

    assert "(0 of 1;" in table["gain interval above zero where the true gain is above 5 %"]


def test_amplitudes_are_counted_one_by_one():
    """Every parameter of every known cause, at all sizes, from twice the smallest, of one law."""
    inside, outside = Size("c_roll", 2.0, 1.0, 3.0), Size("c_roll", 2.0, 2.5, 3.0)
    lost = Size("b_2", 2.0, 2.5, 3.0)
    table = counted(
        game("power", replace(WON, sizes=(inside, outside)), times=0.5),
        game("single", replace(WON, sizes=(inside, inside, lost))),
        game("strange", replace(WON, sizes=(outside,)), secrets=("odd",)),
    )

    assert "(3 of 5;" in table["amplitude"]
    assert "(2 of 3;" in table["... at twice the smallest identifiable size and above"]
    assert "(2 of 2;" in table["... and the same law"]


def test_names_for_strangers_are_wrong_whatever_they_are():
    """In the right place they are still names."""
    near = replace(STRAY, misplaced=False)
    table = counted(*(game("strange", s, secrets=("odd",)) for s in (STRAY, near, MISSED)))

    assert "(2 of 3;" in table["confident name for a cause outside the catalogue"]
    assert "(1 of 3;" in table["... in the wrong place"]


def test_a_twin_named_alone_is_counted_against():
    """Also one that is a stiffness by nature."""
    table = counted(
        game("single", WON, secrets=("tool_flex",)), game("single", MISSED, secrets=("rail_yaw",))
    )

    assert "(1 of 2;" in table["twins never named singly"]


def test_a_proposed_pose_settles_only_by_the_right_name():
    """With one pose or later; wrong names, and pairs that no pose separates, are told apart."""
    table = counted(
        game("doubtful", OPEN, WON),
        game("doubtful", OPEN, OPEN, WON),
        game("doubtful", OPEN, STRAY),
        game("doubtful", replace(OPEN, apart=2.0), WON),
        game("doubtful", replace(OPEN, apart=None)),
        game("doubtful", UNPAID, WON),
        game("doubtful", UNPAID, UNPAID),
        game("doubtful", WON),
    )

    assert "(1 of 3;" in table["proposed next pose makes a right name of `ambiguous`"]
    assert "(2 of 3;" in table["... with up to four"]
    assert "(2 of 4;" in table["... all rivals for which a pose is proposed"]
    assert "(1 of 2;" in table["... a pose is proposed where only the gain is not certain"]
    assert table["... ambiguous with nothing to propose"] == "1 of 7"


def test_probabilities_that_come_true_as_often_as_stated_have_no_error():
    """Three of four at 0.75 are right; four of four at 0.75 are off by a quarter."""
    fair = [Stated("x", 0.75, k > 0) for k in range(4)]
    shy = [Stated("x", 0.75, True)] * 4

    assert ece(fair) == 0.0
    assert ece(shy) == pytest.approx(0.25)
    assert ece(fair + shy) == pytest.approx(0.125)


def test_intervals_are_those_of_the_textbook():
    """Clopper and Pearson (1934): none of ten, and half of ten."""
    assert interval(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert interval(5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)


def test_what_a_person_wrote_on_the_page_stays():
    """The command replaces its own part only, time after time."""
    first = page([game("single", WON)], 1, "one", "abc", "")
    edited = "Above.\n" + first + "\n## What falls short\n"

    second = page([game("single", STRAY)], 2, "two", "abc", edited)

    assert second.startswith("Above.\n# The hidden-effect league")
    assert second.endswith("\n## What falls short\n")
    assert "    two\n" in second
    assert "1 of 2 games" in second
    assert "    one\n" not in second
    assert second.count("| what |") == 1


def test_the_picture_of_names_is_in_the_order_of_the_catalogue():
    """Strangers come last; rows add up to one, whatever was stated."""
    tilt = replace(WON, named=("joint_tilt:3",))
    hidden, said, cells = confusion_matrix(
        [
            game("strange", MISSED, secrets=("rail_joint_rocks",)),
            game("single", tilt, secrets=("joint_tilt:3",)),
            game("single", WON),
            game("single", replace(tilt, verdict="ambiguous")),
            game("single", replace(tilt, verdict="unexplained")),
            game("single", replace(WON, named=("rail_roll", "joint_tilt:3"))),
            game("clean", MISSED, secrets=()),
        ]
    )

    assert hidden == ["rail_roll", "joint_tilt:3", "rail_joint_rocks"]
    assert said == ["rail_roll", "joint_tilt:3", "other or several names", "no name", "adequate"]
    np.testing.assert_array_equal(
        cells, [[0.25, 0.25, 0.25, 0.25, 0], [0, 1, 0, 0, 0], [0, 0, 0, 0, 1]]
    )


@pytest.mark.whole
def test_a_secret_beyond_any_sensible_size_is_not_played():
    """It is said so, and no campaign is computed."""
    roll = next(one for one in fixtures(League()) if one.secrets == ("rail_roll",))

    one = played(replace(roll, kind="single", times=1e3), League())

    assert one.scores == ()
    assert "`rail_roll` (1 of 1)" in page([one], 1, "", "", "")
