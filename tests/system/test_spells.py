"""Spells of noise: sums over all courses of a campaign, against their enumeration."""

from itertools import groupby, product

import numpy as np
import pytest

from pipeline.system.spells import States

KEYS = np.array([(4, 1), (4, -1), (4, 2), (4, 2), (6, -1), (6, 1), (9, 3), (4, 3)])
"""Pose and pull of readings: four states, two, and one."""

COURSES = {
    "as numbered": (None, None, [(4, -1), (4, 1), (4, 2), (4, 3), (6, -1), (6, 1), (9, 3)]),
    "in another order": (
        np.array([9, 4, 7, 6]),
        None,
        [(9, 3), (4, -1), (4, 1), (4, 2), (4, 3), (6, -1), (6, 1)],
    ),
    "zeros again": (
        None,
        np.array([4, 9]),
        [(4, -1), (4, 1), (4, 2), (4, 3), (4, -1), (6, -1), (6, 1), (9, 3)],
    ),
}
"""Poses in time, those with zeros at their end, and the states that follow."""


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


@pytest.fixture
def gains():
    """Of each reading, for two laws."""
    return np.random.default_rng(1).normal(0, 2, (2, len(KEYS)))


@pytest.mark.parametrize("name", COURSES)
def test_a_spell_covers_successive_states(gains, name):
    """Likelihood ratio and probability of every state, each course enumerated."""
    poses, again, turns = COURSES[name]
    states, share = States.each(KEYS, poses, again), np.array([0.2, 0.05])
    keys = sorted({(int(p), int(k)) for p, k in KEYS})

    for law, u in enumerate(share):
        whole, noisy = 0.0, np.zeros(len(turns))
        g = [gains[law][(key == KEYS).all(axis=1)].sum() / turns.count(key) for key in turns]
        for course in product((0, 1), repeat=len(turns)):
            p = chance(course, 3 * u / len(turns), 0.75) * np.exp(np.dot(course, g))
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
    """Thousands in the logarithm, whatever the sign."""
    states, share = States.each(KEYS), np.array([0.2])
    gains = np.full((1, len(KEYS)), 1e4)

    assert states.ratio(gains, share)[0] == pytest.approx(8e4, abs=50)
    assert states.ratio(-gains, share)[0] == pytest.approx(7 * np.log1p(-0.6 / 7))
    assert states.noisy(gains, share) == pytest.approx(1.0)


def test_readings_of_no_pose_are_of_no_state():
    """As those of the base are."""
    states = States.each(KEYS)

    assert states.among(np.array([[4, 2], [-1, -1]])).sum(axis=0).tolist() == [1, 0]
    assert States.none().among(KEYS).shape == (0, len(KEYS))
