"""A small league: machines that share nothing with the catalogue hide an effect or none.

The generator writes raw files and keeps the truth; the diagnosis sees the files only.
"""

import numpy as np
import pytest

from pipeline import contest
from pipeline.diagnosis.isolability import twins
from pipeline.league.judge import diagnosed, score
from pipeline.league.machine import Machine, Spring
from pipeline.league.play import play
from pipeline.league.secrets import KNOWN, NOMINAL, STRANGE, setup, straight
from pipeline.robot import configure, load

KR500 = load("kr500_rail")
TWINS = twins(KR500)
SCATTER = ("tracker_noise", "force_noise")
SECRETS = {secret.label: secret for secret in (*KNOWN, *STRANGE)}


def played(seed, **sizes):
    """One game, judged; names write `joint_tilt:3` as joint_tilt_3."""
    secrets = [(SECRETS[_label(name)], size) for name, size in sizes.items()]
    game = play(KR500, secrets, np.random.default_rng(seed))
    return score(KR500, game.truth, diagnosed(KR500, game.files), TWINS)


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


@pytest.mark.parametrize("seed", [31, 32, 33])
def test_an_innocent_machine_is_let_go(seed):
    """Other stiffnesses, tool points, tools and scatter are no fault."""
    assert played(seed).verdict == "adequate"


@pytest.mark.parametrize(
    "sizes",
    [
        {"rail_roll": 1.0},
        {"rail_backlash": 1.0},
        {"joint_tilt_3": 1.5},
        {"link_bending:forearm": 2.0},
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
    one = played(41, **sizes)

    assert one.right, one
    assert one.confident, one


@pytest.mark.parametrize("name", ["joint_tilt_6", "tool_flex"])
def test_twins_stay_undecided(name):
    """A twin is found, and both are said."""
    one = played(42, **{name: 2.5})

    assert one.right
    assert one.verdict == "ambiguous"


@pytest.mark.parametrize(
    "name",
    ["rail_joint_rocks", "chain_rubs", "loose_nest", "shoulder_elbow_coupling", "hertzian_rollers"],
)
def test_what_nobody_knows_is_not_given_a_name(name):
    """A cause outside the catalogue is noticed, and no name is certain."""
    one = played(43, **{name: 1.5})

    assert one.detected
    assert not one.confident


def test_through_real_files_a_secret_is_named(tmp_path):
    """Generator, pipeline and judge meet on disk only; the pipeline is a process of its own."""
    root, sealed = tmp_path / "project", tmp_path / "sealed"
    contest.seal({"rail_roll": 1.0}, 51, root / "data" / "raw", sealed, "hidden")

    answer = contest.answered(root, "hidden")

    truth = contest.opened(sealed, "hidden")
    assert [s["label"] for s in truth["secrets"]] == ["rail_roll"]
    assert answer["diagnosis"]["verdict"] == "explained"
    springs = [c for c in answer["diagnosis"]["causes"] if c["name"] not in SCATTER]
    assert [c["name"] for c in springs] == ["rail_roll"]
    assert springs[0]["gain"]["ci95"][0] > 0
    assert not list((root / "data").rglob("*truth*"))
