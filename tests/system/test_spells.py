"""Spells of noise: sums over all courses of a campaign, against their enumeration."""

from itertools import groupby, product

import numpy as np
import pytest

from pipeline.machine.effect import Pulls
from pipeline.system.noise_shape import _in_time
from pipeline.system.spells import States

KEYS = np.array([(4, 1), (4, -1), (4, 2), (4, 2), (6, -1), (6, 1), (9, 3), (4, 3)])
"""Pose and pull of readings: four states, two, and one."""

COURSES = {
    "as numbered": [(4, -1), (4, 1), (4, 2), (4, 3), (6, -1), (6, 1), (9, 3)],
    "in rounds": [(9, 3), (4, -1), (4, 1), (6, -1), (6, 1), (4, 2), (4, 3)],
    "zeros again": [(4, -1), (4, 1), (4, 2), (4, 3), (4, -1), (6, -1), (6, 1), (9, 3)],
}
"""Keys of the states in the order of time."""


def chance(course, begins, lasts):
    """Probability of a course of quiet (0) and noisy (1) states, from its runs."""
    p, runs = 1.0, [(bit, len(list(same))) for bit, same in groupby(course)]
    for k, (bit, length) in enumerate(runs):
        after = k + 1 < len(runs)
        if bit:
            p *= 0.0 if length < 2 else begins * lasts ** (length - 2) * (1 - lasts) ** after
        else:
            p *= (1 - begins) ** (length - (k > 0))
    return p


def begins(share):
    """Probability that a spell begins, from the mean length of spells (five) and of what is quiet.

    A spell has two states, and each further one with a probability of 3/4.
    """
    spell = 2 + sum(0.75**k for k in range(1, 200))
    return share / (1 - share) / spell


@pytest.fixture
def gains():
    """Of each reading, for two laws."""
    return np.random.default_rng(1).normal(0, 2, (2, len(KEYS)))


@pytest.mark.parametrize("name", COURSES)
def test_a_spell_covers_successive_states(gains, name):
    """Likelihood ratio and probability of every state, each course enumerated."""
    turns = COURSES[name]
    elsewhere = [(5, -1), *turns]  # a pose none of whose readings is good
    states, share = States.each(KEYS, np.array(elsewhere)), np.array([0.2, 0.05])
    keys = sorted({(int(p), int(k)) for p, k in KEYS})

    for law, u in enumerate(share):
        whole, noisy = 0.0, np.zeros(len(turns))
        g = [gains[law][(key == KEYS).all(axis=1)].sum() / turns.count(key) for key in turns]
        for course in product((0, 1), repeat=len(turns)):
            p = chance(course, begins(u), 0.75) * np.exp(np.dot(course, g))
            whole += p
            noisy += p * np.array(course)
        each = dict.fromkeys(keys, 1.0)
        for key, p in zip(turns, noisy / whole, strict=True):
            each[key] *= 1 - p

        assert states.ratio(gains, share)[law] == pytest.approx(np.log(whole))
        assert 1 - states.noisy(gains, share)[law] == pytest.approx([each[key] for key in keys])


def test_a_spell_goes_on_in_the_next_pose():
    """The last zeros of a pose and the first readings of the next one; not one state alone."""
    keys = np.array([(p, k) for p in range(4) for k in (-1, 1, 2)])
    gains = np.where((keys == (1, 2)).all(axis=1) | (keys == (2, -1)).all(axis=1), 6.0, -6.0)
    lone = np.where((keys == (1, 2)).all(axis=1), 6.0, -6.0)
    states = States.each(keys)

    found, alone = (states.noisy(one[None], np.array([0.05]))[0] for one in (gains, lone))

    assert (found > 0.5).tolist() == (gains > 0).tolist()
    assert (alone < 0.1).all()


def test_gains_of_gross_errors_do_not_overflow():
    """Thousands in the logarithm, all of one sign."""
    states, share = States.each(KEYS), np.array([0.2])
    gains = np.full((1, len(KEYS)), 1e4)

    assert states.ratio(gains, share)[0] == pytest.approx(8e4, abs=50)
    assert states.ratio(-gains, share)[0] == pytest.approx(7 * np.log1p(-begins(0.2)))
    assert states.noisy(gains, share) == pytest.approx(1.0)


def test_a_state_that_stands_nowhere_is_quiet():
    """As the zeros of a pose without pulls."""
    states = States.each(KEYS, KEYS[KEYS[:, 0] == 4])
    gains = np.full((1, len(KEYS)), 5.0)

    assert states.noisy(gains, np.array([0.2]))[0] == pytest.approx([1, 1, 1, 1, 0, 0, 0], abs=0.01)


def test_readings_of_no_pose_are_of_no_state():
    """As those of the base are."""
    states = States.each(KEYS)

    assert states.among(np.array([[4, 2], [-1, -1]])).sum(axis=0).tolist() == [1, 0]
    assert States.none().among(KEYS).shape == (0, len(KEYS))


def test_a_long_course_has_its_share_of_spells():
    """Where readings tell nothing, at any number of states per pose."""
    for per_pose in (1, 2, 20):
        keys = np.array([(p, k) for p in range(400 // per_pose) for k in range(per_pose)])
        noisy = States.each(keys).noisy(np.zeros((1, len(keys))), np.array([0.2]))[0]
        assert noisy[100:300] == pytest.approx(0.2, abs=1e-3)


KEYS_OF_TWO = np.array([(1, -1), (1, 1), (1, 2), (2, -1), (2, 1), (2, 2)])


@pytest.mark.parametrize(
    ("time", "after", "turns"),
    [
        ([0, 10, 20, 30], [0, 0, 0, 0], [(1, -1), (1, 1), (1, 2), (2, -1), (2, 1), (2, 2)]),
        ([0, 20, 10, 30], [0, 0, 0, 0], [(1, -1), (1, 1), (2, -1), (2, 1), (1, 2), (2, 2)]),
        ([10, 0, 30, 20], [1, 1, 0, 0.5], [(1, 2), (1, 1), (1, -1), (2, -1), (2, 2), (2, 1)]),
        (
            [np.nan, 5, 3, 4],
            [0.5, 0.5, 1, 1],
            [(1, -1), (1, 1), (1, 2), (1, -1), (2, 1), (2, 2), (2, -1)],
        ),
    ],
    ids=["as numbered", "in rounds", "zeros after, repeats turned", "without times"],
)
def test_states_stand_where_they_were_read(time, after, turns):
    """Pulls by their times, and zeros where they were read: before, after, or both."""
    pulls = Pulls(
        pose=np.array([1, 1, 2, 2]),
        repeat=np.array([1, 2, 1, 2]),
        q=np.zeros((4, 7)),
        force=np.zeros((4, 3)),
        branch=np.zeros(4),
        approach=np.zeros(4),
        time_zero=np.zeros(4),
        time=np.array(time, float),
        zeros_after=np.array(after, float),
    )
    states = _in_time(KEYS_OF_TWO, pulls)
    assert [tuple(states.key[k]) for k in states.turns] == turns
